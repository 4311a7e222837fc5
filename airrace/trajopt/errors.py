"""What planners raise."""


class TrajectoryOptimizationError(ValueError):
    """There is no such trajectory, or the solver found none."""
