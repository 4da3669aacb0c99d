"""Effects beyond the paper, each against an answer that shares no code with it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from arms import CONSERVATIVE, LEAN, PAPER, Array, States, arm, differences, largest, model_of
from arms import numbers as num
from numpy.testing import assert_allclose
from oracles.closed_forms import cantilever_bending_frequencies, cantilever_with_end_mass
from oracles.moving_bodies import (
    euler_lagrange,
    jacobians,
    on_strains,
    quadratic_drag,
    section_ends,
)
from scipy.linalg import eigh
from test_statics import PRINTED, Scenario

from softmpc.errors import SceneError
from softmpc.model.contact import Contact
from softmpc.model.effects import (
    AddedMass,
    Buoyancy,
    Coriolis,
    Effect,
    EnvironmentDamping,
    FluidDrag,
    Gravity,
    Inertia,
    MaterialDamping,
    Payload,
    WaterMass,
)
from softmpc.model.formulations import FullNewtonEuler, NewtonEuler, VirtualPower
from softmpc.model.mass import LumpedMass
from softmpc.model.model import Model
from softmpc.model.obstacles import Cylinder, Plane
from softmpc.statics.equilibrium import find_equilibrium

LENGTHS = [section.length for section in PAPER.sections]
GRAVITY = np.array((0.0, 0.0, 9.81))
TOUCHING = Contact(
    (
        Plane((0, 0, 0.45), (0, 0.3, -1)),
        Cylinder((0.1, 0, 0), (0, 1, 0), 0.05),
        Cylinder(radius=0.08, side="inside"),
    )
)
BEYOND: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        Buoyancy(), FluidDrag(), AddedMass(), WaterMass(), Payload(0.3, 0.05), TOUCHING,
    )
}  # fmt: skip
SETS = {**{name: (effect,) for name, effect in BEYOND.items()}, "all": tuple(BEYOND.values())}
DAMPING = (EnvironmentDamping(), MaterialDamping())
each_set = pytest.mark.parametrize("name", SETS)


@cache
def model(*effects: Effect, **slots: Any) -> Model:
    return model_of(effects=effects, **slots)


def lumped(*effects: Effect) -> Model:
    return model(*effects, formulation=VirtualPower(mass=LumpedMass()))


def share(effect: Effect, *others: Effect, at: tuple[Array, ...]) -> Array:
    """What the effect adds to the residual of lumped bodies."""
    return num(lumped(*others, effect).residual(*at) - lumped(*others).residual(*at))


def motions(count: int = 2) -> list[tuple[Array, Array, Array, Array]]:
    states = States(lumped(*LEAN), 5)
    return [states.motion() for _ in range(count)]


SCALE = model_of(effects=LEAN).layout.q.scale
ROWS = model_of(effects=LEAN).layout.r.scale


# ---------------------------------------------------------------- inertia: Euler-Lagrange


def test_added_mass_is_that_of_its_kinetic_energy() -> None:
    """T = ½ Σ m_a (|v|² - (t·v)²), with t the third column of the orientation."""
    mass = 800 * 0.7 * np.pi * 0.0323**2 * 0.25

    def weighing(q: Array, places: list[Array], rotations: list[Array]) -> list[Array]:
        return [mass * (np.eye(3) - np.outer(r[:, 2], r[:, 2])) for r in rotations]

    for at in motions():
        found = share(AddedMass(800, 0.7), Inertia(), Coriolis(), at=at)
        assert largest(found, euler_lagrange(LENGTHS, at[:3], SCALE, weighing), ROWS) < 1e-6


def test_water_mass_is_that_of_its_lagrangian() -> None:
    """T - U = ½ Σ μ ε (|v|² + 2 g·x), with μ = ρ · 3 A_d l_0."""
    mu = 1000 * 3 * 3.14e-4 * 0.25

    def weighing(q: Array, places: list[Array], rotations: list[Array]) -> list[Array]:
        return [mu * q[4 * i] * np.eye(3) for i in range(2)]

    def potential(q: Array) -> float:
        places, _ = section_ends(LENGTHS, q)
        return -sum(mu * q[4 * i] * float(GRAVITY @ places[i]) for i in range(2))

    for at in motions():
        wanted = euler_lagrange(LENGTHS, at[:3], SCALE, weighing, potential)
        assert largest(share(WaterMass(), *LEAN, at=at), wanted, ROWS) < 1e-6
        still = euler_lagrange(LENGTHS, (at[0], 0 * at[1], 0 * at[2]), SCALE, weighing, potential)
        assert largest(share(WaterMass(), Gravity(), at=at), still, ROWS) < 1e-8


def test_payload_is_a_mass_at_the_tip() -> None:
    mass = 0.37

    def weighing(q: Array, places: list[Array], rotations: list[Array]) -> list[Array]:
        return [np.zeros((3, 3)), mass * np.eye(3)]

    def potential(q: Array) -> float:
        return -mass * float(GRAVITY @ section_ends(LENGTHS, q)[0][-1])

    for at in motions():
        wanted = euler_lagrange(LENGTHS, at[:3], SCALE, weighing, potential)
        gauss = [model(*LEAN, *extra).residual(*at) for extra in ((Payload(mass, 0),), ())]
        assert largest(num(gauss[0] - gauss[1]), wanted, ROWS) < 1e-6
        assert largest(share(Payload(mass, 0), *LEAN, at=at), wanted, ROWS) < 1e-6


def test_a_lumped_payload_is_a_heavier_last_section() -> None:
    """In every formulation, because the paper's lumped mass sits at the tip."""
    base, last = PAPER.sections
    heavier = replace(PAPER, sections=(base, replace(last, mass=last.mass + 0.2)))
    for formulation in (NewtonEuler(), FullNewtonEuler(), VirtualPower(mass=LumpedMass())):
        loaded = model(*LEAN, Payload(0.2), formulation=formulation)
        wanted = model_of(heavier, effects=LEAN, formulation=formulation)
        for at in motions():
            assert largest(num(loaded.residual(*at)), num(wanted.residual(*at)), ROWS) < 1e-12


