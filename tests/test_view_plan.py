"""Pictures of plans: readable, and true to the motion, its limits and its obstacles."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import PAPER, model_of
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from matplotlib.text import Text
from PIL import Image
from plans import simulated_plan
from scipy.interpolate import CubicSpline

from softmpc.control.limits import PressureLimit, TorqueLimit
from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive
from softmpc.model.model import Model
from softmpc.model.obstacles import Box, Plane, Sphere
from softmpc.model.scene import default_effects
from softmpc.planning.attempt import Found
from softmpc.planning.giving_way import GivesWay
from softmpc.planning.goals import Goal, Start
from softmpc.planning.problem import PlanProblem
from softmpc.planning.replay import Replay
from softmpc.planning.result import (
    FAILED,
    INFEASIBLE,
    NOT_VERIFIED,
    SOLVED,
    Level,
    PlanResult,
    StartReport,
)
from softmpc.statics.targets import Direction, Position
from softmpc.view import animation
from softmpc.view.arm import Arm
from softmpc.view.obstacles import draw_outlines, widened
from softmpc.view.plan import animate_plan, draw_plan, draw_refinement
from softmpc.view.plan_animation import times_slower
from softmpc.view.plan_space import goal_marks
from softmpc.view.plan_time import draw_over_time

BALL = Sphere((0.06, 0.03, 0.5), 0.03)
BLOCK = Box((0.12, -0.12, 0.45), (0.05, 0.05, 0.2), (0.0, 0.0, 30.0))
GOALS = (
    Goal((Position((0.02, 0.03, 0.55)),), rest=False),
    Goal((Position((0.1, None, None)), Direction((0.0, 0.0, 1.0)))),
)
COUNTS, LASTS = (3, 5), np.array([0.06, 0.15])
STARTS = (
    StartReport("straight", SOLVED, 0.21, 0.0, 9, 1.0, won=True),
    StartReport("near above", INFEASIBLE, 0.4, 0.1, 20, 1.0),
    StartReport("near below", FAILED, np.nan, np.inf, 0, 1.0),
)
LEVELS = (
    Level(8, 0.21, 4e-3, -2e-3, 9, 1.0),
    Level(16, 0.20, np.inf, 3e-3, 4, 1.0),
    Level(32, 0.199, 5e-6, 5e-3, 4, 1.0),
)


@pytest.fixture(scope="module")
def model() -> Model:
    return model_of(PAPER, effects=default_effects())


def found_of(t: np.ndarray, counts: tuple[int, ...], u: np.ndarray, x: np.ndarray) -> Found:
    """Nodes and inputs as a planner finds them."""
    ends = np.cumsum(counts)
    return Found(
        t=t, ends=ends, durations=np.diff(t[ends], prepend=0.0), u=u, x=x,
        a=np.zeros((len(u), 1)), cost=float(t[-1]), converged=True, met=True, iterations=9,
    )  # fmt: skip


@pytest.fixture(scope="module")
def swing(model: Model) -> PlanResult:
    """Torques that jump between the limits, simulated."""
    torques = np.zeros((8, 6))
    torques[::2, :3] = 2.5
    torques[:, 3] = 2.5
    t = np.concatenate([[0.0], np.cumsum(np.repeat(LASTS / COUNTS, COUNTS))])
    made = simulated_plan(model, np.full(6, 0.3), t, torques)
    replay = Replay(
        "finished", made["samples_t"], made["samples_x"], made["samples_tips"], made["samples_p"],
        defect=5e-6, misses=(0.0, 0.0), turns=(0.0, 0.0), drift=0.0, clearance={}, beyond={},
    )  # fmt: skip
    found = found_of(t, COUNTS, torques, made["x"])
    start = Start(made["x"][0], made["u_before"])
    problem = PlanProblem(model, start, GOALS, obstacles=(BALL, BLOCK), margin=0.005)
    return PlanResult(problem, SOLVED, STARTS, found, replay, LEVELS, 1e-3, title="Costs 5 $")


@pytest.fixture(scope="module")
def picture(swing: PlanResult) -> Figure:
    return draw_plan(swing)


def made_up(model: Model, goals: int = 1) -> PlanResult:
    """An arm that bends ever more under inputs out of nowhere."""
    k, n = len(model.layout.u), model.strains
    t = np.linspace(0, 0.4, 41)
    x = np.zeros((41, len(model.layout.x)))
    x[:, :n] = np.sin(4 * t)[:, None] * 0.3 * model.layout.q.scale
    tips = np.asarray(model.frames.map(41)(x[:, :n].T)[0]).T.reshape(41, -1, 3)
    u = np.linspace(0, 1, 8)[:, None] * model.layout.u.scale
    p = np.full((41, len(model.layout.p)), 2e5)
    replay = Replay("finished", t, x, tips, p, 0.0, (), (), 0.0, {}, {})
    found = found_of(t[::5], (8 // goals,) * goals, u, x[::5])
    problem = PlanProblem(model, Start(x[0], np.zeros(k)), (Goal(state=x[-1]),) * goals)
    return PlanResult(problem, SOLVED, STARTS[:1], found, replay, LEVELS[:1])


# ---------------------------------------------------------------- readable


def check(made: Figure) -> None:
    """Axes have names with units, letters are large enough, on the page, and on no others."""
    made.canvas.draw()
    for axes in made.axes:
        names = [axes.get_xlabel(), axes.get_ylabel()]
        if hasattr(axes, "get_zlabel"):
            names.append(axes.get_zlabel())
        for name in filter(None, names):
            assert re.fullmatch(r"\S.* \(\S+\)|unit|start|intervals", name), name
        assert len(list(filter(None, names))) >= 2 or axes.get_label() == "<colorbar>"
    shown = list(texts(made))
    assert min(text.get_fontsize() for text in shown) >= 8
    boxes = [(text.get_text(), text.get_window_extent()) for text in shown]
    page = made.bbox
    for text, box in boxes:
        assert page.x0 <= box.x0 and box.x1 <= page.x1, text
        assert page.y0 <= box.y0 and box.y1 <= page.y1, text
    for (one, here), (other, there) in combinations(boxes, 2):
        assert not here.overlaps(there), (one, other)


def texts(made: Figure) -> Iterator[Text]:
    """What is written, apart from ticks and from numbers beside goals."""
    ticks = {
        tick
        for axes in made.axes
        for axis in axes._axis_map.values()
        for tick in axis.get_ticklabels(which="both")
    }
    ticks |= {axis.get_offset_text() for axes in made.axes for axis in axes._axis_map.values()}
    for text in made.findobj(Text):
        words = text.get_text().strip()
        beside = re.fullmatch(r"[ ,\d]+", words)
        if words and text.get_visible() and text not in ticks and not beside:
            yield text


def test_a_plan_is_readable(picture: Figure) -> None:
    made = picture
    check(made)
    assert made.get_suptitle() == r"Costs 5 \$: least time, 0.21 s"
    legends = {text.get_text() for one in made.findobj(is_legend) for text in one.get_texts()}
    assert {"start of the tip", "goal", "obstacle", "limits", "margin 5 mm"} <= legends


def is_legend(artist: Any) -> bool:
    return type(artist).__name__ == "Legend"


@pytest.mark.sampled
@pytest.mark.parametrize(
    "slots",
    [
        {"actuation": PressureDrive(), "strains": ("epsilon", "kappa_y"), "effects": ()},
        {"manipulator": replace(PAPER, sections=PAPER.sections[:1] * 5)},
    ],
    ids=["pressures", "five sections"],
)
def test_other_arms_are_readable(slots: dict[str, Any]) -> None:
    result = made_up(model_of(**slots), goals=2)
    made = draw_plan(result)
    check(made)
    assert len(time_axes(made)) == 3  # none of clearance
    kind = result.problem.model.scene.actuation.input
    assert time_axes(made)[0].get_title(loc="left").startswith(("motor torques", "pressures"))
    said = {one.get_text() for axes in made.axes for one in axes.texts}
    assert {"  1, 2"} == {words for words in said if re.fullmatch(r"[ ,\d]+", words)}
    named = time_axes(made)[1].get_legend_handles_labels()[1]
    assert "limits" in named
    assert (kind == "pressure") == ("MPa" in time_axes(made)[0].get_title(loc="left"))


def time_axes(made: Figure) -> list[Any]:
    return [axes for axes in made.axes if axes.get_xlabel() == "time (s)" and axes.lines]


# ---------------------------------------------------------------- true


def test_inputs_are_steps_between_their_limits(swing: PlanResult, picture: Figure) -> None:
    lanes = time_axes(picture)[0]
    steps = [patch for patch in lanes.patches if isinstance(patch, StepPatch)]
    lines = [patch.get_data() for patch in steps if not patch.get_fill()]
    assert len(lines) == 6
    for j, drawn in enumerate(lines):
        base = 5 - j
        np.testing.assert_allclose(drawn.edges, swing.t)
        np.testing.assert_allclose((drawn.values - base) / 0.78, swing.u[:, j] / 2.5)
    said = [text.get_text() for text in lanes.texts]
    assert said[:3] == ["section 1, at a limit 100 %"] * 3
    bare = replace(swing.problem, limits=(TorqueLimit(-1.0, 2.5), PressureLimit(-np.inf, 9e5)))
    some = replace(swing, problem=bare)
    lanes, pressures, *more = Figure().subplots(4)
    draw_over_time([lanes, pressures, *more], some)
    assert lanes.get_title(loc="left") == "motor torques, each from -1 to 2.5 N·m"
    said = [text.get_text() for text in lanes.texts]
    assert said[0] == "section 1, at a limit 48 %"  # 2 · 0.02 + 2 · 0.03 of 0.21 s
    levels = [line.get_ydata()[0] for line in pressures.lines if line.get_label() == "limits"]
    assert levels == [0.9]


def test_clearance_is_that_of_the_envelope(swing: PlanResult, picture: Figure) -> None:
    """Against the distance of a ball from the centre line; the picture looks every 5 mm."""
    axes = time_axes(picture)[2]
    curve, margin = axes.lines[0], next(x for x in axes.lines if "margin" in x.get_label())
    model, time, room = swing.problem.model, *curve.get_data()
    for k in range(0, len(time), 23):
        q = swing.replay.x[np.abs(swing.replay.t - time[k]).argmin(), : model.strains]
        lines = [CubicSpline(range(len(one)), one) for one in Arm(model).sections(q)]
        fine = np.concatenate([one(np.linspace(*one.x[[0, -1]], 600)) for one in lines])
        gap = np.linalg.norm(fine - BALL.center, axis=1).min() - BALL.radius
        assert room[k] == pytest.approx(1e3 * (gap - PAPER.sections[0].disc_radius), abs=0.2)
    assert margin.get_ydata()[0] == pytest.approx(5.0)
    assert f"sphere 1, least {room.min():.1f} mm" in {x.get_label() for x in axes.lines}


def test_the_tip_and_its_speed(swing: PlanResult, picture: Figure) -> None:
    """The way in space is that of the replay; the speed's integral is its length."""
    space = next(axes for axes in picture.axes if hasattr(axes, "zaxis"))
    tips = swing.replay.tips[:, -1]
    ways = [np.array(one._segments3d) for one in space.collections if hasattr(one, "_segments3d")]
    np.testing.assert_allclose(ways[0][:, 0], tips)
    speed = time_axes(picture)[-1].lines[0].get_ydata()
    length = np.linalg.norm(np.diff(tips, axis=0), axis=1).sum()
    assert (speed * np.diff(swing.replay.t)).sum() == pytest.approx(length)


