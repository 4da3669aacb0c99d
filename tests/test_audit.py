"""The energy balance closes on every kind of scene, and does not where something is wrong."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import PAPER, SMALL, arm, model_of
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive, SlowDrive, StaticDrive
from softmpc.model.drive_effects import (
    BackDriving,
    Cavitation,
    ChamberCoupling,
    EndStops,
    RotorInertia,
    TubeInertance,
)
from softmpc.model.effects import (
    AddedMass,
    Buoyancy,
    Contact,
    Coriolis,
    Effect,
    EnvironmentDamping,
    FluidDrag,
    Gravity,
    MaterialDamping,
    Payload,
    TipLoad,
    WaterMass,
)
from softmpc.model.elasticity import StrainElasticity
from softmpc.model.formulations import VirtualPower
from softmpc.model.model import Model
from softmpc.model.obstacles import Plane
from softmpc.simulation.audit import Audit, audit
from softmpc.simulation.hermite import Hermite
from softmpc.simulation.inputs import InputProfile, Ramp, Step
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import simulate, simulate_file

EXAMPLES = Path(__file__).parent.parent / "examples"
EFFECTS = model_of().scene.effects
# Jumps and corners between the samples, which are 0.01 s apart.
MOVES = ((1, 0.0137, 1.0), (1, 0.2051, 0.3), (4, 0.25, 0.8))


@pytest.fixture(autouse=True)
def _interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many models, each moved once: compiling them would take longer than it saves."""
    monkeypatch.setenv("SOFTMPC_COMPILE", "never")


def profile(size: float) -> InputProfile:
    steps = [Step(unit, at, size * to) for unit, at, to in MOVES]
    return InputProfile.of(6, [*steps, Ramp(5, 0.05, 0.1333, 10.0 * size)])


def run(model: Model, duration: float = 0.4, **options: Any) -> Simulation:
    size = 1.0 if model.scene.actuation.input == "torque" else 0.4e6
    return simulate(model, profile(size), duration, **{"tip_tolerance": 1e-7, **options})


@cache
def moved() -> tuple[Model, Simulation]:
    model = model_of()
    return model, run(model)


def frictionless() -> Model:
    still = {"linear_damping": 0.0, "angular_damping": 0.0, "viscosity": 0.0}
    return model_of(replace(PAPER, sections=tuple(replace(s, **still) for s in PAPER.sections)))


SCENES: dict[str, Any] = {
    "undamped": frictionless,
    "dead force": lambda: model_of(effects=(*EFFECTS, TipLoad(force=(3.0, 2.0, -4.0)))),
    "dead moment": lambda: model_of(
        effects=(*EFFECTS, TipLoad(force=(3.0, 2.0, -4.0), moment=(0.3, 0.5, -0.2)))
    ),
    "pressures jump": lambda: model_of(actuation=PressureDrive()),
    "static gain": lambda: model_of(actuation=StaticDrive()),
    "slow mode": lambda: model_of(actuation=SlowDrive()),
    "no inertia": lambda: model_of(effects=(Gravity(), EnvironmentDamping(), MaterialDamping())),
    "no inertia, pressures jump": lambda: model_of(
        effects=(Gravity(), MaterialDamping()), actuation=PressureDrive()
    ),
    "two segments a section": lambda: model_of(segments=2),
}


@pytest.mark.sampled
@pytest.mark.parametrize("scene", SCENES)
def test_balance_closes(scene: str) -> None:
    model = SCENES[scene]()
    motion = run(model)
    assert motion.finished
    found = audit(model, motion)
    assert found.turnover > 1.0
    assert found.closure < 1e-6
    assert set(found.energies) == set(model.energies.name_out())
    assert set(found.works) == set(model.powers.name_out())
    assert not found.missing


def test_balance_closes_on_a_tiny_arm() -> None:
    """Its motions are as small as what is exact for a long one."""
    model = model_of(arm(replace(PAPER.sections[0], length=0.002)))
    motion = simulate(model, InputProfile.of(3, [Step(1, 0.0, 0.5)]), 0.1, tip_tolerance=1e-9)
    assert audit(model, motion).closure < 1e-4


def test_balance_closes_over_hydraulics() -> None:
    found = audit(*moved())
    assert found.closure < 1e-7
    assert np.array_equal(found.time, moved()[1].time)
    assert found.works["environment_damping"][-1] < -0.1
    assert np.all(np.diff(found.works["material_damping"]) <= 1e-12)
    assert found.summary()["work_j"]["drive"] == found.works["drive"][-1]


