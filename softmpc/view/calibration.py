"""A calibration as a picture: estimates, residuals, and what goes with what."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.view.style import ALARM, COLOURS, GREY, INK, figure, label, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.study.calibration_result import Calibration, Estimate

__all__ = ["calibration_figure"]

MOST_NAMED = 24  # residuals that still get their names
NAME_LENGTH = 34
PRIOR, START, FOUND = GREY, COLOURS[1], COLOURS[0]


@styled
def calibration_figure(found: Calibration) -> Figure:
    """Estimates with their 95 % bands against start and prior, correlations, residuals in sigmas.

    Each parameter is drawn over its estimate, so that all share one axis.
    """
    fitted = [r for r in found.residuals if r.fitted]
    rows = min(len(fitted), MOST_NAMED)
    count = len(found.estimates)
    height = 2.6 + 0.32 * count + (1.0 + 0.2 * rows if len(fitted) <= MOST_NAMED else 2.6)
    made = figure(10.0, height, found.title)
    below = 1.0 + 0.2 * rows if len(fitted) <= MOST_NAMED else 2.6
    halves: Any = made.subfigures(2, 1, height_ratios=(height - below, below))
    upper, lower = halves
    left, right = upper.subplots(1, 2, width_ratios=(3, 2))
    _draw_estimates(upper, left, found)
    _draw_correlations(upper, right, found)
    axes = lower.subplots(1, 1)
    (_draw_bars if len(fitted) <= MOST_NAMED else _draw_points)(axes, fitted, found)
    return made


def _short(path: str) -> str:
    """The number's own name, with its section where that is not all of them, or its effect."""
    part, _, name = path.rpartition(".")
    if part.startswith("effects."):
        return path.removeprefix("effects.").replace(".", " ")
    return f"{name}, {part.replace('sections[', 'section ').rstrip(']')}" if "[" in part else name


def _draw_estimates(made: Any, axes: Axes, found: Calibration) -> None:
    """One row a parameter; 1 is its estimate, or its prior's mean where that is zero."""
    from matplotlib.ticker import LogLocator, NullFormatter

    rows = found.estimates
    spans = []
    for y, e in enumerate(rows):
        size = abs(e.estimate) or abs(e.start) or (e.prior[1] if e.prior else 1.0)
        shift = 0.0 if e.estimate else 1.0  # a zero is drawn where the others have their estimate
        spans += _draw_one(axes, y, e, size, shift)
    finite = np.array([s for s in spans if np.isfinite(s)] or [1.0])
    away = max(float(np.abs(finite - 1).max()), 1e-4)
    if away < 0.8:
        axes.set_xlim(1 - 1.15 * away, 1 + 1.15 * away)
    else:  # what is wide is so by factors; the ends of a band may lie beyond
        factor = min(1.3 * max(finite.max(), 1 / max(finite.min(), 0.05)), 20.0)
        axes.set_xscale("log")
        axes.set_xlim(1 / factor, factor)
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(range(len(rows)), [_name(e) for e in rows])
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.axvline(1.0, color=INK, linewidth=0.8, zorder=0)
    axes.grid(False, axis="y")
    label(axes, "over the estimate", "", "estimates with 95 % intervals")
    handles: list[Any] = [
        axes.errorbar([], [], xerr=[], color=FOUND, fmt="o", capsize=3, label="estimate"),
        axes.plot([], [], "d", color=START, markersize=5, label="start")[0],
    ]
    if any(e.prior for e in rows):
        handles += axes.plot([], [], color=PRIOR, linewidth=6, alpha=0.4, label="prior ± 1.96 sd")
    made.legend(handles=handles, loc="outside lower left", ncols=3)


def _name(e: Estimate) -> str:
    value = f"{e.estimate:.4g} {e.unit}".rstrip()
    note = f" (at its {e.bound} bound)" if e.bound else "" if e.determined else " (not by data)"
    return f"{_short(e.path)}\n{value}{note}"


