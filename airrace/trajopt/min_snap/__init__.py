"""Minimum-snap laps (circuit.py), transitions onto them (transition.py), and legs (leg.py).

min_snap.py solves for given durations; time_allocation.py finds the durations within limits.py,
soft_allocation.py those of the original system.
"""