def test_goals_are_marked_where_and_when_they_are(swing: PlanResult, picture: Figure) -> None:
    first, second = goal_marks(swing)
    np.testing.assert_allclose(first.place, [0.02, 0.03, 0.55])
    np.testing.assert_allclose(second.place, [0.1, *swing.replay.tips[-1, -1, 1:]])
    assert first.axis is None and second.axis == pytest.approx([0.0, 0.0, 1.0])
    for axes in time_axes(picture):
        upright = {x.get_xdata()[0] for x in axes.lines if len(set(x.get_xdata())) == 1}
        assert {0.06, 0.21} <= {round(x, 9) for x in upright}
    above = time_axes(picture)[0].child_axes[0]
    assert [text.get_text() for text in above.get_xticklabels()] == ["goal 1", "goal 2"]
    bend = made_up(swing.problem.model)
    assert goal_marks(bend)[0].place == pytest.approx(bend.replay.tips[-1, -1])


def test_what_gives_way_is_named_at_its_time(swing: PlanResult) -> None:
    wrong = (
        GivesWay("goal 2: position of section tip 2", 0.02, "m", 0.21, 1, 0.04),
        GivesWay("clearance of sphere 1 to section 2 at 50 %", 0.003, "m", 0.205, 2, 0.03),
        GivesWay("p_1", 1e4, "Pa", 0.09, 2, 0.01),
    )
    made = draw_plan(replace(swing, status=INFEASIBLE, gives_way=wrong))
    check(made)
    assert made.get_suptitle().endswith("infeasible")
    said = [text.get_text() for text in made.findobj(Text)]
    assert any(
        x.startswith("gives way\na: goal 2: position") and "c: p_1 by 1e+04" in x for x in said
    )
    above = time_axes(made)[1].child_axes[0]
    assert [text.get_text() for text in above.get_xticklabels()] == ["c", "b, a"]
    assert above.get_xticks() == pytest.approx([0.09, 0.205])


