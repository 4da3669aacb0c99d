"""Functions that are compiled once that pays, and the integrator that is one of them."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from softmpc import Scene, build, chen2022
from softmpc.compiled import compiled, compiler
from softmpc.just_in_time import JustInTime
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.run import start_state
from softmpc.simulation.runge_kutta import RadauIIA

needs_compiler = pytest.mark.skipif(compiler() is None, reason="no C compiler")


@pytest.fixture(autouse=True)
def cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SOFTMPC_CACHE", str(tmp_path))
    monkeypatch.delenv("SOFTMPC_COMPILE")


def square(scale: float) -> ca.Function:
    """Another function for each test, so that no cache knows it."""
    x = ca.SX.sym("x")
    return ca.Function("square", [x], [scale * x * x])


def test_short_work_is_not_compiled() -> None:
    f = JustInTime(square(2.0))
    assert [float(f(x)) for x in (1, 2, 3)] == [2.0, 8.0, 18.0]
    assert not f.compiled


@needs_compiler
def test_long_work_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softmpc.just_in_time.COMPILING", 0.0)
    f = JustInTime(square(3.0))
    assert not f.compiled
    assert float(f(2.0)) == 12.0  # looks into the cache afterwards, in vain
    assert float(f(2.0)) == 12.0
    assert f.compiled
    assert float(f(3.0)) == 27.0


@needs_compiler
def test_what_is_in_the_cache_is_used_early(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled(square(4.0), "require")
    monkeypatch.setattr("softmpc.just_in_time.LOOKING", 0.0)
    monkeypatch.setattr("softmpc.just_in_time.COMPILING", 1e9)
    f = JustInTime(square(4.0))
    f(1.0)
    assert f.compiled
    assert float(f(3.0)) == 36.0


@needs_compiler
def test_require_compiles_at_once_and_never_never(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOFTMPC_COMPILE", "require")
    assert JustInTime(square(5.0)).compiled
    monkeypatch.setenv("SOFTMPC_COMPILE", "never")
    monkeypatch.setattr("softmpc.just_in_time.COMPILING", 0.0)
    f = JustInTime(square(5.0))
    for _ in range(3):
        assert float(f(2.0)) == 20.0
    assert not f.compiled


def test_without_a_compiler_it_works_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softmpc.compiled.compiler", lambda: None)
    monkeypatch.setattr("softmpc.just_in_time.COMPILING", 0.0)
    f = JustInTime(square(6.0))
    for _ in range(3):
        assert float(f(2.0)) == 24.0
    assert not f.compiled


@pytest.mark.sampled
@needs_compiler
@pytest.mark.parametrize("step", [None, 0.01])
def test_compiled_steps_are_the_same_steps(
    monkeypatch: pytest.MonkeyPatch, step: float | None
) -> None:
    model = build(Scene(chen2022()))
    x = start_state(model, InputProfile.of(6))
    torques = np.array([1.5, 0, 0.3, 0, 0.8, 0])
    ends = []
    for mode in ("never", "require"):
        monkeypatch.setenv("SOFTMPC_COMPILE", mode)
        method = RadauIIA(model, step=step)
        ends.append(method.advance(x, torques, 0.5, 5))
        assert method._many.compiled == (mode == "require")
    scale = model.layout.x.scale
    np.testing.assert_allclose(ends[0] / scale, ends[1] / scale, atol=1e-10)


@pytest.mark.slow
@needs_compiler
def test_compiled_steps_see_a_motion_that_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """NaN must reach the checks: flags like -ffast-math would hide it."""
    monkeypatch.setenv("SOFTMPC_COMPILE", "require")
    model = build(Scene(chen2022()))
    method = RadauIIA(model)
    method.prepare()
    carry = np.full(method.trials.carry.size, np.nan)
    carry[0] = 0.0
    carry[1:6] = [1e-3, 1e-3, 0, 0, 0]
    given = np.zeros(method.trials.given_size)
    given[:3] = [1.0, 1e-6, 1.0]
    after = method.trials.carry.unpack(np.asarray(method._many(carry, given)))
    assert after["t"].max() == 0.0
    assert after["failures"][0, -1] > 10
