"""The controller in C against the one in Python, which runs in CasADi's virtual machine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arms import PAPER, SMALL, arm

from softmpc.codegen.compiled_controller import CompiledController
from softmpc.codegen.generate import generate, generate_controller
from softmpc.compiler import compiler
from softmpc.control.closed_loop import Start, close_loop, start_at
from softmpc.control.costs import (
    RestAtEnd,
    StrainRate,
    TipDirection,
    TipPosition,
    Torque,
    TorqueRate,
    about_plan,
)
from softmpc.control.limits import (
    PressureLimit,
    StrainLimit,
    StrokeLimit,
    TipBox,
    TorqueLimit,
    TorqueRateLimit,
)
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import Ocp
from softmpc.control.real_time import RealTime
from softmpc.control.tracking import Setup, read_track_file, set_up
from softmpc.control.transcription import Transcription
from softmpc.errors import BuildError, InputError
from softmpc.model.actuation import PressureDrive
from softmpc.model.disturbance import Disturbance
from softmpc.model.effects import Gravity, MaterialDamping
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.simulation.runge_kutta import RadauIIA
from softmpc.statics.equilibrium import find_equilibrium

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

COSTS = (TipPosition(), Torque(), TorqueRate(), StrainRate())
ONE = arm(PAPER.sections[0])
TORQUES = (TorqueLimit(0.0, 2.0), PressureLimit(0.0, 0.9e6, soft=1e-4))


@dataclass(frozen=True)
class Case:
    """A problem, and how it is solved."""

    scene: Scene
    costs: tuple[Any, ...] = COSTS
    limits: tuple[Any, ...] = TORQUES
    intervals: int = 6
    grid: tuple[float, ...] = ()
    blocks: tuple[int, ...] | None = None
    stages: int = 2
    disturbed: bool = False
    far: float = 0.02  # m, of the target

    def mpc(self) -> tuple[Mpc, Start]:
        model = build(self.scene)
        disturbance = everything_unknown(model) if self.disturbed else None
        ocp = Ocp(model, self.intervals, 0.025, self.costs, self.limits, grid=self.grid,
                  disturbance=disturbance)  # fmt: skip
        t = Transcription(ocp, self.stages)
        mpc = Mpc(t, RealTime(t, blocks=self.blocks, mode="never"))
        return mpc, start_at(model, find_equilibrium(model, resting_pressures(model)))


def everything_unknown(model: Model) -> Disturbance:
    return Disturbance.of(model.scene)


def resting_pressures(model: Model) -> np.ndarray:
    return np.linspace(0.2e6, 0.4e6, len(model.layout.p))


PLAIN = Scene(ONE)
CASES = {
    "plain": Case(PLAIN),
    "two sections of other sizes": Case(Scene(arm(PAPER.sections[0], SMALL)), intervals=4),
    "blocks": Case(PLAIN, intervals=8, blocks=(1, 1, 2, 4)),
    "grid": Case(PLAIN, intervals=5, grid=(1, 1, 1.5, 2, 4)),
    "one stage": Case(PLAIN, stages=1),
    "three stages": Case(PLAIN, stages=3, intervals=4),
    "one interval": Case(PLAIN, intervals=1),
    "quasi-static": Case(replace(PLAIN, effects=(MaterialDamping(), Gravity()))),
    "pressures": Case(
        Scene(ONE, actuation=PressureDrive()), limits=(TorqueLimit(0.0, 0.9e6),)
    ),
    "hard limits of states": Case(
        PLAIN, limits=(*TORQUES, StrainLimit(-0.05, 0.12), StrokeLimit(-1.0, 0.2))
    ),
    "hard and soft boxes": Case(
        PLAIN, far=0.05,
        limits=(*TORQUES, TipBox(0.0, 0.6), TipBox(-0.004, 0.5, axis="x", soft=1e-3)),
    ),
    "rates": Case(PLAIN, limits=(TorqueLimit(0.0, 2.0), TorqueRateLimit(-0.05, 0.05)), far=0.05),
    "direction and end": Case(
        PLAIN, grid=(1, 1, 2, 2, 3, 4),
        costs=(*COSTS, TipDirection(), RestAtEnd(factor=0.05 * np.eye(20)[::2])),
    ),
    "disturbed": Case(PLAIN, disturbed=True),
    "planned": Case(PLAIN, costs=about_plan(COSTS)),
}  # fmt: skip


def references(mpc: Mpc, start: Start, tip: np.ndarray, random: np.random.Generator) -> dict:
    """Whatever the problem asks for."""
    t, N, found = mpc.transcription, mpc.ocp.intervals, {}
    for name, size in t.objective.references.items():
        found[name] = {
            "tip": np.tile(tip, (N, 1)),
            "axis": np.tile([0.1, 0.0, 0.99], (N, 1)),
            "rest": np.tile(start.x, (N, 1)),
            "rest input": np.tile(start.u, (N, 1)),
            "planned input": np.tile(start.u, (N, 1)),
            "disturbance": np.tile(0.02 * random.normal(size=size), (N, 1)),
        }.get(name, np.zeros((N, size)))
    return found


def loop(mpc: Mpc, ours: CompiledController, start: Start, far: float, steps: int):
    """Both controllers side by side; the plant follows Python's. Targets jump now and then."""
    model, random = mpc.ocp.model, np.random.default_rng(5)
    plant, x, u = RadauIIA(model, tolerance=1e-5), start.x, start.u
    home = np.asarray(model.tip(start.x[: model.strains])).ravel()
    mpc.reset()
    ours.reset()
    for k in range(steps):
        if k % 8 == 0:
            tip = home + far * random.uniform(-1, 1, 3) * [1, 1, 0.3]
        given = references(mpc, start, tip, random)
        theirs, own = mpc.step(x, u, given), ours.step(x, u, given)
        yield theirs, own
        u = theirs.u
        x = plant.advance(x, u, 0.025)[-1]


