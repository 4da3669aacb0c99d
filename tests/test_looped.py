"""Long arms: small functions called in loops do what the graph written out does."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import (
    CONSERVATIVE,
    LEAN,
    MIXED,
    PAPER,
    SMALL,
    States,
    arm,
    differences,
    largest,
    model_of,
    numbers,
)

from softmpc.compiled import compiled, instructions
from softmpc.compiler import compiler
from softmpc.control.costs import TipPosition
from softmpc.control.ocp import Ocp
from softmpc.control.transcription import Transcription
from softmpc.model import jacobians
from softmpc.model.counting import executed
from softmpc.model.effects import (
    EnvironmentDamping,
    FluidDrag,
    MaterialDamping,
    Payload,
    TipLoad,
)
from softmpc.model.formulations import VirtualPower
from softmpc.model.kinematics import PaperArc
from softmpc.model.mass import GaussMass, LumpedMass
from softmpc.model.scene import default_effects
from softmpc.simulation.inputs import InputProfile, Step
from softmpc.simulation.run import simulate
from softmpc.statics.equilibrium import find_equilibrium

DAMPING = (EnvironmentDamping(), MaterialDamping())
LOAD = TipLoad((0.5, -1.0, 0.3), (0.05, 0.1, -0.08))
PAYLOAD = Payload(0.3, 0.05)
SCENES: dict[str, dict[str, Any]] = {
    "2 × 3": {"segments": 3},
    "3 × 2, mixed units": {"manipulator": arm(*MIXED.sections, SMALL), "segments": 2},
    "planar": {"strains": ("epsilon", "kappa_y"), "segments": 2},
    "paper arc": {"kinematics": PaperArc(), "segments": 2},
    "no Coriolis terms": {
        "effects": (CONSERVATIVE[0], *CONSERVATIVE[1::2], *DAMPING, LOAD), "segments": 2,
    },
    "quasi-static": {"effects": (CONSERVATIVE[0], *DAMPING), "segments": 2},
    "no damping, no gravity": {"effects": CONSERVATIVE[1:]},
    "lumped": {"formulation": VirtualPower(mass=LumpedMass())},
    "gauss-3": {"formulation": VirtualPower(mass=GaussMass(3))},
    "tip load": {"effects": (*default_effects(), LOAD), "segments": 2},
    "payload": {"effects": (*LEAN, PAYLOAD), "segments": 2},
    "drag in a fluid": {"effects": (*LEAN, FluidDrag()), "segments": 2},
}  # fmt: skip
FUNCTIONS = ("residual_jacobian", "stiffness")
MORE = ("M", "C", "equations")
WITH_MORE = ("planar", "no Coriolis terms", "drag in a fluid")


def both_ways(patch: pytest.MonkeyPatch, scene: dict[str, Any], names: tuple[str, ...]) -> Any:
    """The model's functions in loops, and written out."""
    both = []
    for number, kind in ((0, "MXFunction"), (100, "SXFunction")):
        patch.setattr(jacobians, "MOST_WRITTEN_OUT", number)
        model = model_of(**scene)
        both.append([getattr(model, name) for name in names])
        assert both[-1][0].class_name() == kind
    return zip(*both, strict=True)


@pytest.mark.sampled
@pytest.mark.parametrize("name", SCENES)
def test_loops_do_what_the_graph_does(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    states = States(model_of(**SCENES[name]))
    pairs = both_ways(monkeypatch, SCENES[name], FUNCTIONS + (MORE if name in WITH_MORE else ()))
    points = [dict(zip(("q", "dq", "ddq", "p"), states.motion(), strict=True)) for _ in range(3)]
    for looped, flat in pairs:
        assert looped.name_in() == flat.name_in()
        assert looped.name_out() == flat.name_out()
        for k in range(flat.n_out()):
            found, wanted = looped.sparsity_out(k), flat.sparsity_out(k)
            assert wanted.is_subset(found), "at most what the last segment lacks is there as zero"
            assert found == wanted or (name, flat.name()) == ("paper arc", "stiffness")
        for point in points:
            at = [point[x] for x in flat.name_in()]
            for found, wanted in zip(looped.call(at), flat.call(at), strict=True):
                size = max(float(np.abs(np.asarray(wanted)).max(initial=0.0)), 1e-300)
                np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12 * size)


def test_against_differences_of_the_residual() -> None:
    """An arm that is looped by itself, with a payload that makes the last segment another kind."""
    model = model_of(segments=3, effects=(*default_effects(), PAYLOAD, LOAD))
    assert model.residual_jacobian.class_name() == "MXFunction"
    layout, rows = model.layout, model.layout.r.scale
    at = States(model, seed=4).motion()
    scales = (layout.q.scale, layout.dq.scale, layout.ddq.scale, layout.p.scale)
    for k, (block, scale) in enumerate(zip(model.residual_jacobian(*at), scales, strict=True)):
        wanted = differences(
            lambda x, k=k: model.residual(*at[:k], x, *at[k + 1 :]), at[k], 1e-2 * scale
        )
        assert largest(np.asarray(block) * scale, wanted * scale, rows) < 1e-8


def test_short_arms_are_written_out() -> None:
    few, many = model_of(segments=2, effects=LEAN), model_of(segments=3, effects=LEAN)
    assert few.residual_jacobian.class_name() == "SXFunction"
    assert many.residual_jacobian.class_name() == "MXFunction"


