"""Absent means absent: what a scene leaves out costs nothing and changes nothing else."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from arms import LEAN, PAPER, Array, States, differences, largest, model_of, numbers
from numpy.testing import assert_allclose

from softmpc.model.actuation import HydraulicDrive, PressureDrive, StaticDrive
from softmpc.model.effects import (
    Coriolis,
    Effect,
    EnvironmentDamping,
    Gravity,
    Inertia,
    MaterialDamping,
    RotaryInertia,
    TipLoad,
)
from softmpc.model.formulations import Formulation, NewtonEuler, VirtualPower
from softmpc.model.kinematics import PaperArc
from softmpc.model.model import Model
from softmpc.model.parameters import Section
from softmpc.model.scene import STRAINS

FORCE, MOMENT = (0.5, -1.0, 0.3), (0.05, 0.1, -0.08)
ALL = (
    Gravity(),
    Inertia(),
    Coriolis(),
    RotaryInertia(),
    EnvironmentDamping(),
    MaterialDamping(),
    TipLoad(FORCE, MOMENT),
)
NAMES = [effect.name for effect in ALL]
# What an effect needs beside it, and what else goes with it.
NEEDS = {"coriolis": ("inertia", "rotary_inertia"), "rotary_inertia": ("inertia", "coriolis")}
GOES = {"inertia": ("inertia", "coriolis", "rotary_inertia")}
FORMULATIONS: dict[str, Formulation] = {"virtual power": VirtualPower(), "printed": NewtonEuler()}
each_effect = pytest.mark.parametrize("name", NAMES)


@cache
def model(names: tuple[str, ...], formulation: str = "virtual power") -> Model:
    effects = tuple(effect for effect in ALL if effect.name in names)
    arc = {"kinematics": PaperArc()} if formulation == "printed" else {}
    return model_of(effects=effects, formulation=FORMULATIONS[formulation], **arc)


def without(name: str) -> tuple[str, ...]:
    return tuple(n for n in NAMES if n not in GOES.get(name, (name,)))


def alone(name: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The smallest scene with the effect, and the same without it."""
    needs = NEEDS.get(name, ())
    return (*needs, *GOES.get(name, (name,))), needs


def residual(names: tuple[str, ...], formulation: str, at: tuple[Array, ...]) -> Array:
    return numbers(model(names, formulation).residual(*at))


@pytest.mark.sampled
@each_effect
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_leaving_out_saves_instructions(name: str, formulation: str) -> None:
    """In the residual and its Jacobian, and never a structural nonzero more."""
    whole, part = model(tuple(NAMES), formulation), model(without(name), formulation)
    assert part.residual.n_instructions() < whole.residual.n_instructions()
    for k in range(4):
        sparse, dense = (m.residual.sparsity_jac(k, 0) for m in (part, whole))
        assert sparse.is_subset(dense)
    if formulation == "virtual power":
        fewer, all_ = part.residual_jacobian, whole.residual_jacobian
        assert fewer.n_instructions() < all_.n_instructions()
        assert all(fewer.sparsity_out(k).is_subset(all_.sparsity_out(k)) for k in range(4))
    assert part.layout.x.names == whole.layout.x.names


@pytest.mark.sampled
@pytest.mark.parametrize(
    "name, functions",
    [
        ("gravity", ("N", "balance", "stiffness", "equations")),
        ("tip_load", ("tau", "balance", "stiffness", "equations")),
        ("inertia", ("M", "C", "equations")),
        ("rotary_inertia", ("M", "C", "equations")),
        ("coriolis", ("C", "equations")),
        ("material_damping", ("C", "equations")),
        ("environment_damping", ("C", "equations")),
    ],
)
def test_every_term_is_leaner(name: str, functions: tuple[str, ...]) -> None:
    """Its own terms shrink, and those it has no part in do not move."""
    whole, part = model(tuple(NAMES)), model(without(name))
    for function in ("M", "C", "N", "tau", "equations", "balance", "stiffness", "frames"):
        few, all_ = (getattr(m, function).n_instructions() for m in (part, whole))
        # One instruction more or less: weight and inertia share a product.
        kept = few < all_ if function in functions else all_ - 1 <= few <= all_
        assert kept, (function, few, all_)


@each_effect
@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_leaving_out_changes_nothing_else(name: str, formulation: str) -> None:
    """An effect adds the same to the residual whatever else the scene has."""
    whole, small = model(tuple(NAMES), formulation), alone(name)
    states = States(whole)
    for _ in range(5):
        at = states.motion()
        among = residual(tuple(NAMES), formulation, at) - residual(without(name), formulation, at)
        by_itself = residual(small[0], formulation, at) - residual(small[1], formulation, at)
        assert np.abs(by_itself / whole.layout.r.scale).max() > 1e-5
        assert largest(among, by_itself, whole.layout.r.scale) < 1e-10


