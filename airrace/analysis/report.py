"""report.html of a run: a page of pictures and tables that needs nothing else."""

import functools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airrace.analysis.along_lap import best_lap
from airrace.analysis.course_report import make_course_report
from airrace.analysis.gate_pictures import gate_pictures
from airrace.analysis.log import reading
from airrace.analysis.page_templates import page_template
from airrace.analysis.run import Run
from airrace.common.files import write_text
from airrace.recording.flown_plans import plan_of_laps, same_plan_words
from airrace.recording.race_json import LapJson, PlanJson, RaceJson, WallJson, is_course_json
from airrace.recording.race_result import ORIGINAL_LAPS, ORIGINAL_TRACK, own_systems_words
from airrace.scenario import laps_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from airrace.analysis.figure_style import Sheet

FILE = "report.html"
# Topics that it says nothing of.
_WITHOUT = (
    "/state/estimate /state/filtered /state/disturbance /imu /imu/samples /rotors/command".split()
)


_ESTIMATE, _CERTAINTY = "Where the drone thought it was", "How sure of it the drone was"


def make_report(run: Run) -> str:
    """Returns the report of a run, a page that needs nothing else."""
    result = run.result
    plans = plan_of_laps(result["laps"])
    return page_template("airrace.analysis", FILE).render(
        run=run,
        result=result,
        when=_when(result["wall"]),
        own_systems=own_systems_words(result.get("systems", {})),
        laps=laps_name(result["trajectory"], result["limits"]),
        summary=_summary(run),
        splits=np.array([np.diff([*lap["gate_times_s"], lap["time_s"]]) for lap in result["laps"]]),
        plans=plans,
        same_plan=same_plan_words(plans),
        learnt=_learnt(result["laps"]),
        original=ORIGINAL_LAPS if _is_comparable(result) else {},
        best=best_lap(run),
        pictures=_pictures(run),
        gate_pictures=gate_pictures(run),
    )


def _when(wall: WallJson) -> str:
    """Returns when a race was flown, and with which airrace, as far as race.json says so."""
    date = wall.get("date", "")[:16].replace("T", " ")
    version = f"airrace {wall['version']}" if "version" in wall else ""
    return ", ".join(filter(None, (date and f"{date} UTC", version)))


def _learnt(laps: list[LapJson]) -> list[tuple[int, PlanJson]]:
    """Returns the laps, and plans, that count with another drone or air than the lap before.

    The first is compared with the drone as in its file, in still air: nothing is learnt until then.
    """
    learnt: list[tuple[int, PlanJson]] = []
    for lap in laps:
        plan = lap["plan"]
        if plan is None or not plan.get("rotor_factors"):
            continue
        known = _known(plan)
        as_in_file = set(known[0]) == {1.0} and not any(known[1])
        if known != _known(learnt[-1][1]) if learnt else not as_in_file:
            learnt.append((lap["lap"], plan))
    return learnt


def _known(plan: PlanJson) -> list[list[float]]:
    return [plan["rotor_factors"], plan["drag"], plan["wind"]]


def _is_comparable(result: RaceJson) -> bool:
    """Whether the original system flew this track within these limits."""
    return (result["track"], result["limits"]) == (ORIGINAL_TRACK, "original")


def _summary(run: Run) -> dict:
    """Returns map error (m), tracking error (m) and greatest share of a rotor's thrust, or None.

    Also error_statistics(), if the drone had to find out where it is.
    """
    from airrace.analysis.figures_estimator import error_statistics
    from airrace.analysis.figures_signals import rotor_usage

    map_rms = run.laps["map_rms"].dropna()
    off = run.tracking["distance"][run.tracking["lap"].between(1, len(run.result["laps"]))]
    return dict(
        map_error=map_rms.iloc[-1] if len(map_rms) else None,
        tracking_error=np.sqrt(np.mean(off**2)) if len(off) else None,
        estimate=error_statistics(run) if len(run.estimator) else None,
        thrust=max((share.max() for share in rotor_usage(run) if len(share)), default=None),
    )


def _pictures(run: Run) -> dict[str, dict[str, str]]:
    """Returns <svg> elements by the title of every section that this run has data for."""
    from matplotlib import rc_context

    from airrace.analysis import (
        figures_blackbox,
        figures_estimator,
        figures_explorer,
        figures_laps,
        figures_plans,
        figures_signals,
        figures_track,
    )
    from airrace.analysis.along_lap import lap_profiles, leg_losses
    from airrace.analysis.figure_style import STYLE, inline_pictures

    laps = run.result["laps"]
    log = figures_blackbox.read_log(run)

    def draw_log(run: Run, sheet: "Sheet") -> "Figure":
        assert log is not None
        return figures_blackbox.rates_figure(run, log, sheet)

    sections = (
        ("The track from above", True, figures_track.track_figure),
        ("The planned laps", figures_plans.planned_laps(run), figures_plans.plans_figure),
        ("Along the lap", lap_profiles(run), figures_laps.along_figure),
        ("Where time was lost", leg_losses(run), figures_laps.losses_figure),
        ("Gates", laps, figures_laps.offsets_figure),
        ("The map", len(run.map) and len(run.lap_starts), figures_signals.map_figure),
        ("Tracking", len(run.tracking) > 1, figures_signals.tracking_figure),
        (_ESTIMATE, len(run.estimator) > 1, figures_estimator.errors_figure),
        (_CERTAINTY, len(run.estimator) > 1, figures_estimator.certainty_figure),
        ("Rotors", len(run.rotors), figures_signals.rotors_figure),
        ("Betaflight", log is not None, draw_log),
        (
            "What the explorer did",
            run.result["exploration"]["events"],
            figures_explorer.timeline_figure,
        ),
    )
    with rc_context(STYLE):
        return {
            title: inline_pictures(functools.partial(draw, run), title)
            for title, data, draw in sections
            if data
        }


def write_report(folder: str | Path) -> Path:
    """Writes report.html of a run, which may be unfinished; returns its path.

    Args:
        folder: of the run.

    Raises:
        UserError: if it holds no race, or the file cannot be written.
    """
    folder = Path(folder)
    folder = folder.parent if folder.is_file() else folder
    if is_course_json(folder / "race.json"):
        with reading(folder, "what the report is made of"):
            text = make_course_report(folder)
    else:
        run = Run(folder, without=_WITHOUT)
        with reading(folder, "what the report is made of"):
            text = make_report(run)
    write_text(folder / FILE, text)
    return folder / FILE