@pytest.mark.slow
def test_code_grows_with_the_segments_only() -> None:
    """Each small function counts once, and the paper's two sections need two of each."""
    sizes = [instructions(model_of(segments=n).residual_jacobian) for n in (4, 8, 16)]
    assert sizes[2] < 45_000, "small enough to compile"
    assert sizes[2] - sizes[1] <= 2.1 * (sizes[1] - sizes[0]) < 1_000
    sizes = [instructions(model_of(segments=n).stiffness) for n in (4, 16)]
    assert sizes[1] < 12_000
    uniform = arm(PAPER.sections[0], PAPER.sections[0])
    one_kind = model_of(manipulator=uniform, segments=4).residual_jacobian
    assert instructions(one_kind) < 0.6 * instructions(model_of(segments=4).residual_jacobian)


def test_work_grows_below_the_square_of_the_segments() -> None:
    few, many = (executed(model_of(segments=n).residual_jacobian) for n in (4, 8))
    assert 2 * few < many < 3 * few


@pytest.mark.slow
def test_absent_effects_cost_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jacobians, "MOST_WRITTEN_OUT", 0)
    full = model_of()
    lean = model_of(effects=LEAN)
    still = model_of(effects=(LEAN[0], MaterialDamping()))
    for name in ("residual_jacobian", "M"):
        sizes = [executed(getattr(m, name)) for m in (full, lean, still)]
        assert sizes[0] > sizes[1] > sizes[2]
    assert still.M.nnz_out() == 0
    assert still.residual_jacobian.nnz_out(1) == 8, "viscosity alone: no pair of segments"
    level = model_of(effects=LEAN[1:])
    assert executed(level.stiffness) < executed(lean.stiffness)


def test_executed_instructions() -> None:
    """Against counts by hand."""
    x = ca.SX.sym("x", 2)
    inner = ca.Function("inner", [x], [x * x])  # two in, two squares, two out
    assert executed(inner) == inner.n_instructions() == 6
    y = ca.MX.sym("y", 2)
    outer = ca.Function("outer", [y], [inner(inner(y))])
    assert executed(outer) == 2 + 2 * 6 + 2
    a, b = ca.MX.sym("a", 3, 4), ca.MX.sym("b", 4, 5)
    product = ca.Function("product", [a, b], [a @ b])
    zeros = 15  # to which the product is added
    assert executed(product) == 12 + 20 + zeros + 2 * 3 * 4 * 5 + 15
    assert instructions(outer) == outer.n_instructions() + 6, "each function once"


def test_model_counts_what_is_executed() -> None:
    model = model_of(segments=3, effects=LEAN)
    assert model.instructions()["residual_jacobian"] == executed(model.residual_jacobian)
    assert executed(model.residual_jacobian) > 2.5 * instructions(model.residual_jacobian)


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_compiled_loops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOFTMPC_CACHE", str(tmp_path))
    monkeypatch.setattr(jacobians, "MOST_WRITTEN_OUT", 0)
    uniform = arm(PAPER.sections[0], PAPER.sections[0])
    model = model_of(manipulator=uniform, strains=("epsilon", "kappa_y"), effects=LEAN)
    function, at = model.residual_jacobian, States(model).motion()
    fast = compiled(function, "require")
    assert fast.class_name() == "External"
    for found, wanted in zip(fast(*at), function(*at), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-12)


def test_transcription(monkeypatch: pytest.MonkeyPatch) -> None:
    """The interval of a long arm calls the loops, and has the values and the pattern of another."""
    found = []
    for number in (0, 100):
        monkeypatch.setattr(jacobians, "MOST_WRITTEN_OUT", number)
        model = model_of(effects=CONSERVATIVE)
        t = Transcription(Ocp(model, 3, 0.02, (TipPosition(),), ()))
        rng = np.random.default_rng(0)
        x, u, a = (rng.uniform(-0.5, 0.5, size) for size in (t.nx, t.nu, t.na))
        found.append((t.interval, *t.interval(x, u, a)))
        assert t.program.g.shape[0] == 3 * (t.na + t.nx)
    (looped, *values), (flat, *wanted) = found
    assert (looped.class_name(), flat.class_name()) == ("MXFunction", "SXFunction")
    assert looped.sparsity_out(1) == flat.sparsity_out(1)
    for one, other in zip(values, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-11)


def test_simulation_and_idas_of_a_long_arm() -> None:
    """Two integrators on a looped model, of which one has the Jacobian inside an MX graph."""
    model = model_of(segments=3)
    profile = InputProfile.of(6, [Step(1, 0.01, 1.0), Step(3, 0.0, 0.2), Step(5, 0.01, 0.5)])
    tips = [
        simulate(model, profile, 0.03, method=method, tip_tolerance=tolerance).tips[-1]
        for method, tolerance in (("radau", 1e-8), ("idas", None))
    ]
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-5)


@pytest.mark.slow
def test_statics_of_32_segments() -> None:
    """Against an arm of half the segments: constant strain converges at second order."""
    tips = []
    for segments in (4, 8, 16):
        found = find_equilibrium(model_of(segments=segments), np.array([2e5, 0, 0, 0, 1e5, 0]))
        assert found.converged
        tips.append(numbers(found.tips[-1]))
    first, second = (np.linalg.norm(b - a) for a, b in pairwise(tips))
    assert second < first / 3
