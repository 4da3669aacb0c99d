"""Figs 6 to 8, 13 and 14 of the paper from our model, with the paper's formulation beside it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.simulation.compare import compare
from softmpc.study.paper_readings import AS_READ, FINE, OURS
from softmpc.study.reproduce_motions import curvature
from softmpc.view.arm import Arm, box_of
from softmpc.view.paper_planes import COARSE, base_plate, draw_band, draw_shape, frame_plane, key
from softmpc.view.style import INK, colour, figure, label, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from softmpc.simulation.result import Simulation
    from softmpc.study.paper_readings import PaperRuns

__all__ = ["coordinates_figure", "trajectory_figure"]

SECTIONS = (1, 2)
GHOSTS = (0.0, 0.25, 0.5, 0.75)  # of the way of the tip
TIME = "time (s)"


@styled
def trajectory_figure(name: str, runs: PaperRuns, title: str) -> Figure:
    """Trajectory, curvatures and speeds, as in Figs 6, 7 and 8."""
    made = figure(10.5, 4.8, title)
    motions = runs.motions(name, (OURS, AS_READ))
    grid = made.add_gridspec(2, 2, width_ratios=(1.0, 1.5))
    _draw_trajectory(made.add_subplot(grid[:, 0]), runs, motions)
    bending, speed = (made.add_subplot(grid[row, 1]) for row in (0, 1))
    _draw_curvatures(bending, motions)
    for reading, motion in motions.items():
        for s, speeds in enumerate(motion.tip_speeds.T):
            speed.plot(motion.time, speeds, **_look(s, reading))
    speed.set_ylim(bottom=0.0)
    label(speed, TIME, "speed (m/s)", "(c) speeds of the section tips")
    for axes in (bending, speed):
        axes.margins(x=0.01)
    made.align_ylabels([bending, speed])
    made.legend(*_keys(motions), loc="outside lower center", ncols=4)
    return made


@styled
def coordinates_figure(name: str, runs: PaperRuns, title: str) -> Figure:
    """Coordinates of the section tips over time, as in Figs 13 and 14, and curvatures.

    The paper shows distances from the rig; here they are from our model with 4 segments.
    """
    made = figure(10.5, 5.8, title)
    motions = runs.motions(name, (OURS, AS_READ))
    (across, down), (bending, apart) = made.subplots(2, 2, sharex=True)
    for axes, axis, title_ in (
        (across, 0, "(a) section tips, x"),
        (down, 2, "(b) section tips, z"),
    ):
        for reading, motion in motions.items():
            for s in range(len(SECTIONS)):
                axes.plot(motion.time, motion.tips[:, s, axis], **_look(s, reading))
        label(axes, TIME, f"{'xyz'[axis]} (m)", title_)
    _draw_curvatures(bending, motions, "(c) curvatures, mean of a section")
    _draw_distances(apart, runs, name, motions)
    for axes in (across, down, bending, apart):
        axes.margins(x=0.01)
        axes.tick_params(labelbottom=True)
    made.align_ylabels()
    made.legend(*_keys(motions), loc="outside lower center", ncols=4)
    return made


def _look(section: int, reading: str) -> dict[str, Any]:
    coarse = COARSE if reading == AS_READ else {"linewidth": 1.8 - 0.5 * section}
    return {"color": colour(section), **coarse}


def _keys(motions: dict[str, Simulation]) -> tuple[list[Any], list[str]]:
    """Colour for the section, dashes for the formulation."""
    names = {OURS: "our model", AS_READ: "the paper's formulation, as read"}
    return key(
        *((f"section {s}", {"color": colour(s - 1), "linewidth": 4.0}) for s in SECTIONS),
        *(
            (names[reading], {"color": INK, **(COARSE if reading == AS_READ else {})})
            for reading in motions
        ),
    )


def _draw_trajectory(axes: Axes, runs: PaperRuns, motions: dict[str, Simulation]) -> None:
    """Our arm where it ends and where it was, and the ways of the section tips."""
    shapes, tips = {}, [motion.tips for motion in motions.values()]
    for reading, motion in motions.items():
        arm = Arm(runs.model(reading))
        moments = _moments(motion) if reading == OURS else [-1]
        shapes[reading] = [arm.sections(motion.q[k]) for k in moments]
    arm = Arm(runs.model(OURS))
    lines = [line for of in shapes.values() for shape in of for line in shape]
    box = box_of(base_plate(arm), *lines, *tips, margin=1.2 * max(arm.radii))
    for shape in shapes.get(OURS, [])[:-1]:
        draw_shape(axes, shape, alpha=0.4)
    for shape in shapes.get(OURS, [])[-1:]:
        draw_band(axes, shape, arm.radii, alpha=0.35)
        draw_shape(axes, shape, linewidth=2.2)
    for shape in shapes.get(AS_READ, []):
        draw_shape(axes, shape, **COARSE)
    for reading, motion in motions.items():
        for s in range(len(SECTIONS)):
            way = {"linewidth": 0.8, "color": INK}
            axes.plot(
                motion.tips[:, s, 0],
                motion.tips[:, s, 2],
                **{**way, **({"linestyle": COARSE["linestyle"]} if reading == AS_READ else {})},
            )
    frame_plane(axes, arm, box, "(a) trajectory: ways of the section tips")


def _moments(motion: Simulation) -> list[int]:
    """Samples between which the tip has gone equally far, and the last one."""
    steps = np.linalg.norm(np.diff(motion.tips[:, -1], axis=0), axis=1)
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    return [*(int(np.searchsorted(gone, share * gone[-1])) for share in GHOSTS), -1]


def _draw_curvatures(
    axes: Axes, motions: dict[str, Simulation], title: str = "(b) curvatures"
) -> None:
    for reading, motion in motions.items():
        for section in SECTIONS:
            axes.plot(motion.time, curvature(motion, section), **_look(section - 1, reading))
    label(axes, TIME, "κy (1/m)", title)


def _draw_distances(axes: Axes, runs: PaperRuns, name: str, motions: dict[str, Simulation]) -> None:
    reference = runs.motion(name, FINE)
    if not isinstance(reference, str):
        for reading, motion in motions.items():
            gaps = compare(motion, reference)
            for s, gap in enumerate(gaps.errors.T):
                axes.plot(gaps.time, 1e3 * gap, **_look(s, reading))
    axes.set_ylim(bottom=0.0)
    label(axes, TIME, "ERR (mm)", "(d) distance from our model with 4 segments")