@each_effect
def test_effect_is_what_it_says(name: str) -> None:
    """Its share of the residual, from energies, powers and places: Lagrange and Rayleigh."""
    whole, states = model(tuple(NAMES)), States(model(tuple(NAMES)), 1)
    for _ in range(3):
        at = states.motion()
        share = residual(tuple(NAMES), "virtual power", at)
        share = share - residual(without(name), "virtual power", at)
        assert largest(share, SHARES[name](*at), whole.layout.r.scale) < 1e-8


def lagrange(energy: str, names: tuple[str, ...]) -> ca.Function:
    """d/dt ∂T/∂dq - ∂T/∂q of one energy of a model, as a function of (q, dq, ddq)."""
    m = model(names)
    q, dq, ddq = (ca.SX.sym(symbol, m.strains) for symbol in ("q", "dq", "ddq"))
    T = m.energies(q=q, dq=dq)[energy]
    momentum = ca.gradient(T, dq)
    rate = ca.jtimes(momentum, q, dq) + ca.jtimes(momentum, dq, ddq)
    return ca.Function("lagrange", [q, dq, ddq], [rate - ca.gradient(T, q)])


@cache
def kinetic(rotary: bool) -> ca.Function:
    return lagrange("kinetic", tuple(NAMES) if rotary else without("rotary_inertia"))


def rayleigh(power: str) -> Any:
    def force(q: Array, dq: Array, ddq: Array, p: Array) -> Array:
        m = model(tuple(NAMES))
        step = m.layout.dq.scale
        return -0.5 * differences(lambda v: m.powers(q=q, dq=v, p=p)[power], dq, step)[0]

    return force


def tip_load(q: Array, dq: Array, ddq: Array, p: Array) -> Array:
    """Virtual power of a force at the tip and a moment on its frame, by differences."""
    m = model(tuple(NAMES))
    step = 0.01 * m.layout.q.scale
    travel = differences(lambda x: m.frames(x)[0][:, -1], q, step)
    rates = differences(lambda x: m.frames(x)[1][:, -3:], q, step)
    rotation = np.asarray(m.frames(q)[1])[:, -3:]
    spins = [rates[:, :, j] @ rotation.T for j in range(m.strains)]
    moments = [s[2, 1] * MOMENT[0] + s[0, 2] * MOMENT[1] + s[1, 0] * MOMENT[2] for s in spins]
    return -np.asarray(FORCE) @ travel - np.array(moments)


def weight(q: Array, dq: Array, ddq: Array, p: Array) -> Array:
    """The gradient of the gravity potential; it counts as -T in Lagrange's equation."""
    return -numbers(lagrange("gravity", tuple(NAMES))(q, dq, ddq))


SHARES: dict[str, Any] = {
    "gravity": weight,
    "inertia": lambda q, dq, ddq, p: numbers(kinetic(True)(q, dq, ddq)),
    "coriolis": lambda q, dq, ddq, p: numbers(kinetic(True)(q, dq, 0 * ddq)),
    "rotary_inertia": lambda *at: numbers(kinetic(True)(*at[:3]) - kinetic(False)(*at[:3])),
    "environment_damping": rayleigh("environment_damping"),
    "material_damping": rayleigh("material_damping"),
    "tip_load": tip_load,
}


@pytest.mark.sampled
@pytest.mark.parametrize(
    "names, nonzeros",
    [
        ((), (20, 0, 0)),  # two blocks, where the energy couples ε to k, but not kx to ky
        (("material_damping",), (20, 8, 0)),
        (("gravity",), (64, 0, 0)),
        (("inertia",), (64, 0, 64)),
        (("inertia", "material_damping"), (64, 8, 64)),
        (("inertia", "coriolis"), (64, 64, 64)),
    ],
)
def test_structural_nonzeros(names: tuple[str, ...], nonzeros: tuple[int, ...]) -> None:
    m = model(names)
    found = [m.residual_jacobian.sparsity_out(k).nnz() for k in range(3)]
    assert all(a <= b for a, b in zip(found, nonzeros, strict=True)), found
    assert found[1:] == list(nonzeros[1:])
    assert m.M.sparsity_out(0).nnz() == nonzeros[2]
    assert m.C.sparsity_out(0).nnz() == nonzeros[1]
    assert [m.residual.sparsity_jac(k, 0).nnz() > 0 for k in range(3)] == [n > 0 for n in nonzeros]