def _draw_one(axes: Axes, y: int, e: Estimate, size: float, shift: float) -> list[float]:
    """Draw one parameter; returns the places that should be seen."""
    places = [e.start / size + shift]
    if e.prior:
        mean, deviation = e.prior
        band = np.array([mean - 1.96 * deviation, mean + 1.96 * deviation])
        if e.log:
            band = mean * np.exp(np.array([-1.96, 1.96]) * deviation / mean)
        band = np.clip(band, e.low, e.high) / size + shift
        axes.plot(band, [y, y], color=PRIOR, linewidth=6, alpha=0.4, solid_capstyle="butt")
        places += band.tolist()
    if np.isfinite(e.low95) and np.isfinite(e.high95):
        ends = np.array([e.low95, e.high95]) / size + shift
        at = e.estimate / size + shift
        error = np.abs(ends - at)[:, None]
        axes.errorbar([at], [y], xerr=error, fmt="o", color=FOUND, capsize=3, zorder=3)
        places += ends.tolist()
    else:
        colour = ALARM if e.bound else FOUND
        axes.plot([e.estimate / size + shift], [y], "s", color=colour, markersize=5, zorder=3)
    axes.plot([e.start / size + shift], [y], "d", color=START, markersize=5, zorder=4)
    return places


def _draw_correlations(made: Any, axes: Axes, found: Calibration) -> None:
    names = [_short(e.path) for e in found.estimates]
    picture = axes.imshow(found.correlation, cmap="RdBu_r", vmin=-1, vmax=1, aspect="auto")
    axes.set_facecolor("#E8E8E8")
    axes.set_xticks(range(len(names)), names, rotation=40, ha="right", rotation_mode="anchor")
    axes.set_yticks([])
    axes.grid(False)
    for i, j in np.argwhere(np.isfinite(found.correlation)):
        value = found.correlation[i, j]
        colour = "white" if abs(value) > 0.6 else INK
        if i != j:
            axes.text(j, i, f"{value:.2f}", ha="center", va="center", color=colour, fontsize=7)
    made.colorbar(picture, ax=axes, shrink=0.8)
    label(axes, "", "", "correlation of the estimates")


def _draw_bars(axes: Axes, fitted: list[Any], found: Calibration) -> None:
    order = sorted(fitted, key=lambda r: -abs(r.residual))
    values = [r.residual for r in order]
    axes.barh(range(len(order)), values, color=COLOURS[5], zorder=2)
    names = [
        r.name if len(r.name) <= NAME_LENGTH else r.name[: NAME_LENGTH - 1] + "…" for r in order
    ]
    axes.set_yticks(range(len(order)), names)
    axes.set_ylim(len(order) - 0.4, -0.6)
    axes.grid(False, axis="y")
    _sigma_lines(axes.axvline)
    reach = max(2.6, 1.1 * max(map(abs, values)))
    axes.set_xlim(-reach, reach)
    label(axes, "residual (shown − measured) in sigmas", "", _headline(found))


def _draw_points(axes: Axes, fitted: list[Any], found: Calibration) -> None:
    values = np.array([r.residual for r in fitted])
    axes.plot(range(1, len(values) + 1), values, ".", color=FOUND, markersize=4)
    _sigma_lines(axes.axhline)
    reach = max(2.6, 1.1 * float(np.abs(values).max()))
    axes.set_ylim(-reach, reach)
    label(axes, "number of the value", "residual in sigmas", _headline(found))


def _sigma_lines(line: Any) -> None:
    line(0.0, color=INK, linewidth=0.8)
    for side in (-1.96, 1.96):
        line(side, color=ALARM, linewidth=0.8, linestyle=(0, (4, 3)))


def _headline(found: Calibration) -> str:
    freedom = f"{found.freedom:.1f}".removesuffix(".0")
    return f"residuals: χ² = {found.chi2:.3g} with {freedom} degrees of freedom"
