"""The monitor in Python against what other rooms say; workspaces that it takes, and a program."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from arms import PAPER, arm
from c_monitor import BACK_OFF, GRID, model, pressure_driven, space, steps, tilted
from click.testing import CliRunner
from codegen_line import NOT_OPTIMISED, make, on_make, run
from scipy.spatial import cKDTree

from softmpc.cli.main import main
from softmpc.codegen.monitor import Monitor, margins
from softmpc.codegen.monitor_data import monitor_files
from softmpc.control.step import Step
from softmpc.control.tracking import read_track_file, set_up
from softmpc.errors import InputError
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.rig.rigging import _back_off
from softmpc.statics.workspace import find_workspace

# ---------------------------------------------------------------- against other rooms


def test_margins_are_distances_to_the_surfaces() -> None:
    """Against the nearest of very many places on the edge, in all directions."""
    shell = space().shell
    assert shell is not None
    azimuths = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    rims, *sides = shell.between(azimuths)
    fine = replace(shell, nodes=np.linspace(0, 1, 200))
    edge = [
        fine.places(
            azimuths, rims, np.array([np.interp(fine.nodes, shell.nodes, row) for row in radii])
        )
        for radii in sides
    ]
    random = np.random.default_rng(3)
    tips = space().samples.tips
    places = tips[random.integers(0, len(tips), 3000)] + random.normal(size=(3000, 3)) * 0.02
    found, (away, _) = margins(shell, places), cKDTree(np.reshape(edge, (-1, 3))).query(places)
    for sign in (1, -1):
        some = sign * found > 3e-3
        ratio = sign * found[some] / away[some]
        print(f"{sign:+d}: {some.sum()} places, ratio {np.quantile(ratio, [0, 0.5, 0.95, 1])}")
        assert some.sum() > 300 and abs(np.median(ratio) - 1) < 0.05
        assert np.quantile(ratio, 0.05) > 0.9 and np.quantile(ratio, 0.95) < 1.2


def test_the_axis_is_an_edge_only_where_it_is_out_of_reach() -> None:
    on_axis = margins(space().shell, [[0.0, 0.0, 0.33]])[0]
    assert on_axis == pytest.approx(min(0.41693999 - 0.33, 0.33 - 0.25048537), abs=1e-7)
    assert margins(tilted().shell, 0.25 * tilted().frame[:, 2])[0] < -0.05


def test_back_off_is_that_of_a_rig() -> None:
    pressures = np.random.default_rng(4).uniform(-0.02e6, 1.02e6, (50, 3))
    settings = SimpleNamespace(back_off=BACK_OFF, strains=())
    setup = SimpleNamespace(
        task=SimpleNamespace(controller=settings), plant=SimpleNamespace(model=model())
    )
    monitor, none = Monitor(model(), BACK_OFF), Monitor(model())
    drive, n = model().drive, model().strains
    for p in pressures:
        u = np.linalg.solve(drive.static_gain, p)
        x = np.concatenate([np.zeros(2 * n), drive.at_rest(u)])
        monitor.update(steps()[0][0], x, u)
        none.update(steps()[0][0], x, u)
    track: Any = SimpleNamespace(p=pressures, names=([],), q=np.zeros((50, 0)))
    wanted = _back_off(SimpleNamespace(setup=setup), track)["pressure"]
    assert monitor.worst.back_off == pytest.approx(wanted, rel=1e-9) and wanted > 1
    assert none.worst.back_off is None
    over = max(-pressures.min(), pressures.max() - 1e6) / 1e6
    assert none.worst.pressure_room == pytest.approx(-over, rel=1e-9)


def test_what_the_drive_has_not_costs_nothing() -> None:
    other = pressure_driven()
    files = monitor_files(other, {"axis": 3})
    assert "model_monitor_reynolds.c" not in files and "model_monitor_tip_now.c" not in files
    assert "#define SMPC_TUBES 0 " in files["monitor_data.h"]
    assert "#define SMPC_TIP_REFERENCE -1 " in files["monitor_data.h"]
    assert "reach" not in files["monitor_data.c"]
    layout = other.layout
    seen = Monitor(other).update(steps()[0][0], 0 * layout.x.scale, 0.25 * layout.p.scale)
    assert seen.reynolds is None and seen.tip_margin is None and seen.back_off is None
    assert seen.pressure_room is not None and not seen.turbulent


# ---------------------------------------------------------------- workspaces of other arms


def other_arm(**parts: Any) -> Model:
    one = arm(PAPER.sections[0])
    limits = replace(one.limits, **parts.pop("limits", {}))
    section = replace(one.sections[0], **parts.pop("section", {}))
    return build(Scene(replace(one, sections=(section,), limits=limits), **parts))


@pytest.mark.parametrize(
    "make, says",
    [
        (lambda: (build(Scene(PAPER)), space()), "end of section 1, this arm's tip is that of"),
        (lambda: (other_arm(section={"unit_angles": (0.0, 2.0)}), space()), "3 units, this one"),
        (lambda: (model(), replace(space(), held={2: 3e5})), "without --hold"),
        (lambda: (model(), replace(space(), outer=None, inner=None)), "no surfaces"),
        (lambda: (other_arm(section={"young_modulus": 2e6}), space()), "rests up to"),
        (lambda: (other_arm(limits={"pressure_max": 0.8e6}), space()), "0 to 0.8 MPa"),
        (
            lambda: (other_arm(limits={"pressure_max": 1.1e6, "torque_max": 9.0}), space()),
            "0 to 1.1 MPa",
        ),
        (
            lambda: (other_arm(limits={"pressure_min": -0.1e6, "torque_min": -1.0}), space()),
            "-0.1 to",
        ),
    ],
)
def test_a_workspace_of_another_arm_is_refused(make: Any, says: str) -> None:
    of, given = make()
    with pytest.raises(InputError, match=says):
        monitor_files(of, {"tip": 3}, 0.0, given)
    with pytest.raises(InputError, match=says):
        Monitor(of, workspace=given)


def test_a_finer_model_of_the_same_arm_is_not() -> None:
    files = monitor_files(other_arm(segments=2), {"tip": 3}, 0.0, space())
    apart = float(re.findall(r"SMPC_REACH_APART (\S+)", files["monitor_data.h"])[0])
    assert 0.005 < apart < 0.0125
    Monitor(other_arm(effects=(*model().scene.effects,)), workspace=space())


# ---------------------------------------------------------------- the whole way

SCENE = """
schema = 1
[manipulator]
sections = 1
[track]
path = "line"
start = [0.03, 0.0, 0.30]
end = [0.05, 0.02, 0.30]
lap_time = 1.0
laps = 0.5
smooth_start = 0.3
settle = 0.1
[track.controller]
horizon = 6
back_off = 0.25
"""


@pytest.mark.slow
@on_make
def test_the_program_says_what_python_sees(tmp_path: Path) -> None:
    """By the command, with the file of a workspace, against the loop in Python."""
    scene, out = tmp_path / "scene.toml", tmp_path / "c"
    scene.write_text(SCENE)
    _, own, task = read_track_file(scene)
    setup = set_up(own, task)
    one = find_workspace(setup.ocp.model, executor=1, **GRID)
    one.save(tmp_path)
    words = ["codegen", str(scene), "--workspace", str(tmp_path / "workspace.npz")]
    done = CliRunner().invoke(main, [*words, "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert f"good to {1e3 * one.grid_error:.3g} mm" in done.output
    make(out, NOT_OPTIMISED)
    code, said = run(out / "run")
    assert code == 0
    found = [float(word) for word in re.findall(r"-?[\d.]+(?= mm|%| %|,|$)", said.splitlines()[1])]

    monitor = Monitor(setup.ocp.model, task.controller.back_off, one)
    result = setup.run(_Watched(setup.controller, monitor))
    assert result.status == "finished"
    worst = monitor.worst
    assert worst.back_off is not None and worst.tip_margin is not None and worst.tip_margin > 1e-3
    wanted = [1e3 * worst.tip_margin, 1e3 * worst.reference_margin, 1e2 * worst.pressure_room,
              1e2 * worst.back_off, worst.reynolds]  # fmt: skip
    print(said, wanted)
    assert np.all(np.abs(np.subtract(found[:5], wanted)) <= [0.02, 0.02, 0.02, 0.1, 2])
    assert worst.pressure_room == pytest.approx(0.25, abs=1e-3)  # the controller keeps its limit
    other = replace(one, held={1: 0.0})
    other.save(tmp_path)
    done = CliRunner().invoke(main, [*words, "--out", str(tmp_path / "d")])
    assert done.exit_code == 2 and "without --hold" in done.output


class _Watched:
    """A controller that tells a monitor of each step."""

    def __init__(self, mpc: Any, monitor: Monitor) -> None:
        self.mpc, self.monitor = mpc, monitor

    def step(self, x: Any, u_before: Any, given: Any) -> Step:
        taken = self.mpc.step(x, u_before, given)
        tip = given["tip"] if isinstance(given, dict) else given
        self.monitor.update(taken, x, taken.u, np.asarray(tip).reshape(-1, 3)[0])
        return taken

    def __getattr__(self, name: str) -> Any:
        return getattr(self.mpc, name)
