"""Trajectory optimisation: pure functions, without Systems or Contexts."""