def test_energies_and_powers_name_only_what_exists() -> None:
    assert model(()).energies.name_out() == ["elastic"]
    assert model(()).powers.name_out() == ["drive"]
    whole = model(tuple(NAMES))
    assert set(whole.energies.name_out()) == {"kinetic", "gravity", "elastic"}
    assert set(whole.powers.name_out()) == {
        "drive", "material_damping", "environment_damping", "load",
    }  # fmt: skip


def test_an_effect_of_size_zero_is_absent_too() -> None:
    """No coefficient, no instruction: a section without spin drag pays for no spin."""
    still = tuple(replace(s, linear_damping=0.0, angular_damping=0.0) for s in PAPER.sections)
    effects: tuple[Effect, ...] = (*LEAN, EnvironmentDamping())
    quiet = model_of(replace(PAPER, sections=still), effects=effects)
    assert quiet.residual.n_instructions() == model_of(effects=LEAN).residual.n_instructions()


# -------------------------------------------------------------------------------------- the drive


def test_drives_without_states_have_none() -> None:
    full, static, direct = (
        model_of(actuation=drive) for drive in (HydraulicDrive(), StaticDrive(), PressureDrive())
    )
    n = full.strains
    assert [len(m.layout.z) for m in (full, static, direct)] == [18, 0, 0]
    assert [len(m.layout.x) for m in (full, static, direct)] == [2 * n + 18, 2 * n, 2 * n]
    for m in (static, direct):
        assert m.drive.A.shape == (0, 0)
        assert m.x_dot.size1_out(0) == 2 * n
        assert m.residual.n_instructions() == full.residual.n_instructions()
    for m in (full, static, direct):
        columns = np.asarray(ca.DM(m.x_dot.sparsity_jac(0, 0))).any(axis=0)
        assert columns.all(), "an orphan state"
    assert direct.x_dot.n_instructions() < full.x_dot.n_instructions()


# ---------------------------------------------------------------------------------------- strains

SUBSETS = [s for size in (1, 2, 3) for s in combinations(STRAINS, size)]


@pytest.mark.sampled
@pytest.mark.parametrize("strains", SUBSETS, ids="-".join)
def test_strains_left_out_are_zero(strains: tuple[str, ...]) -> None:
    """Fewer states and instructions; the same rows as the full model held at zero strain."""
    full, part = model(tuple(NAMES)), model_of(effects=ALL, strains=strains)
    assert len(part.layout.q) == 2 * len(strains)
    assert part.residual.n_instructions() < full.residual.n_instructions()
    rows = [i for i, name in enumerate(full.layout.q.names) if name.rsplit("_", 2)[0] in strains]
    assert part.layout.q.names == tuple(full.layout.q.names[i] for i in rows)
    *motion, p = States(part).motion()
    held = [np.zeros(full.strains) for _ in motion]
    for whole, few in zip(held, motion, strict=True):
        whole[rows] = few
    scale = part.layout.r.scale
    wanted = numbers(full.residual(*held, p))[rows]
    assert largest(numbers(part.residual(*motion, p)), wanted, scale) < 1e-12
    few, all_ = part.residual_jacobian(*motion, p), full.residual_jacobian(*held, p)
    for k, (block, whole) in enumerate(zip(few, all_, strict=True)):
        wanted = np.asarray(whole)[np.ix_(rows, rows if k < 3 else range(len(p)))]
        assert_allclose(block, wanted, atol=1e-12 * max(np.abs(wanted).max(), 1e-9))
    assert_allclose(part.frames(motion[0])[0], full.frames(held[0])[0], atol=1e-15)


def test_effects_that_bring_the_same_coefficient_add_up() -> None:
    """An effect of one's own beside a built-in one: neither overwrites the other."""

    @dataclass(frozen=True)
    class Ballast(Effect):
        """A third of the arm's mass more, with its weight."""

        name: ClassVar[str] = "ballast"

        def on_body(self, section: Section, share: float) -> dict[str, float]:
            return {"mass": share * section.mass / 3, "heavy": share * section.mass / 3}

    sections = tuple(replace(s, mass=s.mass * 4 / 3) for s in PAPER.sections)
    heavy = model_of(replace(PAPER, sections=sections), effects=LEAN)
    loaded = model_of(effects=(*LEAN, Ballast()))
    state = States(loaded)
    q, dq, ddq, p = state.motion()
    expected = np.asarray(heavy.residual(q, dq, ddq, p))
    assert np.asarray(loaded.residual(q, dq, ddq, p)) == pytest.approx(expected, rel=1e-12)
    assert np.asarray(loaded.stiffness(q, p)[0]) == pytest.approx(
        np.asarray(heavy.stiffness(q, p)[0]), rel=1e-10, abs=1e-12
    )
