"""The picture of an energy audit: what is stored, what was put in and lost, and what is unclear."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.style import ALARM, GREY, INK, figure, label, legend_right, styled
from softmpc.view.time_plots import TIME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["energy_figure"]

# Apart from each other in grey, too; stored is drawn solid, worked dashed.
TERMS = ("#0072B2", "#E69F00", "#117755", "#CC79A7", "#7A3B00", "#56B4E9", INK, GREY)


@styled
def energy_figure(audit: Any, title: str = "Energy") -> Figure:
    """Changes of the energies and the works over time, and the balance error; of an `Audit`."""
    made = figure(9.0, 5.6, title)
    axes = made.subplots(3, 1, sharex=True, height_ratios=(2.0, 2.0, 1.0))
    time = audit.time
    changes = {name: energy - energy[0] for name, energy in audit.energies.items()}
    _draw_terms(axes[0], time, changes, "-", "energy of the arm, change since the start")
    works = "work put into the arm" + ("" if audit.works else ": not known")
    _draw_terms(axes[1], time, audit.works, "--", works)
    _draw_error(axes[2], time, audit)
    for one in axes:
        one.margins(x=0.01)
        one.tick_params(labelbottom=True)
        if one.get_legend_handles_labels()[0]:  # an audit may know no works
            legend_right(one)
    made.align_ylabels(axes)
    return made


def _draw_terms(
    axes: Axes, time: np.ndarray, terms: dict[str, np.ndarray], line: str, title: str
) -> None:
    for k, (name, values) in enumerate(terms.items()):
        look: dict[str, Any] = {"color": TERMS[k % len(TERMS)], "linestyle": line}
        axes.plot(time, values, **look, label=name.replace("_", " "))
    total = sum(terms.values(), np.zeros(1))
    if len(terms) > 1:
        axes.plot(time, total, color=INK, linewidth=2.0, linestyle=line, label="sum")
    label(axes, TIME, "energy (J)", title)


def _draw_error(axes: Axes, time: np.ndarray, audit: Any) -> None:
    """What the sums differ by, in millionths of the most that any term took up."""
    if audit.missing:
        label(axes, TIME, "error (10⁻⁶)", f"no balance: {audit.missing[0].partition(';')[0]}")
        axes.plot(time[[0, -1]], [0.0, 0.0], color=GREY, linewidth=0.8, label="no error known")
        return
    millionths = 1e6 * audit.error / audit.turnover
    axes.plot(time, millionths, color=ALARM, linewidth=1.1, label="error")
    largest = f"at most {audit.closure:.1e} of {audit.turnover:.3g} J"
    label(axes, TIME, "error (10⁻⁶)", f"sum of energies less sum of works: {largest}")
    axes.set_ylim(*_at_least(axes.get_ylim()))


def _at_least(limits: tuple[float, float], span: float = 0.02) -> tuple[float, float]:
    """Limits that are no closer than `span`: rounding is not blown up."""
    middle, half = sum(limits) / 2, max(limits[1] - limits[0], span) / 2
    return middle - half, middle + half
