"""The command line of the track generator: python -m airrace.track."""

import argparse
import sys
from pathlib import Path

from pydrake.common.yaml import yaml_dump_typed

from airrace.common.errors import exit_code
from airrace.track.generator import DIRECTIONS, generate_track
from airrace.track.layout import Layout
from airrace.track.rules import GATE_COUNTS
from airrace.track.track import Track

_EPILOG = """\
Every track obeys the layout rule of the Student AirRace: the next left pylon is
straight ahead of the left pylon, 12 to 70 m away, and every gate is turned by 45
degrees from the one before. The turns add up to one round, which takes an even
number of gates, 8 at least. The drone has room between the pylons, and sees each
gate on its way straight on from the one before.

examples:
  python -m airrace.track --seed 7 > seven.yaml                  anything
  python -m airrace.track --seed 7 --gates 10 --plot seven.png > seven.yaml
  python -m airrace.track --seed 7 --direction right > seven.yaml   clockwise
  ./run.bash --track seven.yaml                                  race it

The same options give the same file. Exit codes: 0 printed, 2 bad input.
"""
_FORMAT = """\
# World frame: x forward, y left, z up; metres and degrees. A gate's heading is the
# direction of flight through it; its right pylon stands pylon_spacing to the right of
# the left one. The pad descends by pad_tilt_deg in the direction pad_tilt_direction_deg.
"""


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m airrace.track",
        description="Print a random race track as YAML.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="which of the random tracks, 0 or more (default: 0)",
    )
    parser.add_argument(
        "--gates",
        type=int,
        metavar="N",
        help=f"{', '.join(map(str, GATE_COUNTS))} (default: drawn from the seed)",
    )
    parser.add_argument(
        "--direction",
        choices=DIRECTIONS,
        help="of travel: left is counter-clockwise (default: drawn from the seed)",
    )
    parser.add_argument(
        "--plot", type=Path, metavar="FILE", help="also draw it from above, as .png, .svg or .pdf"
    )
    return parser


def to_yaml(track: Track, comment: str) -> str:
    """Returns the text of a track's file, which begins with a comment."""
    return f"# {comment}\n{_FORMAT}{yaml_dump_typed(track, schema=Track)}"


def main(argv=None) -> int:
    """The command-line program; returns its exit code."""
    return exit_code(lambda: run(make_parser().parse_args(argv)))


def run(args) -> int:
    """Prints a track by parsed arguments; returns the exit code."""
    track = generate_track(args.seed, args.gates, args.direction)
    if args.plot is not None:
        from airrace.track.plot import save_plot  # matplotlib takes a second

        save_plot(track, args.plot)
    direction = "left" if Layout.of(track).turns.sum() > 0 else "right"
    command = f"python -m airrace.track --seed {args.seed} --gates {len(track.gates)}"
    sys.stdout.write(to_yaml(track, f"{command} --direction {direction}"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
