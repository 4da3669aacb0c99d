"""What sensors can tell: by name, and in numbers against other ways to count."""

from __future__ import annotations

import logging
from collections.abc import Sequence

import control
import numpy as np
import pytest

from softmpc import InputError, Scene, build, chen2022
from softmpc.control.closed_loop import Start, start_at
from softmpc.estimation.estimator import Estimator
from softmpc.estimation.observability import Linear, Observability, linear_at, observability
from softmpc.estimation.process import Process, ProcessNoise
from softmpc.estimation.sensors import SectionTips, Sensor, UnitPressures
from softmpc.model.actuation import PressureDrive
from softmpc.model.disturbance import SEEN, Disturbance
from softmpc.model.model import Model
from softmpc.model.scene import STRAINS
from softmpc.statics.equilibrium import find_equilibrium

POSTURES = {"straight": [0.0] * 6, "bent": [3e5, 1e5, 0, 2e5, 0, 4e5]}
BOTH: tuple[Sensor, ...] = (SectionTips(), UnitPressures())
TIPS = BOTH[:1]
LAST: tuple[Sensor, ...] = (SectionTips(sections=(2,)), UnitPressures())


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


def start_of(model: Model, posture: str) -> Start:
    return start_at(model, find_equilibrium(model, POSTURES[posture]))


def process_of(model: Model, strains: Sequence[str], inputs: bool | None = None) -> Process:
    disturbance = Disturbance.of(model.scene, strains, inputs)
    return Process(model, disturbance, ProcessNoise(), "never")


def seen(process: Process, sensors: Sequence[Sensor], posture: str = "straight") -> Observability:
    readings = [sensor.reading(process.model) for sensor in sensors]
    at = start_of(process.model, posture)
    return observability(process, sensors, readings, at.x, at.u)


def linear(process: Process, sensors: Sequence[Sensor], posture: str) -> Linear:
    readings = [sensor.reading(process.model) for sensor in sensors]
    at = start_of(process.model, posture)
    return linear_at(process, sensors, readings, at.x, at.u)


def names(found: Observability) -> set[str]:
    return {name for one in found.undetectable for name in one.variables}


# ---------------------------------------------------------------- by name


@pytest.mark.parametrize("posture", POSTURES)
def test_tips_and_pressures_tell_forces_and_offsets(model: Model, posture: str) -> None:
    found = seen(process_of(model, SEEN), BOTH, posture)
    assert found.offset_free and found.rank == found.needed == found.outputs == 12
    assert found.disturbances == () and found.weak_disturbances() == []
    assert found.rest[-1] > 50  # deviations of a set of readings


@pytest.mark.parametrize("posture", POSTURES)
def test_tips_alone_cannot_tell_offsets_from_forces(model: Model, posture: str) -> None:
    found = seen(process_of(model, SEEN), TIPS, posture)
    assert found.outputs == 6 and found.rank == 6 and not found.offset_free
    assert len(found.undetectable) == 6
    assert {"offset of T_1", "force on kappa_y_1"} <= names(found)
    assert seen(process_of(model, SEEN, inputs=False), TIPS, posture).offset_free
    with pytest.raises(InputError, match=r"6 of 12 .* add .* UnitPressures or \[rig.unit_p"):
        found.require_detectable()


def test_twist_dies_away_unseen(model: Model) -> None:
    """In a straight arm no tip moves with it. Bent, those below do."""
    straight, bent = (seen(process_of(model, SEEN), BOTH, posture) for posture in POSTURES)
    assert [{name.rsplit("_", 2)[0] for name in one.variables} for one in straight.states] == [
        {"kappa_z", "d_kappa_z"}
    ]
    assert "twist, with which tips" in straight.weak_states()[0]
    assert bent.states == ()


@pytest.mark.parametrize(
    ("posture", "lost"),
    [("straight", {"force on kappa_z_1", "force on kappa_z_2"}), ("bent", {"force on kappa_z_2"})],
)
def test_a_force_on_twist_is_refused(model: Model, posture: str, lost: set[str]) -> None:
    """The last section's is never seen by tips; that of the first where the second is bent."""
    process, at = process_of(model, STRAINS), start_of(model, posture)
    found = seen(process, BOTH, posture)
    assert lost <= names(found) and found.rank == 12 and found.needed == 14
    with pytest.raises(InputError, match="leave kappa_z out of the disturbance"):
        Estimator(process, BOTH, at=(at.x, at.u))


@pytest.mark.parametrize("posture", POSTURES)
def test_a_camera_on_the_last_section_alone(model: Model, posture: str) -> None:
    """Three values for six forces: what the two sections share is seen, what they do not is not."""
    found = seen(process_of(model, SEEN), LAST, posture)
    assert found.outputs == 9 and found.rank == 9 and len(found.undetectable) == 3
    assert all(name.startswith("force on") for name in names(found))
    few = seen(process_of(model, ("epsilon",)), LAST, posture)
    assert few.outputs == 9 and few.needed == 8