SHORT = ("plain", "blocks", "grid", "quasi-static", "hard and soft boxes", "disturbed")
EACH = [pytest.param(name, marks=() if name in SHORT else pytest.mark.slow) for name in CASES]


@pytest.mark.sampled
@pytest.mark.parametrize("name", EACH)
def test_same_steps_as_python(name: str, tmp_path: Path) -> None:
    case = CASES[name]
    mpc, start = case.mpc()
    made = generate_controller(mpc, tmp_path / "c", start=start)
    ours = CompiledController(made.folder, mpc.transcription, flags=["-O1"])
    scale = mpc.transcription.u_scale[: mpc.transcription.inputs]
    worst = 0.0
    for theirs, own in loop(mpc, ours, start, case.far, 30):
        assert (own.status, own.source, own.qp) == (theirs.status, theirs.source, theirs.qp)
        assert own.share == theirs.share
        worst = max(worst, float(np.abs((own.u - theirs.u) / scale).max()))
        np.testing.assert_allclose(own.cost, theirs.cost, rtol=1e-9)
        np.testing.assert_allclose(own.kkt, theirs.kkt, rtol=1e-6, atol=1e-9)
    assert worst <= 1e-9


class Pair:
    """Both controllers with identical inputs; the one in Python drives."""

    def __init__(self, mpc: Mpc, ours: CompiledController) -> None:
        self.mpc, self.ours, self.ocp = mpc, ours, mpc.ocp
        self.apart: list[float] = []
        self.same = True  # statuses, sources, shares

    def reset(self) -> None:
        self.mpc.reset()
        self.ours.reset()

    def step(self, x, u_before, given):
        theirs, own = self.mpc.step(x, u_before, given), self.ours.step(x, u_before, given)
        self.same &= (theirs.status, theirs.source, theirs.share) == (
            own.status, own.source, own.share
        )  # fmt: skip
        self.apart.append(float(np.abs(theirs.u - own.u).max() / np.abs(theirs.u).max()))
        return theirs


def in_virtual_machine(setup: Setup) -> Mpc:
    """The task's controller with no compiled function: it shares no code with C."""
    t = setup.controller.transcription
    return Mpc(t, RealTime(t, blocks=setup.task.controller.blocks, mode="never"))


FLOAT = 2e-3  # N·m, that torques in float may differ from those in double


@pytest.mark.slow
def test_float_follows_double(tmp_path: Path) -> None:
    """Seven digits, in the loop of the one in double."""
    mpc, start = CASES["plain"].mpc()
    made = generate_controller(mpc, tmp_path / "c", start=start)
    assert not made.conditioning.refused
    ours = CompiledController(made.folder, mpc.transcription, single=True)
    steps = list(loop(mpc, ours, start, 0.02, 40))
    assert all(own.solved and own.source == "solution" for _, own in steps)
    assert max(float(np.abs(theirs.u - own.u).max()) for theirs, own in steps) <= FLOAT


