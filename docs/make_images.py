"""Make the pictures of the conventions page: `python docs/make_images.py [FOLDER]`."""

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from softmpc import Manipulator, Model, Scene, build, chen2022, find_equilibrium

PAGE = Path(__file__).parent / "images"
COLORS = ("#0072b2", "#d55e00")  # section 1, section 2
INK, PALE = "#333333", "#b0b0b0"
PRESSURE = 0.6e6
HANG = np.diag((1.0, -1.0, -1.0))  # base frame to matplotlib's, where z is up; a rotation
STYLE = {
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.edgecolor": INK,
    "text.color": INK,
    "axes.labelcolor": INK,
    "savefig.dpi": 160,
}


def main() -> None:
    """Write the pictures to a folder, by default docs/images."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else PAGE
    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        for name, draw in (("frame", draw_frame), ("units", draw_units), ("strains", draw_strains)):
            figure = draw()
            figure.savefig(folder / f"{name}.png", bbox_inches="tight")
            plt.close(figure)
            print(folder / f"{name}.png")


def draw_frame() -> plt.Figure:
    """The hanging arm from the side, bent by one unit: base frame, frames of the ends, gravity."""
    model = build(Scene(chen2022(), segments=2))
    figure, axes = plt.subplots(1, 2, figsize=(8.6, 5.0), sharey=True)
    for ax, unit in zip(axes, (1, 4), strict=True):
        _side_view(ax, model, {}, faded=True)
        _side_view(ax, model, {unit: PRESSURE})
        _base_frame(ax)
        ax.set_title(f"unit {unit} at {PRESSURE / 1e6:g} MPa")
        ax.set(xlim=(-0.42, 0.46), ylim=(0.58, -0.08), aspect="equal")
        ax.axis("off")
    axes[0].text(0.245, 0.33, "gravity g", ha="left", va="center", style="italic")
    _arrow(axes[0], (0.22, 0.27), (0.22, 0.39), INK)
    _lengths(axes[1], model)
    return figure


def _lengths(ax: Axes, model: Model) -> None:
    """Dimension lines of the sections at rest, beside the arm."""
    ends, x = [0.0], 0.27
    for length in (section.length for section in model.scene.manipulator.sections):
        ends.append(ends[-1] + length)
    for number, (top, bottom) in enumerate(pairwise(ends), 1):
        ax.annotate(
            "", (x, bottom), (x, top),
            arrowprops={"arrowstyle": "<|-|>", "color": INK, "lw": 1, "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
        said = f"section {number}\n{bottom - top:g} m at rest"
        ax.text(x + 0.015, (top + bottom) / 2, said, ha="left", va="center", fontsize=9)


def _side_view(ax: Axes, model: Model, given: dict[int, float], faded: bool = False) -> None:
    pressures = np.array([given.get(unit + 1, 0.0) for unit in range(6)])
    at_rest = find_equilibrium(model, pressures)
    points = np.asarray(model.centerline(at_rest.q))
    half = points.shape[1] // 2
    for section, piece in enumerate((points[:, : half + 1], points[:, half:])):
        color = PALE if faded else COLORS[section]
        ax.plot(piece[0], piece[2], color=color, lw=2 if faded else 5, solid_capstyle="butt")
    if not faded:
        for section, name in enumerate(("end of section 1", "tip")):
            _end_frame(ax, model, at_rest.q, section, name)


def _end_frame(ax: Axes, model: Model, q: object, section: int, name: str) -> None:
    """Axes x and z of the frame at the end of a section (y stays out of the page), and its name."""
    tips, rotations = (np.asarray(found) for found in model.frames(q))
    tip, turn = tips[:, section], rotations[:, 3 * section : 3 * section + 3]
    color = COLORS[section]
    x, z = turn[:, 0], turn[:, 2]
    for letter, along, at in (("x", x, 0.098 * x), ("z", z, 0.075 * z - 0.024 * x)):
        _arrow(ax, tip[[0, 2]], (tip + 0.075 * along)[[0, 2]], color)
        ax.text(*(tip + at)[[0, 2]], letter, color=color, ha="center", va="center")
    ax.plot(tip[0], tip[2], "o", color="white", mec=color, mew=2, ms=8, zorder=5)
    ax.plot(tip[0], tip[2], ".", color=color, ms=4, zorder=6)
    beside = tip - 0.03 * x
    ax.text(beside[0], beside[2], name, color=color, ha="right", va="center")


def _base_frame(ax: Axes) -> None:
    ax.plot([-0.07, 0.07], [0, 0], color=INK, lw=4, solid_capstyle="butt")
    ax.text(-0.09, 0.0, "base", ha="right", va="center")
    _arrow(ax, (0, 0), (0.13, 0), INK)
    _arrow(ax, (0, 0), (0, 0.13), INK)
    ax.text(0.14, 0.0, "x", va="center")
    ax.text(0.012, 0.125, "z", va="center")
    ax.plot(0, 0, "o", color="white", mec=INK, mew=1.4, ms=9)
    ax.plot(0, 0, ".", color=INK, ms=4)
    ax.text(0.012, -0.035, "y (out of the page)", va="center")


def draw_units() -> plt.Figure:
    """Cross-sections of both sections, with the number and pull of each unit."""
    arm = chen2022()
    figure, axes = plt.subplots(1, 2, figsize=(7.6, 4.2))
    first = 1
    for ax, (s, section) in zip(axes, enumerate(arm.sections), strict=True):
        ax.set_title(f"section {s + 1}")
        ax.add_patch(Circle((0, 0), 32.3, fill=False, color=PALE))
        for unit, (x, y) in enumerate(section.unit_positions, start=first):
            x, y = 1e3 * x, 1e3 * y
            ax.add_patch(Circle((x, y), 15.0, fill=False, color=COLORS[s], lw=1.6))
            ax.text(x, y, str(unit), ha="center", va="center", fontsize=15, color=COLORS[s])
            angle = np.degrees(np.arctan2(y, x)) % 360
            beyond = 42 * np.array((x, y)) / np.hypot(x, y)
            ax.text(*beyond, f"{angle:.0f}°", ha="center", va="center", color=INK)
            away = -np.array((x, y)) / np.hypot(x, y)
            _arrow(ax, 34 * away, 50 * away, COLORS[s])
            ax.text(*(56 * away), f"$P_{unit}$", ha="center", va="center", color=COLORS[s])
        _section_axes(ax, np.array((-64.0, -50.0)))
        first += section.units
        ax.set(xlim=(-72, 62), ylim=(-58, 58), aspect="equal")
        ax.axis("off")
    return figure


def _section_axes(ax: Axes, at: np.ndarray) -> None:
    for name, along in (("x", (1, 0)), ("y", (0, 1))):
        _arrow(ax, at, at + 14 * np.array(along), INK)
        ax.text(*(at + 17 * np.array(along)), name, ha="center", va="center")
    ax.plot(*at, "o", color="white", mec=INK, ms=8)
    ax.plot(*at, ".", color=INK, ms=4)
    ax.text(*(at - (0, 6)), "z", ha="center", va="center")


def draw_strains() -> plt.Figure:
    """What one segment does for a positive value of each strain."""
    one = _one_section()
    model = build(Scene(one, effects=()))
    figure = plt.figure(figsize=(8.4, 3.2))
    cases = (("ε = 0.3", 0, 0.3), ("kx = 4 1/m", 1, 4.0), ("ky = 4 1/m", 2, 4.0),
             ("kz = 8 1/m", 3, 8.0))  # fmt: skip
    for place, (title, strain, value) in enumerate(cases, start=1):
        ax = figure.add_subplot(1, 4, place, projection="3d")
        q = np.zeros(4)
        _prism(ax, model, q, PALE, 0.8)
        q[strain] = value
        _prism(ax, model, q, COLORS[0], 1.4)
        ax.set_title(title, y=1.02)
        ax.view_init(elev=20, azim=-60)
        ax.set(xlim=(-0.1, 0.1), ylim=(-0.1, 0.1), zlim=(-0.34, 0.02))
        ax.set_box_aspect((1, 1, 1.8), zoom=1.2)
        for name, end in (("x", (0.1, 0, 0)), ("y", (0, 0.1, 0)), ("z", (0, 0, 0.1))):
            ax.plot(*HANG @ np.transpose([(0, 0, 0), end]), color=INK, lw=1)
            beside = (-0.035, 0, 0.1) if name == "z" else 1.25 * np.array(end)
            ax.text(*(HANG @ beside), name, ha="center", va="center", fontsize=8)
        ax.axis("off")
    figure.subplots_adjust(left=0, right=1, bottom=0, top=0.86, wspace=0)
    return figure


def _one_section() -> Manipulator:
    arm = chen2022()
    return replace(arm, name="one section", sections=arm.sections[:1])


def _prism(ax: Axes, model: Model, q: np.ndarray, color: str, width: float) -> None:
    """The axis of a section, its three units and its ends."""
    section = model.scene.manipulator.sections[0]
    rings = []
    for share in np.linspace(0, 1, 21):
        shorter = replace(section, length=max(share, 1e-2) * section.length)
        part = build(model.scene.with_(manipulator=_of(shorter)))
        tips, rotations = (np.asarray(x) for x in part.frames(q))
        rings.append([tips[:, 0] + rotations @ (x, y, 0) for x, y in section.unit_positions])
    lines = np.array(rings)
    for unit in range(section.units):
        ax.plot(*HANG @ lines[:, unit].T, color=color, lw=width)
    for ring in (lines[0], lines[-1]):
        ax.plot(*HANG @ np.vstack([ring, ring[:1]]).T, color=color, lw=width)


def _of(section: object) -> Manipulator:
    return replace(_one_section(), sections=(section,))


def _arrow(ax: Axes, start: object, end: object, color: str) -> None:
    ax.annotate(
        "", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.6, "shrinkA": 0}
    )


if __name__ == "__main__":
    main()
