"""Pictures of what a flight controller logged, beside what was true."""

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from airrace.analysis.blackbox import FILE, RACE_BEGINS, read_blackbox
from airrace.analysis.figure_style import DESK, FAINT, Sheet, add_legend, make_figure
from airrace.common.colors import BEST, EARLIER, speed_colors

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airrace.analysis.run import Run

_AXES = "roll", "pitch", "yaw"
_WINDOW = 4.0  # s, that is shown
_LAGS = np.arange(0.0, 0.3, 0.002)  # s, among which a delay is looked for
_MOTORS = 4


def read_log(run: "Run") -> pd.DataFrame | None:
    """Returns what Betaflight logged of a run, in the race's time.

    None if there is no log, or one without what is drawn: settings can leave fields out.
    """
    try:
        log = read_blackbox(run.folder / FILE)
    except (OSError, ValueError):
        return None
    log["time"] -= RACE_BEGINS
    log = log[log["time"] > 0.0]
    drawn = {name for axis in range(3) for name in _columns(axis)}
    drawn |= {f"motor[{motor}]" for motor in range(_MOTORS)}
    return log if len(log) > 1 and drawn <= {*log.columns} else None


def delay(log: pd.DataFrame, axis: int) -> float:
    """Returns by how much the gyroscope follows the set-points later (s).

    It is the shift at which the two are least apart.

    Args: log: of read_log(). axis: 0 to 2.
    """
    time, wanted, had = (log[x].to_numpy() for x in _columns(axis))
    errors = [np.mean((np.interp(time - lag, time, wanted) - had) ** 2) for lag in _LAGS]
    return float(_LAGS[np.argmin(errors)])


def _columns(axis: int) -> tuple[str, str, str]:
    return "time", f"setpoint[{axis}]", f"gyroADC[{axis}]"


def rates_figure(run: "Run", log: pd.DataFrame, sheet: Sheet = DESK) -> "Figure":
    """Returns rates that were wanted, measured and true, and the motors, where they change most.

    Of a race with laps, that is within these.

    Args: run: that was flown. log: of read_log(). sheet: of the figure.
    """
    first, last = _laps_span(run, log)
    flown = log[log["time"].between(first, last)]
    wanted_rates = flown[[f"setpoint[{axis}]" for axis in range(3)]].to_numpy()
    begin = _busiest(flown["time"].to_numpy(), wanted_rates)
    shown = log[(log["time"] >= begin) & (log["time"] <= begin + _WINDOW)]
    true = _true_rates(run)
    figure = make_figure(sheet.width, 7)
    plots = figure.subplots(4, 1, sharex=True)
    for axis, (name, plot) in enumerate(zip(_AXES, plots)):
        _, wanted, had = _columns(axis)
        inside = (true["time"] >= begin) & (true["time"] <= begin + _WINDOW)
        plot.plot(true["time"][inside], true[name][inside], color=FAINT, lw=2.4, label="true")
        plot.plot(shown["time"], shown[wanted], color=BEST, lw=1.2, label="set-point")
        plot.plot(shown["time"], shown[had], color=EARLIER, lw=0.9, label="gyroscope, filtered")
        plot.set_ylabel(f"{name} (deg/s)")
        plot.set_title(f"{1e3 * delay(log, axis):.0f} ms behind the set-point", loc="right")
    for motor, color in enumerate(speed_colors(np.arange(_MOTORS), _MOTORS - 1)):
        share = (shown[f"motor[{motor}]"] - 1000.0) / 10.0
        plots[-1].plot(shown["time"], share, lw=0.9, color=color, label=f"motor {motor + 1}")
    plots[-1].set(xlabel="time (s)", ylabel="motors (%)", ylim=(0, 105))
    add_legend(figure, plots[0], "outside upper center")
    add_legend(figure, plots[-1], "outside lower center")
    return figure


def _busiest(time: np.ndarray, wanted: np.ndarray) -> float:
    """Returns where the window begins in which set-points change most (s).

    Args: time: (n,). wanted: (n, 3).
    """
    change = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(wanted, axis=0)).sum(axis=1))])
    ends = np.interp(time + _WINDOW, time, change)
    return float(time[np.argmax(ends - change)])


def _laps_span(run: "Run", log: pd.DataFrame) -> tuple[float, float]:
    """Returns from when to when laps were flown (s), or else all of the log, (2,)."""
    first, last = log["time"].iloc[[0, -1]]
    if len(run.lap_starts):
        # Even of a lap that was soon over, a whole window is shown.
        last = min(last, max(run.lap_starts[-1], run.lap_starts[0] + _WINDOW))
        first = max(first, min(run.lap_starts[0], last - _WINDOW))
    return float(first), float(last)


def _true_rates(run: "Run") -> pd.DataFrame:
    """Returns the true rates in the axes of the body (deg/s), and their times."""
    from scipy.spatial.transform import Rotation

    state = run.state
    R_WB = Rotation.from_quat(state[["qx", "qy", "qz", "qw"]].to_numpy())
    rates = np.degrees(R_WB.inv().apply(state[["wx", "wy", "wz"]].to_numpy()))
    return pd.DataFrame(rates, columns=[*_AXES]).assign(time=state["time"].to_numpy())
