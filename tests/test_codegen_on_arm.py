"""Generated controllers on Arm Linux and on a Cortex-M7 board answer as on this machine."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from arms import PAPER, arm
from codegen_small import scratch

from softmpc.codegen.emulate import Answers, Steps, run_program, run_steps
from softmpc.codegen.footprint import PILOT, footprint, footprint_table
from softmpc.codegen.generate import generate, generate_controller, generate_file
from softmpc.codegen.targets import ARM_LINUX, CORTEX_M7, HOST, PRECISIONS, Target, build
from softmpc.control.closed_loop import Start, start_at
from softmpc.control.costs import StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.limits import PressureLimit, TorqueLimit
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import Ocp
from softmpc.control.real_time import RealTime
from softmpc.control.tracking import read_track_file, set_up
from softmpc.control.transcription import Transcription
from softmpc.model.effects import Gravity, MaterialDamping
from softmpc.model.model import build as build_model
from softmpc.model.scene import Scene
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.statics.equilibrium import find_equilibrium

COSTS = (TipPosition(), Torque(), TorqueRate(), StrainRate())
# Full torque is full pressure: where both limits hold, only slacks keep their rows apart.
LIMITS = (TorqueLimit(0.0, 2.0), PressureLimit(0.0, 0.8e6, soft=1e-4))
COUNT = 40
NEAR = {"double": 1e-9, "float": 2e-3}  # N·m, of the controller in Python
EXAMPLES = Path(__file__).parents[1] / "examples"


def needs(*wanted: Target) -> pytest.MarkDecorator:
    reasons = [target.missing for target in wanted if target.missing]
    return pytest.mark.skipif(bool(reasons), reason="; ".join(reasons) or "all is there")


class Watched:
    """A controller, and what it was given and answered."""

    def __init__(self, mpc: Mpc) -> None:
        self.mpc = mpc
        self.rows: list[tuple[np.ndarray, ...]] = []
        self.u: list[np.ndarray] = []

    def __getattr__(self, name: str):
        return getattr(self.mpc, name)

    def step(self, x, u_before, given):
        asked = self.mpc.transcription.references(given), np.ravel(u_before), np.ravel(x)
        found = self.mpc.step(x, u_before, given)
        assert found.solved, found.status
        self.rows.append(asked)
        self.u.append(found.u)
        return found

    @property
    def steps(self) -> Steps:
        return Steps(*(np.array(part) for part in zip(*self.rows, strict=True)))


@cache
def small() -> tuple[Path, Steps, np.ndarray]:
    """One section without inertia, its directory, and steps to places in and out of reach."""
    model = build_model(Scene(arm(PAPER.sections[0]), effects=(MaterialDamping(), Gravity())))
    t = Transcription(Ocp(model, 5, 0.025, COSTS, LIMITS, grid=(1, 1, 1, 2, 4)))
    mpc = Watched(Mpc(t, RealTime(t, mode="never")))
    start = start_at(model, find_equilibrium(model, np.linspace(0.2e6, 0.4e6, 3)))
    _drive(mpc, start)
    folder = Path(scratch()) / "on-arm"
    generate_controller(mpc.mpc, folder, start=start)
    return folder, mpc.steps, np.array(mpc.u)


def _drive(mpc: Watched, start: Start) -> None:
    model, random = mpc.ocp.model, np.random.default_rng(3)
    plant, x, u = RadauIIA(model, tolerance=1e-5), start.x, start.u
    home = np.asarray(model.tip(x[: model.strains])).ravel()
    for k in range(COUNT):
        if k % 8 == 0:
            away = (0.3 if k % 16 else 0.01) * random.normal(size=3)
        u = mpc.step(x, u, {"tip": np.tile(home + away, (5, 1))}).u
        x = plant.advance(x, u, 0.025)


@pytest.fixture(scope="module")
def answers() -> Callable[[str, str], Answers]:
    @cache
    def answer(target: str, precision: str) -> Answers:
        folder, steps, _ = small()
        return run_steps(folder, steps, target, precision)

    return answer


@pytest.mark.sampled
@needs(HOST)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_host_answers_as_python(answers: Callable, precision: str) -> None:
    """Also where limits of torque and pressure hold at once, in seven digits."""
    _, _, u = small()
    found = answers("host", precision)
    assert (found.status == 0).all() and (found.qp == 1).all()
    assert found.iterations.max() > 3 and (found.iterations == 0).any()
    assert np.abs(found.u - u).max() <= NEAR[precision]


@pytest.mark.sampled
@pytest.mark.parametrize(
    "target, precision",
    [
        pytest.param("arm-linux", "double", marks=needs(HOST, ARM_LINUX)),
        pytest.param("cortex-m7", "double", marks=needs(HOST, CORTEX_M7)),
        pytest.param("cortex-m7", "float", marks=needs(HOST, CORTEX_M7)),
    ],
)
def test_same_bits(answers: Callable, target: str, precision: str) -> None:
    host, there = answers("host", precision), answers(target, precision)
    assert there.u.tobytes() == host.u.tobytes()
    for name in ("status", "qp", "iterations"):
        np.testing.assert_array_equal(getattr(there, name), getattr(host, name))


@pytest.mark.slow
@needs(HOST, CORTEX_M7)
def test_footprint_of_a_small_one(answers: Callable) -> None:
    found = footprint(small()[0], precisions=["float"])
    one, told = found["float"], answers("cortex-m7", "float").told
    assert one["flash"]["fits"] and one["ram"]["fits"] and one["stack"]["fits"]
    assert one["allocators"] == []
    assert one["controller"] == told["controller_bytes"]
    assert 0 < told["stack_bytes"] <= one["stack"]["bytes"]
    assert {"controller", "model", "DAQP", "C library", "board"} <= one["parts"].keys()
    assert one["nested"] == {"daqp_pivot_last": 22}  # 5 intervals of 3 torques and 1 slack, and 2
    assert "daqp_pivot_last comes to call itself" in footprint_table(found)


# ---------------------------------------------------------------- the example for a board


@cache
def example() -> tuple[Path, Steps, np.ndarray]:
    _, scene, task = read_track_file(EXAMPLES / "figure_eight_board.toml")
    setup = set_up(scene, task)
    watched = Watched(setup.controller)
    summary = setup.run(watched).summary()
    assert summary["rms_error_mm"] < 0.004
    folder = Path(scratch()) / "board"
    generate(setup, folder)
    return folder, watched.steps, np.array(watched.u)


@pytest.mark.slow
@needs(CORTEX_M7)
def test_the_example_fits_a_board(tmp_path: Path) -> None:
    """Both precisions; the linker says so too."""
    folder = example()[0]
    found = footprint(folder)
    print(footprint_table(found))
    for precision in PRECISIONS:
        one = found[precision]
        assert all(one[name]["fits"] for name in ("flash", "ram", "stack"))
        assert one["allocators"] == []
    assert found["double"]["ram"]["bytes"] < 256 * 1024
    build(folder, CORTEX_M7, "double", tmp_path, memory_map="stm32h743.ld")


@pytest.mark.slow
@needs(HOST, CORTEX_M7)
def test_the_example_runs_on_the_board() -> None:
    folder, steps, u = example()
    host, board = (run_steps(folder, steps, target) for target in ("host", "cortex-m7"))
    print(board.told)
    assert board.u.tobytes() == host.u.tobytes()
    assert np.abs(board.u - u).max() <= NEAR["double"]
    each = {
        part: board.told[f"{part}_instructions"] / len(steps) for part in ("prepare", "feedback")
    }
    assert each["prepare"] < 2.5e6 and each["feedback"] < 0.75e6


@pytest.mark.slow
@needs(CORTEX_M7)
def test_a_rig_fits_a_board(tmp_path: Path) -> None:
    """Estimator, supervision and MPC, in double; without readings it goes on, its input finite."""
    text = (EXAMPLES / "figure_eight_rig.toml").read_text(encoding="utf-8")
    scene = tmp_path / "rig.toml"
    scene.write_text(text.replace("horizon = 20", "grid = [1, 1, 1, 1, 2, 4, 6]"), encoding="utf-8")
    assert generate_file(scene, tmp_path / "rig").sizes["N"] == 7
    found = footprint(tmp_path / "rig", precisions=["double"])
    print(footprint_table(found))
    one = found["double"]
    assert all(one[name]["fits"] for name in ("flash", "ram", "stack"))
    assert "smpc_pilot_step" in one["calls"]["smpc_pilot_step"]["path"]
    assert one["parts"]["estimator and supervision"]["code"] > 8192
    program = build(tmp_path / "rig", PILOT, "double", tmp_path / "built")
    _, told = run_program(PILOT, program)
    print(told)
    assert told["steps"] == 20
    assert told["controller_bytes"] == one["controller"]
    assert told["stack_bytes"] <= one["stack"]["bytes"]