@pytest.mark.slow
def test_float_is_refused_where_no_digit_is_left(tmp_path: Path) -> None:
    """Seven inputs for three coordinates, and they cost next to nothing: all but singular."""
    costs = (TipPosition(1e-5), Torque(300.0), StrainRate(30.0))
    mpc, start = replace(CASES["two sections of other sizes"], costs=costs).mpc()
    made = generate_controller(mpc, tmp_path / "c", start=start)
    assert "condition" in made.conditioning.refused
    with pytest.raises(BuildError, match="float is refused: the condensed Hessian"):
        CompiledController(made.folder, mpc.transcription, single=True)


def test_only_real_time_iteration_becomes_c(tmp_path: Path) -> None:
    mpc, start = CASES["plain"].mpc()
    mpc.solver = RealTime(mpc.transcription, iterations=5, mode="never")
    with pytest.raises(BuildError, match="real-time"):
        generate_controller(mpc, tmp_path / "c", start=start)
    assert not (tmp_path / "c").exists()


def test_folders_of_others_are_left_alone(tmp_path: Path) -> None:
    mpc, start = CASES["one interval"].mpc()
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(InputError, match="not a controller's"):
        generate_controller(mpc, tmp_path, start=start)
    with pytest.raises(InputError, match="is a file"):
        generate_controller(mpc, tmp_path / "thesis.tex", start=start)
    with pytest.raises(InputError, match="iterations"):
        generate_controller(mpc, tmp_path / "c", start=start, iterations=0)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.slow
def test_float_in_the_loop_of_an_example(tmp_path: Path) -> None:
    """Float drives: the path is followed as well as in double, with torques that differ little."""
    _, scene, task = read_track_file(Path("examples") / "figure_eight.toml")
    setup = set_up(scene, task)
    made = generate(setup, tmp_path / "c", demo=False)
    t = setup.controller.transcription
    runs = [
        close_loop(one, setup.plant, setup.guide, setup.start)
        for one in (
            CompiledController(made.folder, t),
            CompiledController(made.folder, t, single=True),
        )
    ]
    apart = float(np.abs(runs[0].u - runs[1].u).max())
    errors = [run.summary()["rms_error_mm"] for run in runs]
    print(f"{apart:.1e} N·m apart, RMS errors {errors} mm")
    assert runs[1].failures == 0
    assert apart <= FLOAT
    assert abs(errors[0] - errors[1]) <= 1e-3


RECORDED = ("figure_eight", "circle_fast", "circle_edge", "cheaper_controller")


@pytest.mark.slow
def test_a_thousand_recorded_states(tmp_path: Path) -> None:
    """Identical inputs to both along the examples: unsaturated, fast, out of reach."""
    count, worst = 0, 0.0
    for name in RECORDED:
        _, scene, task = read_track_file(Path("examples") / f"{name}.toml")
        setup = set_up(scene, task)
        made = generate(setup, tmp_path / name, demo=False)
        pair = Pair(
            in_virtual_machine(setup),
            CompiledController(made.folder, setup.controller.transcription),
        )
        close_loop(pair, setup.plant, setup.guide, setup.start)
        assert pair.same
        count, worst = count + len(pair.apart), max(worst, *pair.apart)
    print(f"{count} steps, largest relative difference {worst:.1e}")
    assert count >= 1000
    assert worst <= 1e-10


@pytest.mark.slow
def test_closed_loops_stay_together(tmp_path: Path) -> None:
    """Each runs its own loop for 400 steps: the torques are the same."""
    _, scene, task = read_track_file(Path("examples") / "figure_eight.toml")
    setup = set_up(scene, task)
    made = generate(setup, tmp_path / "c", demo=False)
    pair = (
        in_virtual_machine(setup),
        CompiledController(made.folder, setup.controller.transcription),
    )
    path = replace(setup.guide.path, law=replace(setup.guide.path.law, laps=3.0))
    guide = replace(setup.guide, path=path)
    theirs, ours = (close_loop(one, setup.plant, guide, setup.start, duration=10.0) for one in pair)
    apart = float(np.abs(theirs.u - ours.u).max())
    print(f"{len(ours.u)} steps, {apart:.1e} N·m")
    assert len(ours.u) == 400 and ours.failures == 0
    assert apart <= 1e-8
