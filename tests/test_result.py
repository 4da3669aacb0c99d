"""A simulation's numbers by name, and its files."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from arms import SMALL, arm, model_of

from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive, SlowDrive
from softmpc.simulation.inputs import InputProfile, Ramp, Step
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import simulate

MOVES = {
    "hydraulic": (model_of(), InputProfile.of(6, [Step(1, 0.02, 1.0), Ramp(5, 0.0, 0.05, 9.0)])),
    "pressure": (
        model_of(arm(SMALL), actuation=PressureDrive(), segments=2),
        InputProfile.of(4, [Step(3, 0.0, 2e5)]),
    ),
    "slow-mode": (model_of(actuation=SlowDrive()), InputProfile.constant([0.5] * 6)),
}


@cache
def motion(kind: str) -> Simulation:
    return simulate(*MOVES[kind], 0.1, title=f"a {kind} motion")


@pytest.fixture(autouse=True)
def _interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Motions of a tenth of a second: compiling would take longer."""
    monkeypatch.setenv("SOFTMPC_COMPILE", "never")


def test_columns_by_name() -> None:
    run = motion("hydraulic")
    names = MOVES["hydraulic"][0].layout.q.names
    for name in names:
        np.testing.assert_array_equal(run[name], run.q[:, names.index(name)])
    np.testing.assert_array_equal(run["t"], run.time)
    np.testing.assert_array_equal(run["z_2"], run.tips[:, 1, 2])
    np.testing.assert_array_equal(run["tip_speed_1"], run.tip_speeds[:, 0])
    np.testing.assert_array_equal(run["P_5"], run.p[:, 4])
    np.testing.assert_array_equal(run["elastic_energy"], run.energies["elastic"])
    with pytest.raises(InputError, match=r"unknown column: 'kapa_y_1_1'; did you mean 'kappa_y_1"):
        run["kapa_y_1_1"]


def test_units_of_columns() -> None:
    units = motion("hydraulic").units
    wanted = {"t": "s", "x_1": "m", "tip_speed_2": "m/s", "epsilon_1_1": "", "kappa_x_2_1": "1/m"}
    wanted |= {"d_kappa_x_2_1": "1/m/s", "T_6": "N·m", "P_a_3": "Pa", "kinetic_energy": "J"}
    assert {name: units[name] for name in wanted} == wanted
    assert len(units) == len(motion("hydraulic").columns())


@pytest.mark.sampled
@pytest.mark.parametrize("kind", MOVES)
def test_both_files_read_back(kind: str, tmp_path: Path) -> None:
    run = motion(kind)
    for file in run.save(tmp_path):
        back = Simulation.load(file)
        assert list(back.columns()) == list(run.columns())
        for name in ("q", "dq", "z", "u", "p", "tips", "tip_speeds"):
            np.testing.assert_array_equal(getattr(back, name), getattr(run, name))
        assert back.titles == run.titles
        assert set(back.energies) == set(run.energies)


def test_npz_knows_inputs_and_csv_does_not(tmp_path: Path) -> None:
    run = motion("hydraulic")
    table, whole = (Simulation.load(file) for file in run.save(tmp_path))
    assert whole.profile is not None
    assert run.profile is not None
    times = np.linspace(0, 0.1, 77)
    np.testing.assert_array_equal(whole.profile(times), run.profile(times))
    np.testing.assert_array_equal(whole.profile.breakpoints, run.profile.breakpoints)
    assert (table.profile, table.status, table.title) == (None, "unknown", "simulation")
    assert np.isnan(table.wall_s)
    assert not table.finished


def test_csv_files_that_are_none(tmp_path: Path) -> None:
    file = tmp_path / "other.csv"
    file.write_text("t,x_1,y_1,z_1\n0,0,0,0\n1,0,0,0\n")
    with pytest.raises(InputError, match="is not a saved simulation: has no columns of a sim"):
        Simulation.load(file)
    file.write_text("t,tip_speed_1,x_1,y_1\n0,0,0,0\n1,0,0,0\n")
    with pytest.raises(InputError, match="is not a saved simulation: has no column z_1"):
        Simulation.load(file)
    with pytest.raises(InputError, match="no such file"):
        Simulation.load(tmp_path / "none.csv")


def test_older_npz_files_lack_inputs(tmp_path: Path) -> None:
    _, file = motion("hydraulic").save(tmp_path)
    with np.load(file) as content:
        fields = {k: v for k, v in content.items() if not k.startswith("input_")}
    fields["about"] = np.array(str(fields["about"]).replace('"schema": 2', '"schema": 1'))
    np.savez(file, **fields)  # type: ignore[arg-type]
    assert Simulation.load(file).profile is None
    fields["about"] = np.array(str(fields["about"]).replace('"schema": 1', '"schema": 3'))
    np.savez(file, **fields)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="is of another version; 1 and 2 are known here"):
        Simulation.load(file)
