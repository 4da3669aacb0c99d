"""Axes in space: ticks, names that stay in the picture, lines without corners."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.inputs import InputProfile, Step
from softmpc.simulation.run import simulate
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position
from softmpc.view.arm import even_ticks, smooth, space
from softmpc.view.inverse import batch_figure
from softmpc.view.motion import motion_figure
from softmpc.view.style import figure


def box(*size: float) -> np.ndarray:
    return np.array([-0.5 * np.array(size), 0.5 * np.array(size)])


def numbers(axis: Any) -> list[float]:
    return [round(float(tick), 9) for tick in axis.get_ticklocs()]


def test_narrow_sides_have_more_than_one_tick() -> None:
    axes: Any = space(figure(5, 5), 111, box(0.33, 0.33, 0.82), hangs=False)
    assert numbers(axes.xaxis) == [-0.1, 0.0, 0.1]
    steps = np.diff(numbers(axes.zaxis))
    assert steps == pytest.approx(np.full(len(steps), 0.1))
    tiny: Any = space(figure(5, 5), 111, box(0.01, 0.01, 0.025), hangs=False)
    assert numbers(tiny.xaxis) == [0.0]  # for more, the numbers are too long


def test_long_numbers_do_not_touch() -> None:
    axes: Any = figure(3.0, 3.0).add_subplot()
    small = box(0.07, 0.07, 0.07)
    axes.set_xlim(*small[:, 0])
    even_ticks(axes.xaxis, small[:, 0], small)
    axes.figure.draw_without_rendering()
    shown = [text.get_window_extent() for text in axes.get_xticklabels()]
    assert len(shown) > 1
    assert all(one.x1 < following.x0 for one, following in pairwise(shown))


def test_the_legend_of_a_motion_is_off_its_axes_names() -> None:
    arm = chen2022()
    model = build(Scene(replace(arm, sections=(*arm.sections, arm.sections[0]))))
    motion = simulate(model, InputProfile.of(9, [Step(1, 0.0, 1.0)]), 0.02)
    made = motion_figure(model, motion)
    made.draw_without_rendering()
    legend = made.legends[0].get_window_extent()
    axes: Any = made.axes[0]
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        assert not axis.label.get_window_extent().overlaps(legend)


def test_the_name_of_z_stands_beside_its_numbers() -> None:
    made = figure(5, 5)
    axes: Any = space(made, 111, box(0.02, 0.02, 0.025), hangs=False)
    made.draw_without_rendering()
    name = axes.zaxis.label.get_window_extent()
    ticks = [text.get_window_extent() for text in axes.zaxis.get_ticklabels()]
    assert not any(name.overlaps(tick) for tick in ticks)


def test_names_of_a_tall_picture_are_in_it_and_off_the_legend() -> None:
    model = build(Scene(chen2022(), effects=()))
    found = [InverseStatics(model).solve(Position((0.2, 0.1, 0.5)))]
    made = batch_figure(model, found)
    made.draw_without_rendering()
    legend = made.legends[0].get_window_extent()
    axes: Any = made.axes[0]
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        name = axis.label.get_window_extent()
        assert made.bbox.contains(name.x0, name.y0) and made.bbox.contains(name.x1, name.y1)
        assert not name.overlaps(legend)


def test_a_smooth_line_is_the_arc() -> None:
    angle = np.linspace(0, np.pi, 11)
    line = smooth(np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1))
    assert len(line) > 50
    assert np.hypot(line[:, 0], line[:, 2]) == pytest.approx(np.ones(len(line)), abs=1e-3)
