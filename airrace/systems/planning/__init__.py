"""From the gate map to the reference: laps are planned, and followed.

LapPlanner plans with trajopt/; TrajectoryTracker samples the plan in force.
"""
