"""Simple controllers in C against those in Python, and the table's gains against time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from codegen_line import baseline, line, make, numbers_of, on_make, run, scratch

from softmpc.codegen.baselines import Baseline, generate_baseline, told_of
from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.reference import steps_of
from softmpc.compiler import compiler
from softmpc.control.baselines import FeedForward
from softmpc.control.closed_loop import start_at
from softmpc.control.ocp import Ocp
from softmpc.control.step import BUDGET_OVERRUN, INPUT_NOT_FINITE, SOLVED
from softmpc.control.terminal import terminal_cost
from softmpc.control.tip_gains import MOST_SENSITIVE, static_inverse
from softmpc.control.tracking import Setup
from softmpc.errors import InputError
from softmpc.statics.equilibrium import find_equilibrium, refine_equilibrium

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

Array = np.ndarray
KINDS = ("lqr", "table")
SAME = 1e-10  # of the input's scale


@dataclass(frozen=True)
class Told:
    """What a compiled controller asks of its problem, for rows that are as they are."""

    ocp: Ocp

    @property
    def inputs(self) -> int:
        return len(self.ocp.model.layout.u)

    @property
    def nx(self) -> int:
        return len(self.ocp.model.layout.x)

    def references(self, given: Array) -> Array:
        return np.asarray(given, float)


class InC:
    """A baseline in C with the calls of the one in Python: it keeps its own time."""

    def __init__(self, kind: str, **options: Any) -> None:
        folder, self.python = baseline(kind)
        self.ocp = self.python.ocp
        told: Any = Told(self.ocp)
        self.compiled = CompiledController(folder, told, flags=["-O1"], **options)
        self.rows = told_of(self.python, steps_of(line()))
        self.reset()

    def reset(self) -> None:
        self.compiled.reset()
        self.k = 0

    def step(self, x: Array, u_before: Array, given: Any) -> Any:
        self.k += 1
        return self.compiled.step(x, u_before, self.rows[self.k - 1])


@cache
def pair(kind: str) -> tuple[InC, Baseline]:
    in_c = InC(kind)
    return in_c, in_c.python


@pytest.mark.sampled
@pytest.mark.parametrize("kind", KINDS)
def test_the_loop_in_c_is_the_loop_in_python(kind: str) -> None:
    in_c, python = pair(kind)
    found, wanted = line().run(in_c), line().run(python)
    assert found.statuses == wanted.statuses and set(found.statuses) == {SOLVED}
    np.testing.assert_allclose(found.u, wanted.u, rtol=0, atol=SAME * 2.5)


@pytest.mark.parametrize("kind", KINDS)
def test_steps_from_anywhere_are_the_same(kind: str) -> None:
    """States off the path, inputs at their limits, numbers that are none: status, input, sum."""
    (in_c, python), rng, start = pair(kind), np.random.default_rng(5), line().start
    scale = python.ocp.model.layout.x.scale
    in_c.reset()
    python.reset()
    seen: set[tuple[str, bool]] = set()
    for k in range(len(in_c.rows)):
        x = start.x + scale * rng.uniform(-1, 1, len(scale)) * 10.0 ** rng.uniform(-6, 0.3)
        u = rng.uniform(-0.5, 3.0, len(start.u))  # limits are 0 and 2.5 N·m
        if k % 7 == 3:
            x[rng.integers(len(x))] = rng.choice([np.nan, np.inf, -np.inf])
        if k % 11 == 5:
            u[rng.integers(len(u))] = np.nan
        if k % 13 == 8:
            x = 1e300 * x
        with np.errstate(over="ignore", invalid="ignore"):
            found, wanted = in_c.step(x, u, None), python.step(x, u, None)
        status = found.status.partition(":")[0]
        assert status == wanted.status.partition(":")[0]
        assert (found.source, found.clipped) == (wanted.source, wanted.clipped)
        np.testing.assert_allclose(found.u, wanted.u, rtol=0, atol=SAME * 2.5)
        assert np.all((found.u >= 0) & (found.u <= 2.5))
        seen.add((status, found.clipped))
    assert {SOLVED, INPUT_NOT_FINITE} <= {status for status, _ in seen}
    assert (SOLVED, True) in seen and (SOLVED, False) in seen


def test_a_late_step_holds_its_input_and_adds_nothing_up() -> None:
    clock = iter(np.arange(1000.0))
    late = InC("table", budget=0.5, clock=lambda: next(clock))
    start, sums = line().start, []
    for _ in range(3):
        taken = late.step(start.x, start.u, None)
        assert (taken.status, taken.source) == (BUDGET_OVERRUN, "held input")
        np.testing.assert_array_equal(taken.u, start.u)
        sums.append(late.compiled.report.failures)
    assert sums == [1, 2, 3]
    in_time, again = pair("table")[0], InC("table", budget=1e9, clock=lambda: 0.0)
    in_time.reset()
    first = [one.step(start.x, start.u, None).u for one in (in_time, again)]
    np.testing.assert_array_equal(*first)


def test_narrower_limits_are_kept() -> None:
    in_c, start = pair("table")[0], line().start
    in_c.reset()
    most = start.u + 1e-3
    in_c.compiled.set_limits(high=most)
    x = start.x.copy()
    x[: line().ocp.model.strains] = 0.0  # straight: the tip is far off
    taken = in_c.step(x, start.u, None)
    assert taken.clipped and np.all(taken.u <= most) and np.any(taken.u == most)
    with pytest.raises(InputError, match="lower limit must be below"):
        in_c.compiled.set_limits(low=most, high=most)
    in_c.reset()
    assert np.any(in_c.step(x, start.u, None).u > most)


# ---------------------------------------------------------------- the table's gains


def discrete(setup: Setup, node: int) -> tuple[Array, Array, Array]:
    """A, B, C of one step of the arm at rest at a node, tip in m, from the transcription (SI)."""
    ocp, found = setup.ocp, setup.guide.rest.found[node]
    posture = refine_equilibrium(ocp.model, found.pressures, found.q)
    start, layout = start_at(ocp.model, posture), ocp.model.layout
    regulator, nx = terminal_cost(ocp, start.x, start.u).regulator, len(layout.x)
    A = regulator.A[:nx, :nx] * np.outer(layout.x.scale, 1 / layout.x.scale)
    B = regulator.B[:nx] * np.outer(layout.x.scale, 1 / layout.u.scale)
    C = np.zeros((3, nx))
    C[:, : ocp.model.strains] = np.asarray(ocp.model.tip_jacobian(posture.q))[-3:]
    return A, B, C


def test_the_loop_of_the_tip_is_stable_and_not_sensitive() -> None:
    """In discrete time, where the gains were found over continuous frequencies."""
    setup, table = line(), baseline("table")[1]
    for place, node in enumerate(table._at):
        A, B, C = discrete(setup, node)
        S, h = table.gains[place], setup.ocp.step
        k, k_i = table.proportional, table.integral
        feedback = -B @ S @ ((k + k_i * h) * C)
        whole = np.block([[A + feedback, k_i * B @ S], [-h * C, np.eye(3)]])
        assert np.abs(np.linalg.eigvals(whole)).max() < 1.0
        worst = 0.0
        for omega in np.geomspace(0.3, np.pi / h, 200):
            z = np.exp(1j * omega * h)
            G = C @ np.linalg.solve(z * np.eye(len(A)) - A, B)
            loop = G @ S * (k + k_i * h / (1 - 1 / z))
            worst = max(worst, np.linalg.norm(np.linalg.inv(np.eye(3) + loop), 2))
        assert 1.2 < worst < 1.15 * MOST_SENSITIVE


def test_the_inverse_moves_the_tip_where_it_should() -> None:
    """A millimetre along z by the inverse of the static sensitivity, against equilibria."""
    from softmpc.control.response import Response

    setup = line()
    model, found = setup.ocp.model, setup.guide.rest.found[0]
    place = Response(model, found.q, found.pressures)
    du = static_inverse(place) @ np.array([0.0, 0.0, 1e-4])
    pressures = np.asarray(found.pressures) + model.drive.static_gain @ du
    moved = find_equilibrium(model, pressures).q
    step = np.asarray(model.tip(moved)).ravel() - np.asarray(model.tip(found.q)).ravel()
    np.testing.assert_allclose(step, [0, 0, 1e-4], atol=2e-7)


def test_feedback_takes_out_what_feed_forward_leaves() -> None:
    setup = line()
    table, none = (
        setup.run(one) for one in (baseline("table")[1], FeedForward(setup.ocp, setup.guide))
    )
    assert table.summary()["rms_error_mm"] < 0.8 * none.summary()["rms_error_mm"]


# ---------------------------------------------------------------- directories


@pytest.mark.sampled
@on_make
@pytest.mark.parametrize("kind", KINDS)
def test_the_program_says_what_the_python_loop_says(kind: str) -> None:
    folder, python = baseline(kind)
    make(folder, "WERROR=-Werror")
    code, said = run(folder / "run")
    assert code == 0 and said.startswith("30 steps: 30 solved, tip error after 0.1 s: ")
    summary = line().run(python).summary()
    wanted = [summary["rms_error_mm"], summary["max_error_mm"]]
    np.testing.assert_allclose(numbers_of(said), wanted, atol=2e-6)
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert "DAQP" not in text and "tip[3]" in text


@on_make
@pytest.mark.parametrize("kind", ["lqr", pytest.param("table", marks=pytest.mark.slow)])
def test_float_is_near(kind: str) -> None:
    folder, python = baseline(kind)
    make(folder, "float", "WERROR=-Werror")
    code, said = run(folder / "run")
    assert code == 0
    wanted = line().run(python).summary()["rms_error_mm"]
    assert numbers_of(said)[0] == pytest.approx(wanted, rel=5e-3)


def test_what_cannot_be_a_baseline() -> None:
    with pytest.raises(InputError, match=r"'mpc'.*lqr, table"):
        generate_baseline(line(), "mpc", scratch() / "none")
    used = scratch()
    (used / "thesis.tex").write_text("\\begin", encoding="utf-8")
    with pytest.raises(InputError, match="not a controller's"):
        generate_baseline(line(), "table", used)
    assert [path.name for path in used.iterdir()] == ["thesis.tex"]