def test_a_camera_that_sees_nothing(model: Model) -> None:
    found = seen(process_of(model, SEEN), (SectionTips(dropout=1.0), UnitPressures()))
    assert found.outputs == 6 and found.rank == 6
    assert names(found) == {f"force on {kind}_{s}" for kind in SEEN for s in (1, 2)}
    with pytest.raises(InputError, match="let a sensor look at that section"):
        found.require_detectable()


def test_weak_ones_are_said(model: Model, caplog: pytest.LogCaptureFixture) -> None:
    """A camera with 0.2 m of noise: seen in the end, but hardly."""
    with caplog.at_level(logging.INFO, logger="softmpc.estimation.observability"):
        poor = SectionTips(noise=0.2, sections=(1, 2))
        estimator = Estimator(process_of(model, ("kappa_x", "kappa_y")), (poor, UnitPressures()))
    found = estimator.observability
    assert found.undetectable == () and not found.offset_free
    assert 0.1 < found.disturbances[0].deviation < 0.5
    levels = {record.levelname for record in caplog.records}
    assert levels == {"WARNING", "INFO"}
    assert "force on kappa" in caplog.text and "twist, with which" in caplog.text


def test_no_disturbance_no_condition(model: Model) -> None:
    found = seen(process_of(model, (), inputs=False), TIPS)
    assert found.needed == 0 and found.offset_free and found.disturbances == ()
    found.require_detectable()


# ---------------------------------------------------------------- in numbers


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("strains", "sensors"),
    [
        (("kappa_x", "kappa_y"), TIPS),
        (SEEN, TIPS),
        (SEEN, (SectionTips(sections=(2,)),)),
        (("epsilon", "kappa_z"), TIPS),
    ],
)
@pytest.mark.parametrize("posture", POSTURES)
def test_against_the_rank_of_observability_matrices(
    strains: tuple[str, ...], sensors: tuple[Sensor, ...], posture: str
) -> None:
    """An arm without drive, small enough for the textbook's matrix [C; CA; CA²; …], made by
    python-control, and for [A - I, B_d; C, C_d]: both lose what is unseen."""
    model = build(
        Scene(chen2022(), strains=("epsilon", "kappa_x", "kappa_y"), actuation=PressureDrive())
    )
    if "kappa_z" in strains:
        model = build(Scene(chen2022(), actuation=PressureDrive()))
    process = process_of(model, strains)
    found, at = seen(process, sensors, posture), linear(process, sensors, posture)
    nx, nd = at.nx, len(process.disturbance)
    whitened = at.H / np.sqrt(at.R)[:, None]
    A, B, C, D = at.A[:nx, :nx], at.A[:nx, nx:], whitened[:, :nx], whitened[:, nx:]
    condition = np.block([[A - np.eye(nx), B], [C, D]])
    lost = nx + nd - np.linalg.matrix_rank(condition, tol=1e-6)
    assert lost == found.needed - found.rank == len(found.undetectable)
    # Powers of several steps tell the slow directions apart that rounding would mix.
    slow = np.linalg.matrix_power(at.A, 5)
    matrix = np.asarray(control.obsv(slow, whitened))
    unseen = process.size - np.linalg.matrix_rank(matrix, tol=1e-3)
    assert unseen >= lost
    null = np.linalg.svd(matrix)[2][process.size - unseen :]
    lasting = np.linalg.matrix_rank(null[:, nx:], tol=1e-2)
    assert lasting == lost


@pytest.mark.parametrize("posture", POSTURES)
def test_what_a_disturbance_does_at_rest(model: Model, posture: str) -> None:
    """Singular values against readings of the arm at two rests, by statics."""
    process, at = process_of(model, SEEN), start_of(model, posture)
    found = seen(process, BOTH, posture)
    readings = [sensor.reading(model) for sensor in BOTH]
    n, deviations = model.strains, np.repeat([5e-4, 5e3], 6)
    # Per step of 20 ms, two readings of 100 Hz are as good as one with half the variance.
    deviations = deviations / np.sqrt(2.0)
    columns = []
    for d in 1e-4 * np.eye(12):
        moved = []
        for sign in (1, -1):
            u = at.u + sign * process.disturbance.G @ d
            q, p = at.x[:n].copy(), model.drive.static_gain @ u
            for _ in range(20):  # Newton on N(q) - τ(q, p) = F d
                K = np.asarray(model.stiffness(q, p)[0])
                off = np.asarray(model.balance(q, p)).ravel() - sign * process.disturbance.F @ d
                q = q - np.linalg.solve(K, off)
            x = np.concatenate([q, 0 * q, model.drive_rest(u, q)])
            moved.append(np.concatenate([reading(x, u)[0] for reading in readings]))
        columns.append((moved[0] - moved[1]) / 2e-4 / deviations)
    expected = np.linalg.svd(np.array(columns).T, compute_uv=False)
    assert np.allclose(found.rest, expected, rtol=1e-3)