# ---------------------------------------------------------------- frequencies


def bending_frequency(*effects: Effect) -> float:
    """Lowest frequency (rad/s) of one straight section that bends in a plane, extrapolated."""
    found = []
    for segments in (4, 8):
        one = model_of(
            arm(PAPER.sections[0]),
            strains=("kappa_y",),
            segments=segments,
            effects=(Inertia(), *effects),
        )
        K, M = np.asarray(one.stiffness(0, 0)[0]), np.asarray(one.M(0))
        found.append(float(np.sqrt(eigh(K, M, eigvals_only=True)[0])))
    return (4 * found[1] - found[0]) / 3  # second order in the segments


@pytest.mark.slow
def test_frequencies_of_a_cantilever() -> None:
    """Heavier by the added mass along it, or by an end mass."""
    section = PAPER.sections[0]
    slow = np.sqrt(section.bending_stiffness / section.mass / section.length**3)
    free = cantilever_bending_frequencies(1)[0]
    added = 1000 * np.pi * section.disc_radius**2 * section.length
    wanted = free * slow / np.sqrt(1 + added / section.mass)
    assert bending_frequency(AddedMass()) == pytest.approx(wanted, rel=2e-4)
    for ratio in (0.2, 3.0):
        wanted = cantilever_with_end_mass(ratio) * slow
        found = bending_frequency(Payload(ratio * section.mass, 0))
        assert found == pytest.approx(wanted, rel=2e-4)


# ---------------------------------------------------------------- weight


def test_buoyancy_lightens_the_rod() -> None:
    """The rod of softmpc/accuracy/rod.py with the reduced weight; second order in the segments."""
    section = PRINTED.sections[0]
    volume = 3 * (section.wall_area + section.unit_area) * section.length
    lighter = tuple(replace(s, mass=s.mass - 700 * volume) for s in PRINTED.sections)
    wanted = Scenario(lighter, PRINTED.pressures_mpa).rod().tip
    errors = []
    for segments in (2, 4):
        floating = model_of(
            arm(*PRINTED.sections), segments=segments, effects=(Gravity(), Buoyancy(700))
        )
        found = find_equilibrium(floating, PRINTED.pressures)
        errors.append(np.linalg.norm(found.tips[-1] - wanted))
    assert errors[1] < 1e-3
    assert 3 < errors[0] / errors[1] < 5


def test_a_neutral_arm_is_weightless_and_costs_nothing() -> None:
    section = PAPER.sections[0]
    volume = section.units * (section.wall_area + section.unit_area) * section.length
    neutral = model(*LEAN, Buoyancy(section.mass / volume))
    weightless = model(*LEAN[1:])
    assert neutral.residual.n_instructions() == weightless.residual.n_instructions()
    for at in motions():
        assert_allclose(num(neutral.residual(*at)), num(weightless.residual(*at)))


# ---------------------------------------------------------------- drag


def test_drag_is_the_sum_over_the_bodies() -> None:
    """Velocities by differences of the closed-form arc, force as in a textbook."""
    effect = FluidDrag(density=900, normal=1.3, tangential=0.02, velocity=1e-6)
    area = 2 * 0.0323 * 0.25
    for at in motions():
        q, dq = at[:2]
        velocities = jacobians(LENGTHS, q, SCALE) @ dq
        tangents = [r[:, 2] for r in section_ends(LENGTHS, q)[1]]
        forces = [
            quadratic_drag(v, t, area, 900, 1.3, 0.02)
            for v, t in zip(velocities, tangents, strict=True)
        ]
        wanted = on_strains(LENGTHS, q, SCALE, forces)
        assert largest(share(effect, *LEAN, at=at), wanted, ROWS) < 1e-6


