"""From the map to laps. It flies as it is."""

from airrace.systems.planning.lap_planner import LapPlanner
from airrace.systems.planning.lap_planning import plan_lap

# LapPlanner decides when to plan, and when a plan comes into force. Its ports:
#   in:  gate_map, explorer_status, exploration_reference
#   out: lap_plan


def solve(problem):
    """Returns a LapPlan for a LapProblem, or None: then the old lap is flown once more.

    The problem has the gates in the order of flight, the pylons with the margins to keep from
    them, where the drone is when the plan begins, and the old plan. Return a plan of your own, or
    change the problem, for instance its margins: dataclasses.replace(problem, margins=...).
    """
    return plan_lap(problem)


def make(scenario):
    """Returns the system; called once before a race."""
    return LapPlanner.from_scenario(scenario, solve)
