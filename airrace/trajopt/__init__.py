"""Trajectory optimisation as pure functions, without Systems or Contexts.

min_snap/ and time_optimal/ plan laps, on the common ground of flatness, limits and gate regions.
"""