@pytest.mark.slow
def test_balance_closes_on_figure_6() -> None:
    """Default sampling; within the integrator's tolerance, and to 1e-6 with a tighter one."""
    path = EXAMPLES / "step_fig6.toml"
    model = model_of()
    for options, closure in (({}, 1e-5), ({"tip_tolerance": 1e-6}, 1e-6)):
        assert audit(model, simulate_file(path, **options)).closure < closure


def test_rest_is_no_turnover() -> None:
    model = model_of()
    found = audit(model, simulate(model, InputProfile.constant([1.0] * 6), 0.1))
    assert found.closure < 1e-6


BEYOND: dict[str, tuple[Effect, ...]] = {
    "under water": (Buoyancy(), FluidDrag(), AddedMass()),
    "water and payload": (WaterMass(), Payload()),
    "contact": (Contact(obstacles=(Plane(point=(0.0, 0.0, 0.52), normal=(0.0, 0.0, -1.0)),)),),
    "tube": (TubeInertance(), RotorInertia(), Cavitation()),
    "back-driving": (BackDriving(), EndStops()),
    "coupling": (ChamberCoupling(),),
}


@pytest.mark.sampled
@pytest.mark.parametrize("effects", BEYOND)
def test_balance_closes_with_effects_beyond_the_paper(effects: str) -> None:
    model = model_of(effects=(*EFFECTS, *BEYOND[effects]))
    motion = run(model, 0.08)
    assert motion.finished
    found = audit(model, motion)
    assert found.closure < 1e-6
    assert set(found.works) == set(model.powers.name_out())


# ---------------------------------------------------------------- what it finds


def test_work_of_the_drive_against_quadrature() -> None:
    """One section, four units: W = Σ ∫ P_j dV_j, from volumes written anew, by SciPy's quad."""
    model = model_of(arm(SMALL), actuation=PressureDrive())
    moves = InputProfile.of(4, [Ramp(1, 0.0, 0.1, 4e6), Ramp(3, 0.03, 0.13, 2e6)])
    found = audit(model, simulate(model, moves, 0.2, tip_tolerance=1e-8))
    fine = simulate(model, moves, 0.2, sample_time=2e-4, tip_tolerance=1e-9)
    q = CubicSpline(fine.time, fine.q)
    angles = np.radians([10.0, 100.0, 190.0, 280.0])

    def power(t: float, j: int) -> float:
        ramp = (4e6 * min(t, 0.1), 0.0, 2e6 * min(max(t - 0.03, 0.0), 0.1), 0.0)[j]
        x, y = 0.012 * np.cos(angles[j]), 0.012 * np.sin(angles[j])
        (e, kx, ky, _), (de, dkx, dky, _) = q(t), q(t, 1)
        stretch = de * (1 + kx * y - ky * x) + (1 + e) * (dkx * y - dky * x)
        return float(ramp * 2.0e-4 * 0.15 * stretch)

    corners = [0.03, 0.1, 0.13]
    work = sum(quad(power, 0, 0.2, args=(j,), points=corners, limit=400)[0] for j in (0, 2))
    assert work > 0.1
    assert found.works["drive"][-1] == pytest.approx(work, rel=2e-6)


@pytest.mark.parametrize(("field", "size"), [("q", 1e-4), ("dq", 1e-3)])
def test_a_wrong_state_opens_the_balance(field: str, size: float) -> None:
    model, motion = moved()
    wrong = getattr(motion, field).copy()
    wrong[20] *= 1 + size
    found = audit(model, replace(motion, **{field: wrong}))
    assert found.closure > 1e-5
    assert abs(found.error[20] - found.error[19]) > 1e-5 * found.turnover


@pytest.mark.slow
def test_a_missing_power_opens_the_balance() -> None:
    model, motion = moved()
    deaf = copy.copy(model)
    names = [name for name in model.powers.name_out() if name != "material_damping"]
    symbols = [ca.MX.sym(name, model.powers.size_in(name)) for name in model.powers.name_in()]
    powers = model.powers.call(dict(zip(model.powers.name_in(), symbols, strict=True)))
    less = ca.Function("less", symbols, [powers[n] for n in names], ["q", "dq", "p"], names)
    deaf.__dict__["powers"] = less
    lost = -audit(model, motion).works["material_damping"][-1]
    found = audit(deaf, motion)
    assert found.error[-1] == pytest.approx(-lost, rel=1e-5)
    assert found.closure > 1e-2