def test_drag_is_linear_at_rest_and_absent_without_coefficients() -> None:
    drag, plain = model(*LEAN, FluidDrag(velocity=0.1)), model(*LEAN)
    q = motions(1)[0][0]
    damping = np.asarray(drag.residual_jacobian(q, 0, 0, 0)[1])
    assert np.linalg.eigvalsh(damping + damping.T).min() > -1e-12
    assert damping.trace() > 0
    none = model(*LEAN, FluidDrag(normal=0, tangential=0))
    assert none.residual.n_instructions() == plain.residual.n_instructions()


# ---------------------------------------------------------------- energy and derivatives


@pytest.mark.sampled
@each_set
@pytest.mark.parametrize("segments", [1, 2])
def test_energy_balance(name: str, segments: int) -> None:
    """d/dt of all energies is the sum of all powers, along the model's own accelerations."""
    m = model(*CONSERVATIVE, *DAMPING, *SETS[name], segments=segments)
    states = States(m, 3)
    for _ in range(2):
        q, dq, _, p = states.motion()
        ddq = num(m.forward_dynamics(q, dq, p))

        def energy(t: Array, q: Array = q, dq: Array = dq, ddq: Array = ddq) -> float:
            moved = q + t[0] * dq + t[0] ** 2 / 2 * ddq, dq + t[0] * ddq
            return sum(float(e) for e in m.energies.call(list(moved)))

        rate = differences(energy, np.zeros(1), np.array([2e-5]))[0]
        powers = {k: float(v) for k, v in m.powers(q=q, dq=dq, p=p).items()}
        size = sum(abs(v) for v in powers.values())
        assert rate == pytest.approx(sum(powers.values()), abs=1e-6 * size)
        assert all(v <= 0 for k, v in powers.items() if k not in ("drive", "load"))


QUIET = {"quasi-static": (Gravity(), *DAMPING), "no coriolis": (Gravity(), Inertia(), *DAMPING)}
SCENES = {
    **{name: (*CONSERVATIVE, *DAMPING, *extra) for name, extra in SETS.items()},
    "quasi-static": (*QUIET["quasi-static"], *(e for n, e in BEYOND.items() if n != "added_mass")),
    "no coriolis": (*QUIET["no coriolis"], *BEYOND.values()),
}


@pytest.mark.sampled
@pytest.mark.parametrize("name", SCENES)
def test_derivatives(name: str) -> None:
    """residual_jacobian and stiffness by finite differences; M, C, N, τ make the residual."""
    m = model(*SCENES[name])
    sizes = [m.layout.q.scale, m.layout.dq.scale, m.layout.ddq.scale]
    rows = m.layout.r.scale[:, None]
    q, dq, ddq, p = States(m, 4).motion()
    for k, block in enumerate(m.residual_jacobian(q, dq, ddq, p)[:3]):

        def moved(x: Array, k: int = k) -> Any:
            return m.residual(*(x if i == k else v for i, v in enumerate((q, dq, ddq))), p)

        wanted = differences(moved, (q, dq, ddq)[k], 1e-3 * sizes[k])
        # Rows in units of their size; accelerations are small in quasi-static scenes.
        error = np.abs(np.asarray(block) - wanted) * sizes[k] / rows
        assert error.max() < 1e-9 * max(1.0, np.abs(wanted * sizes[k] / rows).max())
    K = differences(lambda x: m.balance(x, p), q, 1e-3 * sizes[0])
    assert np.abs((np.asarray(m.stiffness(q, p)[0]) - K) * sizes[0] / rows).max() < 1e-7
    M, C, N, tau = (np.asarray(x) for x in m.equations(q, dq, p))
    assert_allclose(M, np.asarray(m.M(q)), atol=1e-15)
    assert_allclose(C, np.asarray(m.C(q, dq)), atol=1e-12)
    assert_allclose(M, M.T, atol=1e-14)
    wanted = num(m.residual(q, dq, ddq, p))
    assert largest(M @ ddq + C @ dq + num(N) - num(tau), wanted, m.layout.r.scale) < 1e-10
    assert largest(num(m.residual(q, 0, 0, p)), num(m.balance(q, p)), m.layout.r.scale) < 1e-12


