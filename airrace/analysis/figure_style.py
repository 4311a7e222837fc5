"""How the report's pictures look: vector graphics that follow the page's theme, light or dark.

Each is drawn twice, for the width of a desk's window and for that of a phone's: letters of a
picture that is made smaller to fit could not be read. The style sheet shows one of them.

A picture is drawn for white paper. On a page, the colours of THEME become variables of its style
sheet; all other colours are such that they can be seen on white and on dark paper.
"""

import io
import re
import zlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure

from airrace.common.colors import BEST, speed_colors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable

# Lines and text; text of less weight; other laps; grid; areas; paper.
INK, MUTED, FAINT, GRID, SHADE, PAPER = THEME = (
    *("#1c1c1c", "#5f5f5f", "#a9a9a9"),
    *("#e4e4e4", "#d9d9d9", "#ffffff"),
)
# What each of them is called in the page's style sheet.
_VARIABLES = dict(zip(THEME, ("ink", "faint", "other", "grid", "shade", "card")))
# With more colours, Matplotlib would make a bar of them a picture of pixels.
SPEED_COLORS = ListedColormap(speed_colors(np.linspace(0.0, 1.0, 40), 1.0), name="speed")
# Ink, the more the darker, through which paper of any colour shows; numbers on it can be read.
_AMOUNTS = np.linspace(0.0, 0.5, 40)
SHADES = ListedColormap(np.column_stack([np.tile(to_rgb(INK), (40, 1)), _AMOUNTS]), name="shades")
STYLE: dict[str, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "text.color": INK,
    "xtick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.color": MUTED,
    "ytick.labelcolor": INK,
    "svg.fonttype": "none",  # text stays text
}
# Lines of what is worst, and of the root mean square.
WORST = dict(label="worst", color=INK, marker="s", ls="--", ms=4, lw=1.0, mfc=PAPER)
RMS = dict(label="RMS", color=INK, marker="o", ms=4, lw=1.2)
_TIP = "tip:"


class Sheet(NamedTuple):
    """What a picture is drawn on."""

    name: str  #: of its class in the style sheet
    width: float  #: (inches)
    is_wide: bool  #: whether panels have room side by side


DESK, PHONE = Sheet("desk", 9.0, True), Sheet("phone", 4.2, False)


def make_figure(width: float, height: float, **options: Any) -> Figure:
    """Returns an empty figure of some size (inches); options are Figure's."""
    return Figure(figsize=(width, height), layout="constrained", **options)


def height_from_above(sheet: Sheet, places: np.ndarray) -> float:
    """Returns how high a picture of places (n, 2) from above is (inches)."""
    if sheet.is_wide:
        return 7.2
    across, along = np.ptp(places, axis=0)
    return 1.7 + min(0.9 * along / across, 1.5) * sheet.width  # beside it, what is around it


def make_pair(
    sheet: Sheet, widths: tuple[float, float], heights: tuple[float, float]
) -> tuple[Figure, Any, Any]:
    """Returns a figure and its two panels: side by side, or on a phone one below the other.

    Args:
        sheet: of the figure.
        widths: of the panels side by side, shares.
        heights: of the panels one below the other (inches); of both side by side, the greater.
    """
    if sheet.is_wide:
        figure = make_figure(sheet.width, max(heights))
        return figure, *figure.subplots(1, 2, width_ratios=widths)
    figure = make_figure(sheet.width, sum(heights))
    return figure, *figure.subplots(2, 1, height_ratios=heights)


def lap_style(lap: int, best: int | None) -> dict:
    """Returns how the line or the marks of a lap are drawn: the best in blue, others in grey.

    Args:
        lap: its number.
        best: that of the best lap.
    """
    if lap == best:
        return dict(color=BEST, lw=1.8, ms=6, mew=0.8, mec=PAPER, zorder=4)
    return dict(color=FAINT, lw=0.9, ms=4.5, mew=0.6, mec=PAPER, zorder=3)


def add_tip(artist: "Artist", words: str) -> None:
    """Makes a page show some words while the pointer is on a part of a picture."""
    artist.set_gid(_TIP + words)


def add_legend(figure: Figure, axes: "Axes", place: str = "outside right upper") -> None:
    """Adds a legend beside a picture, or on a phone above it, that names all of some axes once."""
    handles, labels = axes.get_legend_handles_labels()
    once, is_wide = dict(zip(labels, handles)), figure.get_figwidth() > PHONE.width
    place = place if is_wide else place.replace("right upper", "upper center")
    columns = 1 if "right" in place else 6 if is_wide else 2
    options: dict[str, Any] = dict(loc=place, ncols=columns)
    figure.legend([*once.values()], [*once], **options)


def add_colorbar(
    figure: Figure, mappable: "ScalarMappable", axes: "Axes", label: str, **options: Any
) -> None:
    """Adds what the colours of something mean; options are Figure.colorbar's."""
    bar = figure.colorbar(mappable, ax=axes, label=label, **options)
    assert bar.solids is not None  # as of lines of contours alone
    bar.solids.set_edgecolor("face")  # no hairlines between its colours


def inline_pictures(draw: Callable[[Sheet], Figure], name: str) -> dict[str, str]:
    """Returns a picture as <svg> elements for a page, one for each sheet, by the sheets' names.

    Args: draw: makes its figure. name: unlike any other picture's of the page.
    """
    return {sheet.name: inline_svg(draw(sheet), f"{name}, {sheet.name}") for sheet in (DESK, PHONE)}


def inline_svg(figure: Figure, name: str) -> str:
    """Returns a figure as an <svg> element for a page; name: unlike any other figure's of it."""
    file = io.StringIO()
    with rc_context({"svg.hashsalt": name, **STYLE}):
        # No date and no version: the same run, the same report.
        figure.savefig(file, format="svg", metadata={"Date": None, "Creator": None})
    text = file.getvalue()
    return _with_tips(_themed(_with_numbered_clips(text[text.index("<svg") :].strip(), name)))


def _with_numbered_clips(svg: str, name: str) -> str:
    """Returns a picture whose clip paths are called by their order.

    Matplotlib calls them by all digits of where they are, of which the last differ between two
    layouts of the same figure.
    """
    picture = f"p{zlib.crc32(name.encode()):x}"
    ids = dict.fromkeys(re.findall(r'<clipPath id="(\w+)"', svg))
    numbered = {old: f"{picture}-{k}" for k, old in enumerate(ids)}
    return re.sub(r"\bp[0-9a-f]{10}\b", lambda match: numbered.get(match[0], match[0]), svg)


def _themed(svg: str) -> str:
    """Returns a picture whose colours of THEME are variables of the page."""
    pattern = "|".join(f"{color}\\b" for color in THEME)
    return re.sub(pattern, lambda match: f"var(--{_VARIABLES[match[0]]})", svg)


def _with_tips(svg: str) -> str:
    """Returns a picture in which the words of add_tip() are titles of their parts."""
    return re.sub(rf"<g id=([\"']){_TIP}(.*?)\1>", r"<g><title>\2</title>", svg)