def test_a_replay_that_fails_at_once_is_drawn(swing: PlanResult, tmp_path: Path) -> None:
    whole = swing.replay
    parts = {name: getattr(whole, name)[:1] for name in ("t", "x", "tips", "pressures")}
    short = replace(swing, replay=replace(whole, status="failed", **parts), status=NOT_VERIFIED)
    check(draw_plan(short))
    assert animate_plan(short, tmp_path / "plan.gif")[0].is_file()


def test_without_a_motion_only_the_starts_are_drawn(swing: PlanResult, tmp_path: Path) -> None:
    none = PlanResult(swing.problem, FAILED, STARTS[1:])
    with pytest.raises(InputError, match="no motion"):
        draw_plan(none)
    with pytest.raises(InputError, match="no motion"):
        animate_plan(none, tmp_path / "plan.gif")
    made = draw_refinement(none)
    check(made)
    assert len(made.axes) == 1


def test_refinement(swing: PlanResult) -> None:
    made = draw_refinement(swing)
    check(made)
    starts, cost, defect, clearance = made.axes
    said = [text.get_text() for text in starts.texts]
    assert said == [
        "straight: won, solved", "near above: infeasible", "0.4", "near below: no motion",
    ]  # fmt: skip
    counts = [8, 16, 32]
    np.testing.assert_allclose(cost.lines[0].get_xydata(), np.c_[counts, [0.21, 0.2, 0.199]])
    np.testing.assert_allclose(defect.lines[0].get_ydata(), [4.0, np.nan, 0.005])
    np.testing.assert_allclose(clearance.lines[0].get_ydata(), [-2, 3, 5])
    assert cost.get_title(loc="left") == "cost, last change 0.5 %"
    check(draw_refinement(made_up(swing.problem.model)))


