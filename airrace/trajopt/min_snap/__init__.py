"""Minimum-snap laps, transitions and legs through waypoints.

min_snap.py solves for given durations; time_allocation.py finds the durations.
"""