def test_wrong_inputs_open_the_balance() -> None:
    model, motion = moved()
    assert audit(model, motion, InputProfile.of(6, [Step(1, 0.0237, 1.0)])).closure > 1e-3


@pytest.mark.slow
def test_terms_without_an_energy_are_named() -> None:
    model = model_of(formulation=VirtualPower(elasticity=StrainElasticity()))
    found = audit(model, run(model, 0.1))
    assert found.missing == ("elastic: the elastic law 'strain' has no energy; take 'energy'",)
    assert np.isnan(found.closure)
    assert found.summary()["closure"] is None
    assert "error [J]" not in found.columns()
    slow = model_of(effects=tuple(e for e in EFFECTS if not isinstance(e, Coriolis)))
    assert "without the effect 'coriolis'" in audit(slow, run(slow, 0.1)).missing[0]


def test_an_arm_that_jumps_has_no_balance() -> None:
    model = model_of(effects=(Gravity(),))
    motion = run(model, 0.02, tip_tolerance=None)
    found = audit(model, motion)
    (reason,) = found.missing
    assert reason.startswith("work: an arm without inertia and damping has no motion of its own")
    assert np.isnan(found.closure) and found.works == {}
    np.testing.assert_array_equal(found.energies["gravity"], motion.energies["gravity"])
    assert list(found.columns()) == ["t [s]", "gravity_energy [J]", "elastic_energy [J]"]


def test_what_cannot_be_audited() -> None:
    model, motion = moved()
    with pytest.raises(InputError, match="does not know its inputs: give audit their profile"):
        audit(model, replace(motion, profile=None))
    with pytest.raises(InputError, match="a simulation of 34 states: this model has 22"):
        audit(model_of(actuation=SlowDrive()), motion)


def test_a_motion_that_has_not_begun() -> None:
    model, motion = moved()
    arrays = ("time", "q", "dq", "z", "u", "p", "tips", "tip_speeds")
    first = replace(motion, **{name: getattr(motion, name)[:1] for name in arrays})
    assert audit(model, first).closure == 0.0


def test_saved_motions_know_their_inputs(tmp_path: Path) -> None:
    model, motion = moved()
    back = Simulation.load(motion.save(tmp_path)[1])
    assert audit(model, back).closure == audit(model, motion).closure


# ---------------------------------------------------------------- between the samples


def test_polynomials_are_exact_up_to_their_degree() -> None:
    random = np.random.default_rng(1)
    wanted = [np.polynomial.Polynomial(random.normal(size=8)) for _ in range(3)]
    ends = np.array([0.0, 0.3, 1.1, 1.2])
    derivatives = [np.stack([p.deriv(k)(ends) for p in wanted], 1) for k in range(4)]
    found = Hermite.of(np.diff(ends), [d[:-1] for d in derivatives], [d[1:] for d in derivatives])
    piece, since = np.array([0, 1, 2]), np.array([[0.1, 0.2], [0.3, 0.7], [0.0, 0.05]])
    values, rates = found(piece, since)
    for k, p in enumerate(wanted):
        np.testing.assert_allclose(values[..., k], p(ends[piece, None] + since), atol=1e-10)
        np.testing.assert_allclose(rates[..., k], p.deriv()(ends[piece, None] + since), atol=1e-8)


def test_audit_adds_up() -> None:
    """Three samples by hand."""
    time = np.arange(3.0)
    energies = {"kinetic": np.array([1.0, 3.0, 2.0]), "elastic": np.array([0.0, 1.0, 4.0])}
    works = {"drive": np.array([0.0, 3.5, 6.0]), "drag": np.array([0.0, -0.5, -0.75])}
    found = Audit(time, energies, works, (), 1e-9)
    assert found.error.tolist() == [0.0, 0.0, -0.25]
    assert (found.turnover, found.closure) == (6.0, 0.25 / 6)
    assert list(found.columns()) == [
        "t [s]", "kinetic_energy [J]", "elastic_energy [J]", "drive_work [J]", "drag_work [J]",
        "error [J]",
    ]  # fmt: skip
