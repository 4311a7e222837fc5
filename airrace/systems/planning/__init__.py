"""From the gate map to the reference: laps are planned, and followed.

- lap_planner.py: when a lap is planned, and when its plan comes into force.
- lap_planning.py: how one planning problem is solved, and when a new plan is refused.
- map_margins.py: how far from pylons laps keep, the first and later ones.
- laps.py: the planning problem; min_snap_laps.py and time_optimal_laps.py find laps of a kind.
- lap_plan.py: the value of the lap_plan port; trajectory_tracker.py samples the one in force.
"""
