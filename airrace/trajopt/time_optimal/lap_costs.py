"""What a step of a lap costs beside its time."""

import numpy as np

from airrace.trajopt.time_optimal.lap_step import LapStep


def stay_near(step: LapStep, weight: float) -> None:
    """Adds the squared change of speed, acceleration, jerk and snap of the path.

    Each is relative to its root mean square over the lap, and the mean of all is
    weighed against the time: the constraints of a step are good near the lap that
    it starts from.

    Args:
        step: to add to.
        weight: of a change by all of it, as a share of the lap time.
    """
    y, T = step.samples.derivatives[..., :3], step.lap.durations
    n, samples = y.shape[1:3]
    orders = np.arange(5)
    powers = T[:, None] ** -orders
    rms = np.sqrt(np.mean(np.sum((y * powers.T[:, :, None, None]) ** 2, axis=3), axis=(1, 2)))
    share = np.sqrt(weight * step.lap.duration / (n * samples))
    for leg in range(n):
        blocks = []
        for k in orders[1:]:
            by_z, by_stretch = step.derivatives(leg, k)
            scale = share * powers[leg, k] / rms[k]
            block = np.zeros((3, samples, 4 * by_z.shape[1] + 2))
            for d in range(3):
                block[d, :, d:-2:4] = scale * by_z
                block[d, :, -1] = scale * (by_stretch[:, d] - k * y[k, leg, :, d])
            blocks.append(block.reshape(3 * samples, -1))
        rows = np.vstack(blocks)
        step.least_squares(leg, rows, np.zeros(len(rows)))


def smooth_twist(step: LapStep, weight: float) -> None:
    """Adds the mean squared second derivative of the twist (rad/s^2).

    Args:
        step: to add to.
        weight: as a share of the lap time.
    """
    T, y = step.lap.durations, step.samples.derivatives[2, ..., 3]
    for leg in range(len(T)):
        by_z, _ = step.derivatives(leg, 2)
        scale = np.sqrt(weight * step.lap.duration / y.size) / T[leg] ** 2
        rows = np.zeros((len(by_z), 4 * by_z.shape[1] + 2))
        rows[:, 3:-2:4] = scale * by_z
        step.least_squares(leg, rows, scale * y[leg])
