"""Figs 10 to 12 of the paper from our model: the arm at rest, and where a motion ends."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.study.paper_readings import AS_READ, OURS
from softmpc.study.reproduce_statics import REST_TORQUES
from softmpc.view.arm import FRONT, Arm, box_of, draw_base, draw_tube, space
from softmpc.view.paper_planes import COARSE, base_plate, draw_band, draw_shape, frame_plane, key
from softmpc.view.style import INK, colour, figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softmpc.study.paper_readings import PaperRuns

__all__ = ["final_pose_figure", "rest_postures_figure", "rest_shapes_figure"]

UNITS = (4, 1)  # rows of Fig. 10, panels of Fig. 11
NAMES = {OURS: "our model", AS_READ: "the paper's formulation, as read"}
Lines = list[np.ndarray]


@styled
def rest_postures_figure(runs: PaperRuns, title: str) -> Figure:
    """One picture a torque, as the photographs of Fig. 10."""
    made = figure(10.5, 6.0, title)
    arm, shapes = Arm(runs.model(OURS)), _rests(runs, OURS)
    boxes = [
        box_of(*[line for torque in REST_TORQUES for line in shapes[unit, torque]],
               margin=1.4 * max(arm.radii))
        for unit in UNITS
    ]  # fmt: skip
    low, high = np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]
    panels = made.subplots(len(UNITS), len(REST_TORQUES), sharex=True, sharey=True)
    for line, unit in zip(panels, UNITS, strict=True):
        for axes, torque in zip(line, REST_TORQUES, strict=True):
            draw_band(axes, shapes[unit, torque], arm.radii)
            frame_plane(axes, arm, np.array([low, high]), f"unit {unit}, {torque:g} N·m")
            axes.label_outer()
    made.legend(*_sections(arm), loc="outside lower center", ncols=2)
    return made


@styled
def rest_shapes_figure(runs: PaperRuns, title: str) -> Figure:
    """All torques in one picture a unit, as Fig. 11, with the paper's formulation."""
    made = figure(9.0, 5.0, title)
    arm = Arm(runs.model(OURS))
    shapes = {reading: _rests(runs, reading) for reading in (OURS, AS_READ)}
    panels = made.subplots(1, len(UNITS), width_ratios=(0.7, 1.0))
    for axes, unit, part in zip(panels, UNITS, "ab", strict=True):
        here = {r: [of[unit, torque] for torque in REST_TORQUES] for r, of in shapes.items()}
        lines = [line for of in here.values() for shape in of for line in shape]
        box = box_of(base_plate(arm), *lines, margin=1.2 * max(arm.radii))
        for shape, torque in zip(here[OURS], REST_TORQUES, strict=True):
            draw_shape(axes, shape, linewidth=2.2)
            _name_tip(axes, shape, f"{torque:g}")
        for shape in here[AS_READ]:
            draw_shape(axes, shape, **COARSE)
        section = 2 if unit == 4 else 1
        text = f"({part}) torque (N·m) on unit {unit}, in section {section}"
        frame_plane(axes, arm, box, text)
    made.legend(*_sections(arm, NAMES), loc="outside lower center", ncols=4)
    return made


@styled
def final_pose_figure(runs: PaperRuns, title: str) -> Figure:
    """Where the steps on 4, then 1 end, as Fig. 12, in space and beside the paper's formulation."""
    made = figure(8.0, 5.0, title)
    motions = runs.motions("fig13", (OURS, AS_READ))
    arms = {reading: Arm(runs.model(reading)) for reading in motions}
    shapes = {r: arms[r].sections(motion.q[-1]) for r, motion in motions.items()}
    arm = Arm(runs.model(OURS))
    lines = [line for of in shapes.values() for line in of]
    box = box_of(base_plate(arm), *lines, margin=1.2 * max(arm.radii))
    grid = made.add_gridspec(1, 3, width_ratios=(1.2, 0.1, 1.0))
    room = space(made, grid[0], box, arm.hangs, FRONT, 1.0)
    draw_base(room, 1.8 * max(arm.radii))
    plane = made.add_subplot(grid[2])
    if OURS in shapes:
        draw_tube(room, shapes[OURS], arm.radii)
        draw_band(plane, shapes[OURS], arm.radii, alpha=0.35)
        draw_shape(plane, shapes[OURS], linewidth=2.2)
    if AS_READ in shapes:
        draw_shape(plane, shapes[AS_READ], **COARSE)
    frame_plane(plane, arm, box, "in the plane xz")
    made.legend(*_sections(arm, NAMES), loc="outside lower center", ncols=4)
    return made


def _rests(runs: PaperRuns, reading: str) -> dict[tuple[int, float], Lines]:
    """Centre lines by unit and torque."""
    arm = Arm(runs.model(reading))
    return {
        (unit, torque): arm.sections(runs.rest(reading, {unit: torque}).q)
        for unit in UNITS
        for torque in REST_TORQUES
    }


def _name_tip(axes: Any, shape: Lines, text: str) -> None:
    """A torque beyond the tip, in its direction."""
    end, before = shape[-1][-1, [0, 2]], shape[-1][-3, [0, 2]]
    ahead = (end - before) / np.linalg.norm(end - before)
    axes.plot(*end, "o", color=INK, markersize=3, zorder=3)
    axes.text(*(end + 0.02 * ahead), text, fontsize=8, ha="center", va="center")


def _sections(arm: Arm, names: dict[str, str] | None = None) -> tuple[list[Any], list[str]]:
    """Colours of the sections, and line styles of the readings."""
    return key(
        *(
            (f"section {s + 1}", {"color": colour(s), "linewidth": 4.0})
            for s in range(len(arm.radii))
        ),
        *(
            (name, {"color": INK, **(COARSE if reading == AS_READ else {})})
            for reading, name in (names or {}).items()
        ),
    )
