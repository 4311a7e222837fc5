"""The race track: gates, pylons and marker boards, where they may stand, and their files.

`airrace track` makes random ones.
"""

from airrace.track.course import Board, Course
from airrace.track.gate_map import GateEstimate, GateMap, MarkerEstimate
from airrace.track.layout import Layout
from airrace.track.start import Start, start_pose
from airrace.track.track import (
    BOARD_HEIGHT,
    BOARD_OFFSET,
    BOARD_SIZE,
    MARKER_SIZE,
    PYLON_BASE_RADIUS,
    PYLON_HEIGHT,
    PYLON_TIP_RADIUS,
    Gate,
    Track,
)
from airrace.track.track_files import load_track