def test_outlines_from_above() -> None:
    """Against the circle, the turned square, and a wall that is seen from its edge."""
    box = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]])

    def outline(obstacle: Any) -> np.ndarray:
        axes = Figure().add_subplot()
        draw_outlines(axes, (obstacle,), box)
        return np.concatenate([*(one.get_xydata() for one in axes.lines), np.zeros((0, 2))])

    ring = outline(Sphere((0.1, 0.0, 0.5), 0.2))
    assert np.hypot(*(ring - [0.1, 0.0]).T) == pytest.approx(0.2, rel=5e-3)
    corners = outline(Box((0.0, 0.0, 0.5), (0.2, 0.2, 0.3), (0.0, 0.0, 45.0)))[:-1]
    assert np.abs(corners).sum(axis=1) == pytest.approx(0.1 * 2**0.5)
    assert len(outline(Plane((0.2, 0.0, 0.0), (1.0, 0.0, 0.0)))) == 0
    assert len(outline(Plane((0.0, 0.0, 0.9), (0.0, 0.0, -1.0)))) == 0  # it covers all


@pytest.mark.parametrize(
    ("obstacle", "low", "high"),
    [
        (Sphere((1.1, 0.5, 0.5), 0.15), (0, 0, 0), (1.2, 1, 1)),  # cut 0.2 away from the box
        (Sphere((3.0, 0.5, 0.5), 0.3), (0, 0, 0), (1, 1, 1)),
        (Box((0.5, 0.5, -0.1), (0.1, 0.1, 0.1)), (0, 0, -0.15), (1, 1, 1)),
        (Plane((0.5, 9.0, 1.1), (0.0, 0.0, -1.0)), (0, 0, 0), (1, 1, 1.1)),
        (Plane((0.5, 9.0, 1.3), (0.0, 0.0, -1.0)), (0, 0, 0), (1, 1, 1)),
    ],
)
def test_pictures_have_room_for_what_is_near(obstacle: Any, low: Any, high: Any) -> None:
    box = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    np.testing.assert_allclose(widened(box, (obstacle,), 0.2), [low, high], atol=2e-3)


# ---------------------------------------------------------------- animation


def test_animation(swing: PlanResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation.shutil, "which", lambda name: None)
    seen: list[tuple[int, int]] = []
    written = animate_plan(
        swing, tmp_path / "plan.gif", slow=5, progress=lambda *done: seen.append(done)
    )
    assert [path.name for path in written] == ["plan.gif"]
    assert seen[-1] == (14, 14)  # 5 · 0.21 s at 0.08 s
    with Image.open(written[0]) as film:
        lasts = []
        for k in range(film.n_frames):  # type: ignore[attr-defined]
            film.seek(k)
            lasts.append(film.info["duration"])
    assert sum(lasts) == pytest.approx(1e3 * (5 * 0.21 + 1.0), abs=100)
    assert max(lasts[:-1]) == 80


def test_paces() -> None:
    assert [times_slower(time) for time in (0.001, 0.146, 0.5, 1.2, 4.0, 60.0)] == [
        50, 30, 10, 5, 1, 1,
    ]  # fmt: skip
    film = animation.Film("Swing $", slow=30)
    assert film.words(0.1234) == "Swing \\$\nt = 0.123 s, 30 times slower"
    assert animation.Film("Swing").words(1.26) == "Swing\nt = 1.3 s"
