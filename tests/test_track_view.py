"""The picture of a closed loop partly out of reach: readable, and true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softmpc.control.track_result import TrackResult
from softmpc.model.actuation import PressureDrive
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.view.control import control_figure
from softmpc.view.tracking import tracking_figure

STATUSES = ("failed: QP infeasible: dT_1 in interval 1", "budget overrun", "iteration cap")


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


def run_of(model: Model, bend: float) -> TrackResult:
    """A made-up run of an arm that bends a lot, or little; its path is out of reach for a while."""
    time = np.linspace(0.0, 4.0, 401)
    q = np.zeros((len(time), model.strains))
    q[:, [0, 4]] = 0.5
    q[:, 2] = bend + 0.1 * np.cos(2 * time)
    q[:, 1] = 0.1 * np.sin(2 * time)
    tips = np.stack([np.asarray(model.frames(one)[0]).T for one in q])
    far = np.where((time > 1.2) & (time < 2.0), 0.02, 0.0)
    reference = tips[:, -1] + far[:, None] * np.array([1.0, 0, 0])
    control = time[:-1:4]
    layout = model.layout
    statuses = ["solved"] * len(control)
    statuses[30:33] = STATUSES
    return TrackResult(
        title="Made up", status="finished", settle=1.0, time=time, tips=tips,
        reference=reference, q=q, dq=0 * q, p=np.full((len(time), 6), 3e5), control_time=control,
        u=np.full((len(control), 6), 0.8), step_ms=np.full(len(control), 9.0),
        iterations=np.ones(len(control), int), statuses=statuses,
        names=(layout.q.names, layout.u.names, layout.p.names),
        followed=tips[:, -1] + 1e-4, out_of_reach=far, jumps=np.array([1.6]),
    )  # fmt: skip


@pytest.mark.sampled
@pytest.mark.parametrize("bend", [3.0, 0.2], ids=["sideways", "hanging"])
def test_space_stays_in_its_half(model: Model, bend: float) -> None:
    """The name of its upright axis once lay on that of the torques; the tip stays in its box."""
    result = run_of(model, bend)
    made = tracking_figure(model, result)
    made.canvas.draw()
    space = next(axes for axes in made.axes if hasattr(axes, "zaxis"))
    names = [axis.label.get_window_extent() for axis in (space.xaxis, space.yaxis, space.zaxis)]
    others = [
        text.get_window_extent()
        for axes in made.axes
        if axes is not space
        for text in (axes.yaxis.label, *axes.get_yticklabels())
    ]
    assert not any(name.overlaps(other) for name in names for other in others)
    for low_high, column in zip(
        (space.get_xlim(), space.get_ylim(), space.get_zlim()), result.tip.T, strict=True
    ):
        assert min(low_high) <= column.min() and column.max() <= max(low_high)


def test_what_is_out_of_reach_is_in_the_legends(model: Model) -> None:
    result = run_of(model, 3.0)
    made = tracking_figure(model, result)
    said = {text.get_text() for one in made.findobj(_is_legend) for text in one.get_texts()}
    assert {"reference", "nearest in reach", "tip", "path out of reach", "limits"} <= said
    inside = replace(result, followed=result.reference, out_of_reach=0 * result.time)
    plain = tracking_figure(model, inside)
    said = {text.get_text() for one in plain.findobj(_is_legend) for text in one.get_texts()}
    assert "nearest in reach" not in said and "path out of reach" not in said


def test_the_plate_is_whole_and_takes_no_room(model: Model) -> None:
    """As tall as the arm's box is, it once stuck out of the axes; the layout must not see it."""
    huge = replace(run_of(model, 3.0), tips=10 * run_of(model, 3.0).tips)
    for result in (run_of(model, 0.2), huge):
        made = tracking_figure(model, result)
        made.draw_without_rendering()  # warns where nothing fits
        space = next(axes for axes in made.axes if hasattr(axes, "zaxis"))
        plate = space.collections[0]
        assert not plate.get_clip_on() and not plate.get_in_layout()


def test_titles_stay_in_the_picture(model: Model) -> None:
    made = tracking_figure(model, run_of(model, 3.0))
    made.canvas.draw()
    for axes in made.axes:
        for title in (axes.title, axes._left_title):
            assert title.get_window_extent().x1 <= made.bbox.x1


def test_units_are_named_where_pressures_are_the_input(model: Model) -> None:
    """matplotlib warned of a legend without names."""
    driven = build(Scene(chen2022(), actuation=PressureDrive()))
    made = control_figure(driven, run_of(model, 3.0))
    named = [axes for axes in made.axes if axes.get_legend() is not None]
    assert next(axes.get_title(loc="left") for axes in named) == "unit pressures"


def test_steps_that_failed_are_marked_and_counted(model: Model) -> None:
    made = control_figure(model, run_of(model, 3.0))
    last = made.axes[-1]
    assert "97 of 100 steps solved" in last.get_title(loc="left")
    names = {line.get_label() for line in last.lines}
    assert {"failed (1)", "budget overrun (1)", "iteration cap (1)"} <= names


def test_a_summary_has_the_same_keys_whatever_is_in_reach(model: Model) -> None:
    result = run_of(model, 3.0)
    inside = replace(result, followed=result.reference, out_of_reach=None, jumps=None)
    far, near = result.summary(), inside.summary()
    assert list(far) == list(near) and far["jumps_s"] == [1.6] and near["jumps_s"] == []
    assert near["rms_reachable_error_mm"] is None and far["rms_reachable_error_mm"] > 0


def _is_legend(artist: object) -> bool:
    return type(artist).__name__ == "Legend"
