"""Every box of the two diagrams: a LeafSystem a file, with its helpers beside it.

Folders follow the block diagram, from the plant to the controller.
"""

from airrace.systems.control.geometric_controller import GeometricController
from airrace.systems.estimation.delay_compensator import DelayCompensator
from airrace.systems.estimation.gate_slam import GateSlam
from airrace.systems.estimation.state_filter import StateFilter
from airrace.systems.estimation.strapdown_integrator import StrapdownIntegrator
from airrace.systems.exploring.explorer import Explorer
from airrace.systems.failsafe.command_watchdog import CommandWatchdog
from airrace.systems.failsafe.rotor_monitor import RotorMonitor
from airrace.systems.mapping.gate_map_writer import GateMapWriter
from airrace.systems.mapping.gate_mapper import GateMapper
from airrace.systems.mapping.known_map import KnownMap, NoDetector
from airrace.systems.perception.aruco_detector import ArucoDetector
from airrace.systems.perception.rectifier import Rectifier
from airrace.systems.planning.lap_planner import LapPlanner
from airrace.systems.planning.trajectory_tracker import TrajectoryTracker
from airrace.systems.plant.drag import Drag
from airrace.systems.plant.gate_mover import GateMover
from airrace.systems.plant.rotor_bank import RotorBank
from airrace.systems.plant.wind import Wind
from airrace.systems.referee import Referee
from airrace.systems.sensing.camera import Camera
from airrace.systems.sensing.imu import Imu
from airrace.systems.sensing.state_estimate import StateEstimate
