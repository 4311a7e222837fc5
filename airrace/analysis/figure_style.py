"""How the report's pictures look: vector graphics, one style, readable in grey."""

import io
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable

# Laps are told apart by marker and line style as well as by colour.
LINE_STYLES = ("-", "--", "-.", ":")
MARKERS = "osD^vP*Xd<"
# Its lightness falls evenly, so that grey shows the same; without the lightest, for paper.
# With more colours, Matplotlib would make a bar of them a picture of pixels.
SPEED_COLORS = ListedColormap(colormaps["cividis_r"](np.linspace(0.12, 1.0, 40)))
GREYS = colormaps["Greys"].resampled(40)
INK, FAINT = "#1c1c1c", "#b5b5b5"
# Steps of one lightness each, dark to light, and not too light for white paper.
_LAP_COLORS = (
    *("#00224e", "#7a0403", "#1f5fa8", "#b8500c", "#2a7f62"),
    *("#8f2d84", "#5a6b7b", "#a5732a", "#4f4fb0", "#3f8f3f"),
)
STYLE: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.edgecolor": "#555",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "svg.fonttype": "none",  # text stays text
}
# Lines of what is worst, and of the root mean square.
WORST = dict(label="worst", color=INK, marker="s", ls="--", ms=4, lw=1.0, mfc="white")
RMS = dict(label="RMS", color=INK, marker="o", ms=4, lw=1.2)


def make_figure(width: float, height: float, **options: Any) -> Figure:
    """Returns an empty figure of some size (inches); options are Figure's."""
    return Figure(figsize=(width, height), layout="constrained", **options)


def add_colorbar(
    figure: Figure, mappable: "ScalarMappable", axes: "Axes", label: str, **options: Any
) -> None:
    """Adds what the colours of something mean; options are Figure.colorbar's."""
    bar = figure.colorbar(mappable, ax=axes, label=label, **options)
    bar.solids.set_edgecolor("face")  # no hairlines between its colours


def lap_style(lap: int) -> dict:
    """Returns how the line of a lap, from 1, is drawn."""
    i = lap - 1
    return {
        "color": _LAP_COLORS[i % len(_LAP_COLORS)],
        "marker": MARKERS[i % len(MARKERS)],
        "linestyle": LINE_STYLES[i % len(LINE_STYLES)],
        "markersize": 4,
        "linewidth": 1.1,
    }


def inline_svg(figure: Figure, name: str) -> str:
    """Returns a figure as an <svg> element for a page; name: unlike any other figure's of it."""
    file = io.StringIO()
    with rc_context({"svg.hashsalt": name, **STYLE}):  # type: ignore[dict-item]
        # No date and no version: the same run, the same report.
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    text = file.getvalue()
    return text[text.index("<svg") :].strip()
