"""How every picture looks: sizes, colours, line styles, and saving without half-written files.

Colour says which section, line style says which unit (or segment) of it. The colours are those of
Okabe and Ito, in an order in which neighbours also differ in grey. Figures are made without
pyplot: nothing global is left behind, and no display is needed.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from softmpc.files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = [
    "ALARM", "COLOURS", "DASHES", "GOAL", "GREY", "INK", "LIMIT", "REFERENCE", "TRACE", "colour",
    "dash", "figure", "label", "legend_right", "save_figure", "styled", "width",
]  # fmt: skip

COLOURS = ("#0072B2", "#E69F00", "#117755", "#CC79A7", "#7A3B00", "#56B4E9")
DASHES: tuple[Any, ...] = (
    "-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)), (0, (12, 2)),
    (0, (6, 1.5, 1.2, 1.5, 1.2, 1.5)),
)  # fmt: skip
GREY, INK, ALARM = "#7F7F7F", "#222222", "#B22222"
DPI = 150
log = logging.getLogger(__name__)
# A path to follow is a broad light band, and what was done a thin line upon it.
REFERENCE: dict[str, Any] = {"color": "#BDBDBD", "linewidth": 4.0, "solid_capstyle": "round"}
TRACE: dict[str, Any] = {"color": ALARM, "linewidth": 1.3}
LIMIT: dict[str, Any] = {"color": ALARM, "linewidth": 1.0, "linestyle": (0, (8, 3, 1, 3))}
GOAL: dict[str, Any] = {
    "color": ALARM, "marker": "x", "markersize": 7, "markeredgewidth": 1.8, "linestyle": "none",
}  # fmt: skip
SETTINGS: dict[str, Any] = {
    "font.size": 9,
    "axes.labelsize": 9,
    "axes.titlesize": 10,
    "figure.titlesize": 12,
    "figure.titleweight": "bold",
    "legend.fontsize": 8,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "text.color": INK,
    "axes.grid": True,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "round",
    "axes.formatter.useoffset": False,
}

Draw = TypeVar("Draw", bound=Callable[..., Any])


def styled(draw: Draw) -> Draw:
    """Make a drawing function use `SETTINGS`, whatever the user's matplotlib settings are."""

    @wraps(draw)
    def drawn(*args: Any, **options: Any) -> Any:
        import matplotlib as mpl

        defaults = {k: v for k, v in mpl.rcParamsDefault.items() if not k.startswith("backend")}
        with mpl.rc_context(defaults | SETTINGS):  # type: ignore[arg-type]
            return draw(*args, **options)

    return drawn  # type: ignore[return-value]


def figure(width: float, height: float, title: str = "", layout: str = "constrained") -> Figure:
    """An empty figure of that size in inches, drawn by Agg."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure((width, height), dpi=DPI, layout=layout)  # type: ignore[arg-type]
    FigureCanvasAgg(made)
    if title:
        made.suptitle(title.replace("$", r"\$"))  # no formulas
    return made


def label(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Axis labels with units, and a short title at the left."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title, loc="left")


def legend_right(axes: Axes, **options: Any) -> None:
    """A legend beside the axes, where it covers no data."""
    place: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.02)}
    axes.legend(**{**place, "borderaxespad": 0.0, **options})


def colour(section: int) -> str:
    """Colour of a section, counted from 0."""
    return COLOURS[section % len(COLOURS)]


def dash(index: int) -> Any:
    """Line style of a unit or segment within its section, counted from 0."""
    return DASHES[index % len(DASHES)]


def width(section: int) -> float:
    """Line width of a section: what is drawn later is thinner and does not hide the rest."""
    return max(0.8, 1.8 - 0.7 * section)


@styled
def save_figure(made: Figure, path: Path) -> Path:
    """Write a figure; a crash leaves the last good one."""
    with replacing(path) as beside:
        made.savefig(beside)
    log.info("wrote %s", path)
    return path
