"""What the default formulation promises: symmetry, energy, and derivatives that are right."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import (
    CONSERVATIVE,
    LEAN,
    MIXED,
    ONE_UNIT,
    Array,
    States,
    arm,
    differences,
    largest,
    model_of,
    numbers,
)
from numpy.testing import assert_allclose

from softmpc.errors import BuildError
from softmpc.model.effects import EnvironmentDamping, MaterialDamping, TipLoad
from softmpc.model.elasticity import StrainElasticity
from softmpc.model.formulations import NewtonEuler, VirtualPower
from softmpc.model.kinematics import PaperArc
from softmpc.model.mass import GaussMass, LumpedMass
from softmpc.model.model import Model
from softmpc.model.scene import default_effects

DAMPING = (EnvironmentDamping(), MaterialDamping())
LOAD = TipLoad((0.5, -1.0, 0.3), (0.05, 0.1, -0.08))
LUMPED = VirtualPower(mass=LumpedMass())
SCENES: dict[str, dict[str, Any]] = {
    "default": {},
    "paper arc": {"kinematics": PaperArc()},
    "lumped": {"formulation": LUMPED},
    "gauss-1, paper arc, 2 segments": {
        "formulation": VirtualPower(mass=GaussMass(1)), "kinematics": PaperArc(), "segments": 2,
    },
    "planar": {"strains": ("epsilon", "kappa_y"), "segments": 2},
    "no torsion": {"strains": ("epsilon", "kappa_x", "kappa_y")},
    "inextensible": {"strains": ("kappa_x", "kappa_y", "kappa_z"), "kinematics": PaperArc()},
    "tip load": {"effects": (*default_effects(), LOAD), "segments": 2},
    "3 segments": {"segments": 3},
    "one unit": {"manipulator": arm(ONE_UNIT), "segments": 2},
    "sections of two sizes": {"manipulator": MIXED},
    "strain elasticity": {"formulation": VirtualPower(elasticity=StrainElasticity())},
    "no rotary inertia": {"effects": (*LEAN, *DAMPING)},
    "no damping": {"effects": CONSERVATIVE},
    "no Coriolis terms": {"effects": (CONSERVATIVE[0], *CONSERVATIVE[1::2], *DAMPING, LOAD)},
    "quasi-static": {"effects": (CONSERVATIVE[0], *DAMPING, LOAD)},
    "newton-euler": {"formulation": NewtonEuler(), "effects": (*default_effects(), LOAD)},
}  # fmt: skip
HEAVY = [n for n in SCENES if n not in ("no rotary inertia", "quasi-static", "newton-euler")]
ASYMMETRIC = ("newton-euler", "strain elasticity")  # ∂N/∂q; a dead moment makes it so as well
every = pytest.mark.parametrize("name", SCENES)
heavy = pytest.mark.parametrize("name", HEAVY)


@cache
def scene(name: str) -> Model:
    return model_of(**SCENES[name])


# ------------------------------------------------------------------------------------- inertia


@heavy
def test_inertia_is_symmetric_and_positive_definite(name: str) -> None:
    """Also at the exactly straight arm, where twist has only its rotary inertia."""
    model = scene(name)
    states, scale = States(model), model.layout.q.scale
    for q in [np.zeros(model.strains)] + [states.q() for _ in range(20)]:
        M = np.asarray(model.M(q)) * np.outer(scale, scale)
        assert_allclose(M, M.T, atol=1e-14 * np.abs(M).max())
        assert np.linalg.eigvalsh(M).min() > 1e-7 * np.abs(M).max()
    assert model.massless == ()


@pytest.mark.sampled
@pytest.mark.parametrize("formulation", [VirtualPower(), LUMPED])
def test_twist_without_rotary_inertia_is_massless(formulation: VirtualPower) -> None:
    model = model_of(formulation=formulation, effects=LEAN)
    assert "kappa_z_1_1" in model.massless or "kappa_z_2_1" in model.massless
    for what in ("forward_dynamics", "x_dot"):
        with pytest.raises(BuildError, match=r"have no mass: .*add the effect 'rotary_inertia'"):
            getattr(model, what)
    assert "without mass" in repr(model)


def test_two_lumped_segments_have_rank_six() -> None:
    """Two points have six coordinates: eight strains cannot all have mass."""
    model = model_of(formulation=LUMPED, effects=LEAN)
    states, scale = States(model), model.layout.q.scale
    for _ in range(10):
        M = np.asarray(model.M(states.q())) * np.outer(scale, scale)
        values = np.linalg.svd(M, compute_uv=False)
        assert np.sum(values > 1e-10 * values[0]) <= 6


def test_quasi_static_arm_has_no_acceleration() -> None:
    with pytest.raises(BuildError, match="needs the effect 'inertia'"):
        _ = scene("quasi-static").forward_dynamics
    assert scene("quasi-static").order == 1


@pytest.mark.parametrize("name", ["default", "paper arc", "lumped", "planar", "3 segments"])
def test_inertia_rate_less_twice_coriolis_is_skew(name: str) -> None:
    """With damping left out: then inertia forces do no net work."""
    strains = SCENES[name].get("strains", scene(name).scene.strains)
    effects = CONSERVATIVE if "kappa_z" in strains else LEAN
    model = model_of(**(SCENES[name] | {"effects": effects}))
    x, v = (ca.SX.sym(symbol, model.strains) for symbol in "xv")
    along = ca.reshape(ca.jtimes(ca.vec(model.M(x)), x, v), model.strains, model.strains)
    rate, states = ca.Function("rate", [x, v], [along]), States(model)
    scale = np.outer(model.layout.q.scale, model.layout.q.scale)
    for _ in range(5):
        q, dq, *_ = states.motion()
        dM = np.asarray(rate(q, dq))
        S = (dM - 2 * np.asarray(model.C(q, dq))) * scale
        assert_allclose(S, -S.T, atol=1e-13 * np.abs(dM * scale).max())


# ---------------------------------------------------------------------------------- one residual


@pytest.mark.sampled
@pytest.mark.parametrize("name", [n for n in SCENES if n != "3 segments"])
def test_residual_is_the_sum_of_its_terms(name: str) -> None:
    """r = M ddq + C dq + N - τ, and `equations` returns the same four as the four functions."""
    model, rows = scene(name), scene(name).layout.r.scale
    states = States(model)
    for _ in range(5):
        q, dq, ddq, p = states.motion()
        M, C, N, tau = (numbers(x) for x in model.equations(q, dq, p))
        for found, wanted in zip(
            (M, C, N, tau), (model.M(q), model.C(q, dq), model.N(q), model.tau(q, p)), strict=True
        ):
            wanted = numbers(wanted)
            assert_allclose(found, wanted, atol=1e-12 * max(np.abs(wanted).max(), 1e-12))
        r = numbers(model.residual(q, dq, ddq, p))
        assert largest(M @ ddq + C @ dq + N - tau, r, rows) < 1e-11
        rest = numbers(model.residual(q, 0 * q, 0 * q, p))
        assert largest(numbers(model.balance(q, p)), rest, rows) < 1e-12
        assert largest(N - tau, rest, rows) < 1e-12


# ------------------------------------------------------------------------------------ derivatives


@pytest.mark.sampled
@every
def test_derivative_along_a_direction(name: str) -> None:
    """The O(n) derivative along a direction is the Jacobian times that direction."""
    model, states = scene(name), States(scene(name))
    at, way = states.motion(), states.motion()
    blocks = model.residual_jacobian(*at)
    expected = sum(np.asarray(block) @ x for block, x in zip(blocks, way, strict=True))
    found = np.asarray(model.residual_along(*at, *way)).ravel()
    assert_allclose(found, expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max())


@every
def test_residual_jacobian(name: str) -> None:
    """Against automatic differentiation (exact) and against differences of the residual."""
    model, layout = scene(name), scene(name).layout
    symbols = [ca.SX.sym(s, len(v)) for s, v in zip("qdap", _arguments(model), strict=True)]
    r, states, n = model.residual(*symbols), States(model), model.strains
    for _ in range(2):
        at = states.motion()
        blocks = model.residual_jacobian(*at)
        for k, (block, variables) in enumerate(zip(blocks, _arguments(model), strict=True)):
            scaled = np.asarray(block) * variables.scale / layout.r.scale[:, None]
            size = max(np.abs(scaled).max(), 1e-9)
            v = ca.SX.sym("v", len(variables))
            along = ca.Function("along", [*symbols, v], [ca.jtimes(r, symbols[k], v)])
            exact = np.asarray(along(*at, ca.diag(variables.scale))) / layout.r.scale[:, None]
            assert_allclose(scaled, exact, atol=1e-13 * size)

            def shifted(x: Array, k: int = k, at: tuple[Array, ...] = at) -> Any:
                return model.residual(*at[:k], x, *at[k + 1 :])

            by_steps = differences(shifted, at[k], 0.01 * variables.scale)
            by_steps = by_steps * variables.scale / layout.r.scale[:, None]
            assert_allclose(scaled, by_steps, atol=1e-9 * size)
        assert blocks[0].shape == blocks[2].shape == (n, n)


def _arguments(model: Model) -> tuple[Any, ...]:
    layout = model.layout
    return layout.q, layout.dq, layout.ddq, layout.p


@pytest.mark.sampled
@every
def test_stiffness_and_tip_jacobian(name: str) -> None:
    model, layout = scene(name), scene(name).layout
    states, step = States(model), 0.01 * layout.q.scale
    for q in [np.zeros(model.strains), states.q(), states.q()]:
        p = states.motion()[3]
        K, by_p = (np.asarray(x) for x in model.stiffness(q, p))
        wanted = differences(lambda x, p=p: model.balance(x, p), q, step)
        rows = np.abs(wanted * layout.q.scale).max(axis=1)
        assert largest(K * layout.q.scale, wanted * layout.q.scale, rows) < 1e-8
        by_steps = differences(lambda x, q=q: model.balance(q, x), p, layout.p.scale)
        assert_allclose(by_p, by_steps, atol=1e-10 * np.abs(by_steps).max())
        if name not in ASYMMETRIC and LOAD not in model.scene.effects:
            assert_allclose(K, K.T, atol=1e-12 * np.abs(K).max())
        J = np.asarray(model.tip_jacobian(q)).reshape(-1, 3, model.strains)
        tips = differences(lambda x: np.asarray(model.frames(x)[0]).T, q, step)
        assert_allclose(J, tips.reshape(J.shape), atol=1e-9)


# ---------------------------------------------------------------------------------------- energy


@pytest.mark.parametrize("name", [n for n in HEAVY if n != "strain elasticity"])
def test_position_forces_are_the_gradient_of_the_energy(name: str) -> None:
    model, q = scene(name), States(scene(name)).q()
    names, scale = model.energies.name_out(), model.layout.q.scale
    assert {"kinetic", "gravity", "elastic"} <= set(names)

    def potential(x: Array) -> Array:
        found = model.energies(q=x, dq=0 * x)
        return np.array([sum(float(found[n]) for n in names if n != "kinetic")])

    slope = differences(potential, q, 0.01 * scale)[0]
    assert largest(numbers(model.N(q)), slope, model.layout.r.scale) < 1e-9


@pytest.mark.sampled
@pytest.mark.parametrize("name", ["default", "paper arc", "planar", "tip load", "one unit"])
@pytest.mark.parametrize("moment", [False, True])
def test_energy_balance(name: str, moment: bool) -> None:
    """dE/dt = Σ power along the motion that `forward_dynamics` says, for damping and drive."""
    load = LOAD if moment else TipLoad(LOAD.force)
    effects = (*default_effects(SCENES[name].get("strains", scene(name).scene.strains)), load)
    model = model_of(**(SCENES[name] | {"effects": effects}))
    states = States(model)
    for _ in range(3):
        q, dq, _, p = states.motion()
        ddq = numbers(model.forward_dynamics(q, dq, p))
        assert largest(numbers(model.residual(q, dq, ddq, p)), 0 * q, model.layout.r.scale) < 1e-9

        def energy(t: Array, q: Array = q, dq: Array = dq, ddq: Array = ddq) -> Array:
            found = model.energies(q=q + t[0] * dq, dq=dq + t[0] * ddq)
            return np.array([sum(float(x) for x in found.values())])

        paces = ddq / model.layout.dq.scale, dq / model.layout.q.scale
        pace = np.abs(paces).max()
        rate = float(differences(energy, np.zeros(1), np.array([0.003 / pace]))[0, 0])
        powers = {name: float(x) for name, x in model.powers(q=q, dq=dq, p=p).items()}
        assert ("load" in powers) == moment
        assert powers["material_damping"] < 0
        assert powers["environment_damping"] < 0
        size = sum(abs(x) for x in powers.values())
        assert rate == pytest.approx(sum(powers.values()), abs=1e-8 * size)


@pytest.mark.parametrize("name", ["default", "one unit", "sections of two sizes"])
def test_pressure_work_is_generalised_force_times_rate(name: str) -> None:
    """τ·dq = Σ P dV/dt: the drive's force and the chambers' volumes belong together."""
    model, states = scene(name), States(scene(name))
    for _ in range(5):
        q, dq, _, p = states.motion()
        work = float(numbers(model.tau(q, p)) @ dq)
        assert float(model.powers(q=q, dq=dq, p=p)["drive"]) == pytest.approx(work, rel=1e-12)


@pytest.mark.parametrize("law", ["energy", "strain"])
def test_work_of_a_closed_strain_cycle(law: str) -> None:
    """Stretch, bend, relax, unbend: the literal law (17)-(19) gains energy, the default none."""
    formulation = VirtualPower(elasticity=StrainElasticity()) if law == "strain" else VirtualPower()
    model = model_of(formulation=formulation, effects=())
    size = model.layout.q.scale[:4]
    ways = [np.array((1.0, 0, 0, 0)) * size, np.array((0, 0.6, 1.0, 0.5)) * size]
    corners = [0 * size, ways[0], ways[0] + ways[1], ways[1], 0 * size]
    places, weights = np.polynomial.legendre.leggauss(6)
    work, most = 0.0, 0.0
    for start, end in pairwise(corners):
        for x, w in zip(places, weights, strict=True):
            q = np.concatenate((start + (x + 1) / 2 * (end - start), np.zeros(4)))
            work += w / 2 * float(numbers(model.N(q))[:4] @ (end - start))
        most = max(most, abs(work))
    assert ("elastic" in model.energies.name_out()) == (law == "energy")
    if law == "energy":
        assert abs(work) < 1e-13 * most
    else:
        assert abs(work) > 0.05 * most