@pytest.mark.parametrize("name", ["added_mass", "water_mass", "payload"])
def test_rate_matrix_is_skew(name: str) -> None:
    """Ṁ - 2C for masses, added or growing."""
    m = model(*CONSERVATIVE, BEYOND[name])
    q, dq, _, _ = States(m, 6).motion()
    rate = differences(lambda t: m.M(q + t[0] * dq), np.zeros(1), np.array([1e-4]))[..., 0]
    skew = rate - 2 * np.asarray(m.C(q, dq))
    assert np.abs(skew + skew.T).max() < 1e-8 * np.abs(skew).max()


def test_order_and_massless_strains() -> None:
    assert model(Gravity(), FluidDrag()).order == 1
    assert model(Gravity(), TOUCHING).order == 1  # contact damps
    assert model(Gravity(), replace(TOUCHING, damping=0)).order == 0
    assert model(Gravity(), WaterMass(), Buoyancy(), Payload()).order == 0
    assert lumped(*LEAN).massless
    assert not model(*LEAN, AddedMass(), Payload(), WaterMass(), strains=("epsilon",)).massless


# ---------------------------------------------------------------- absent is absent


@pytest.mark.sampled
@pytest.mark.parametrize("name", BEYOND)
def test_leaving_one_out_saves_instructions(name: str) -> None:
    """And adds no structural nonzero; what is left is worth the same as without the others."""
    whole = model(*CONSERVATIVE, *DAMPING, *BEYOND.values())
    part = model(*CONSERVATIVE, *DAMPING, *(e for n, e in BEYOND.items() if n != name))
    assert part.layout.x.names == whole.layout.x.names
    for function in ("residual", "residual_jacobian"):
        few, all_ = getattr(part, function), getattr(whole, function)
        # Weight and inertia share a product where nothing floats: one instruction.
        saved = all_.n_instructions() - few.n_instructions()
        assert saved > 0 or name == "buoyancy", function
    for k in range(4):
        assert part.residual.sparsity_jac(k, 0).is_subset(whole.residual.sparsity_jac(k, 0))
    alone = model(*CONSERVATIVE, *DAMPING, BEYOND[name])
    plain = model(*CONSERVATIVE, *DAMPING)
    for at in motions():
        among = num(whole.residual(*at) - part.residual(*at))
        by_itself = num(alone.residual(*at) - plain.residual(*at))
        assert np.abs(by_itself / ROWS).max() > 1e-5
        assert largest(among, by_itself, ROWS) < 1e-10


@pytest.mark.sampled
@pytest.mark.parametrize("strains", [("epsilon", "kappa_y"), ("kappa_x", "kappa_y")])
def test_strains_left_out_are_zero(strains: tuple[str, ...]) -> None:
    """The rows of the full model held at zero strain; without ε no water flows in."""
    effects = (*LEAN, *DAMPING, *BEYOND.values())
    full, part = model(*effects), model(*effects, strains=strains)
    rows = [i for i, n in enumerate(full.layout.q.names) if n.rsplit("_", 2)[0] in strains]
    *motion, p = States(part).motion()
    held = [np.zeros(full.strains) for _ in motion]
    for whole, few in zip(held, motion, strict=True):
        whole[rows] = few
    wanted = num(full.residual(*held, p))[rows]
    assert largest(num(part.residual(*motion, p)), wanted, part.layout.r.scale) < 1e-12
    blocks = zip(part.residual_jacobian(*motion, p), full.residual_jacobian(*held, p), strict=True)
    for block, whole in list(blocks)[:3]:
        wanted = np.asarray(whole)[np.ix_(rows, rows)]
        assert_allclose(block, wanted, atol=1e-12 * np.abs(wanted).max())
    if "epsilon" not in strains:
        dry = model(*effects[:-3], *effects[-2:], strains=strains)
        assert WaterMass() not in dry.scene.effects
        assert dry.residual.n_instructions() == part.residual.n_instructions()


# ---------------------------------------------------------------- who may use them


@pytest.mark.parametrize("kind", [FluidDrag, AddedMass, WaterMass])
@pytest.mark.parametrize("formulation", [NewtonEuler(), FullNewtonEuler()])
def test_newton_euler_refuses(kind: type[Effect], formulation: NewtonEuler) -> None:
    with pytest.raises(SceneError, match=rf"'{kind.name}' is not in the formulation .*use 'virt"):
        model_of(effects=(*LEAN, kind()), formulation=formulation)


def test_effects_that_need_others() -> None:
    with pytest.raises(SceneError, match="'buoyancy' needs the effect 'gravity'"):
        model_of(effects=(Inertia(), Buoyancy()))
    with pytest.raises(SceneError, match="'added_mass' needs the effect 'inertia'"):
        model_of(effects=(Gravity(), AddedMass()))
