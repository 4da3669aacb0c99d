"""The simulated rig with a plant that stands still: what is read, when, and what acts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from softmpc import InputError, Scene, build, chen2022
from softmpc.estimation.sensors import MotorTorque, SectionTips, Sensor, UnitPressures
from softmpc.model.model import Model
from softmpc.rig.faults import (
    FAULTS,
    Absent,
    Fault,
    Frozen,
    NotANumber,
    PayloadDropped,
    Scaled,
    Spike,
    Stuck,
)
from softmpc.rig.machine import Link, Machine


class Still:
    """A plant that keeps its state, and says how often it was asked."""

    def __init__(self, model: Model, shift: float = 0.0) -> None:
        self.model, self.shift = model, shift
        self.inputs: list[tuple[int, np.ndarray]] = []

    def advance(
        self, x: Any, u: Any, duration: float, samples: int = 1, u_end: Any = None
    ) -> np.ndarray:
        self.inputs.append((samples, np.array(u)))
        return np.tile(x + self.shift, (samples, 1))

    def prepare(self) -> None:
        """Nothing to make."""


@pytest.fixture(scope="module")
def model() -> Model:
    return build(Scene(chen2022()))


def machine(
    model: Model, *faults: Fault, sensors: tuple[Sensor, ...] = (), link: Link | None = None
) -> Machine:
    sensors = sensors or (SectionTips(latency=0.007, noise=1e-4), UnitPressures(rate=200.0))
    plants = {"": Still(model), "payload_dropped": Still(model, 1.0)}
    made = Machine(plants, sensors, link, faults, seed=4)
    made.reset(np.zeros(34), np.zeros(6))
    return made


def test_readings_come_at_their_rate_and_late(model: Model) -> None:
    rig = machine(model)
    seen = []
    for _ in range(60):
        seen += [(rig.tick, one) for one in rig.arrived()]
        rig.run(1)
    tips = [(now, one.stamp) for now, one in seen if one.sensor == 0]
    pressures = [(now, one.stamp) for now, one in seen if one.sensor == 1]
    assert tips == [(10 * k + 7, 10 * k) for k in range(6)]
    assert pressures == [(5 * k, 5 * k) for k in range(12)]


def test_noise_and_bias(model: Model) -> None:
    quiet = SectionTips(noise=0.0, bias=(0.1, 0, 0, 0, 0, -0.2))
    rig = machine(model, sensors=(quiet, UnitPressures(noise=5e3, rate=1000.0)))
    rig.run(2000)
    readings = rig.arrived()
    tips = np.array([one.value for one in readings if one.sensor == 0])
    tip = np.asarray(model.frames(np.zeros(8))[0]).T.ravel()
    assert np.allclose(tips - tip, [0.1, 0, 0, 0, 0, -0.2], atol=1e-12)
    pressures = np.array([one.value for one in readings if one.sensor == 1])
    assert abs(pressures.std() / 5e3 - 1) < 0.05 and abs(pressures.mean()) < 200


def test_dropout(model: Model) -> None:
    rig = machine(model, sensors=(UnitPressures(rate=1000.0, dropout=0.3),))
    rig.run(3000)
    assert abs(len(rig.arrived()) / 3000 - 0.7) < 0.03


def test_one_more_sensor_changes_no_other(model: Model) -> None:
    found = []
    for more in ((), (MotorTorque(),)):
        rig = machine(model, sensors=(SectionTips(), UnitPressures(), *more))
        rig.run(100)
        found.append([one.value for one in rig.arrived() if one.sensor < 2])
    assert np.array_equal(found[0], found[1])


def test_commands_are_late(model: Model) -> None:
    rig = machine(model, link=Link(delay=0.008))
    rig.command(np.full(6, 1.0))
    rig.run(25)
    rig.command(np.full(6, 2.0))
    rig.run(25)
    plant = rig.plants[""]
    assert isinstance(plant, Still)
    assert [(n, u[0]) for n, u in plant.inputs] == [(8, 0), (17, 1), (8, 1), (17, 2)]


def test_commands_are_lost(model: Model) -> None:
    rig = machine(model, link=Link(lost=0.25))
    for k in range(400):
        rig.command(np.full(6, float(k)))
    assert abs(rig.lost / 400 - 0.25) < 0.07
    rig.run(1)
    assert rig.acting[0] > 0


def test_motors(model: Model) -> None:
    rig = machine(
        model, Stuck(0.010, 0.010, units=(2,)), Scaled(0.010, 0.010, units=(1, 3), factor=0.5)
    )
    acted = []
    for k in range(6):
        rig.command(np.full(6, float(k + 1)))
        acted.append(rig.run(5)[1][0])
    acting = np.array(acted)
    assert acting[:, 3].tolist() == [1, 2, 3, 4, 5, 6]
    assert acting[:, 1].tolist() == [1, 2, 2, 2, 5, 6]
    assert acting[:, 0].tolist() == acting[:, 2].tolist() == [1, 2, 1.5, 2, 5, 6]
    with pytest.raises(InputError, match="units"):
        machine(model, Stuck(0, 1, units=(7,)))
    with pytest.raises(InputError, match="no sensor 'motor_torque'"):
        machine(model, Absent(0, 1, sensor="motor_torque"))


def test_payload(model: Model) -> None:
    rig = machine(model, PayloadDropped(0.010, 0.005))
    states, _ = rig.run(20)
    assert states[:, 0].tolist() == [0.0] * 10 + [1.0] * 5 + [1.0] * 5
    assert [n for n, _ in rig.plants["payload_dropped"].inputs] == [5]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("fault", "count"),
    [(NotANumber(0.05, 0.05), 10), (Frozen(0.05, 0.05), 10), (Absent(0.05, 0.05), 5),
     (Spike(0.05, 0.05, size=0.3), 10)],
)  # fmt: skip
def test_sensors(model: Model, fault: Fault, count: int) -> None:
    usual, wrong = machine(model), machine(model, fault)
    for rig in (usual, wrong):
        rig.run(109)
    good, bad = (
        {one.stamp: one.value for one in rig.arrived() if one.sensor == 0} for rig in (usual, wrong)
    )
    inside = [stamp for stamp in good if 50 <= stamp < 100]
    assert len(good) == 11 and len(bad) == count + 1
    for stamp in set(good) - set(inside):
        assert np.array_equal(good[stamp], bad[stamp])
    for stamp in inside if fault.name != "absent" else []:
        wanted = {
            "nan": np.full(6, np.nan), "frozen": good[40], "spike": good[stamp] + 0.3,
        }[fault.name]  # fmt: skip
        assert np.array_equal(bad[stamp], wanted, equal_nan=True)


def test_wrong_faults() -> None:
    with pytest.raises(InputError, match="section_tip"):
        Frozen(1.0, 1.0, sensor="camera")
    for kind in FAULTS.values():
        with pytest.raises(InputError, match="start"):
            kind(-1.0, 1.0)
        with pytest.raises(InputError, match="duration"):
            kind(1.0, float("nan"))
