"""The whole arm clear of obstacles: places and distances by another way, programs, a loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import MIXED, PAPER, Array, States, model_of
from oracles.moving_bodies import section_ends

from softmpc.control.clearance import KeepClear, arm_clearance
from softmpc.control.closed_loop import close_loop, start_at
from softmpc.control.limits import TorqueLimit
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import Ocp, tracking_problem
from softmpc.control.paths import Circle, Reference, TimeLaw
from softmpc.control.real_time import RealTime
from softmpc.control.solvers import make_solver
from softmpc.control.stage import Stage
from softmpc.control.transcription import Transcription
from softmpc.errors import InputError
from softmpc.model.model import Model
from softmpc.model.obstacles import Box, Cylinder, Plane, Sphere
from softmpc.simulation.idas import Idas
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Position

BALL = Sphere((0.1, 0.05, 0.45), 0.05)
SOME = (BALL, Plane((0.0, 0.0, 0.7)), Sphere((-0.1, 0.0, 0.3), 0.04))
TORQUE = np.full(6, 0.8)


@cache
def model(segments: int = 1) -> Model:
    return model_of(segments=segments)


def place_of(lengths: Sequence[float], q: Array, along: float) -> Array:
    """Where the centre line is, `along` m of rest length from the base."""
    kept, first = [], 0.0
    for length in lengths:
        kept.append(min(length, along - first))
        first += length
        if along <= first + 1e-12:
            break
    return section_ends(kept, q[: 4 * len(kept)])[0][-1]


def distances(manipulator: Any, segments: int, q: Array, places: int) -> Array:
    """Clearance to each of SOME at places of each section (obstacles × sections × places)."""
    sections = manipulator.sections
    lengths = [s.length / segments for s in sections for _ in range(segments)]
    found = np.zeros((len(SOME), len(sections), places))
    base = 0.0
    for i, section in enumerate(sections):
        for k in range(places):
            x = place_of(lengths, q, base + section.length * (k + 1) / places)
            apart = [
                np.linalg.norm(x - SOME[0].center) - 0.05,
                0.7 - x[2],
                np.linalg.norm(x - SOME[2].center) - 0.04,
            ]
            found[:, i, k] = np.array(apart) - section.disc_radius
        base += section.length
    return found


# ---------------------------------------------------------------- rows and measure


@pytest.mark.parametrize("segments, places", [(1, 4), (2, 3), (3, 2)])
def test_rows_are_distances_along_the_arm(segments: int, places: int) -> None:
    """Two sections of other lengths and widths, segments and places that do not divide."""
    m = model_of(MIXED, segments=segments)
    stage = Stage.of(m)
    rows = KeepClear(SOME, 0.01, places).rows(stage)
    value = ca.Function("rows", [stage.x], [rows.value])
    states = States(m, 5)
    for _ in range(3):
        q = states.q()
        x = np.concatenate([q, np.zeros(len(m.layout.x) - len(q))])
        found = np.asarray(value(x)).reshape(len(SOME), 2, places)
        assert found == pytest.approx(distances(MIXED, segments, q, places), abs=1e-10)
    assert np.all(rows.low == 0.01) and np.all(np.isinf(rows.high)) and np.all(rows.scale == 0.1)
    assert len(rows.names) == len(rows.units) == len(SOME) * 2 * places
    assert rows.names[-1] == "clearance of sphere 2 to section 2 at 100 %"
    if places == 4:
        assert rows.names[6] == "clearance of sphere 1 to section 2 at 75 %"
        assert rows.names[8] == "clearance of plane 1 to section 1 at 25 %"


@pytest.mark.parametrize("segments", [1, 2])
def test_measure_is_the_least_of_many(segments: int) -> None:
    m = model(segments)
    states = States(m, 6)
    postures = np.array([states.q() for _ in range(4)])
    closest = arm_clearance(m, SOME, places=12)(postures)
    assert closest.clearance.shape == closest.section.shape == closest.fraction.shape == (4, 3)
    for n, q in enumerate(postures):
        wanted = distances(PAPER, segments, q, 12)
        assert closest.clearance[n] == pytest.approx(wanted.min(axis=(1, 2)), abs=1e-10)
        for o in range(3):
            k = round(closest.fraction[n, o] * 12) - 1
            at = wanted[o, closest.section[n, o] - 1, k]
            assert at == pytest.approx(closest.clearance[n, o], abs=1e-10)
    one = arm_clearance(m, SOME, places=12)(postures[2])
    assert one.clearance == pytest.approx(closest.clearance[2:3], abs=1e-14)


@pytest.mark.parametrize("places, deep", [(20, 1e-3), (60, 1e-4)])  # the defaults
def test_gaps_between_places_are_small(places: int, deep: float) -> None:
    """A ball of 50 mm that touches two neighbouring places, from whichever side, at any pressures.

    Dense places say how deep it is between them; the formula of the docstring says the same.
    """
    m, random, reach = model(), np.random.default_rng(7), 0.05 + 0.0323
    deepest, count = [], 20 * places
    for _ in range(8):
        q = find_equilibrium(m, random.choice([0.0, 0.5e6, 1e6], 6)).q
        dense = np.array([place_of([0.25, 0.25], q, 0.5 * k / count) for k in range(1, count + 1)])
        for k in random.choice(np.arange(9, count - 11, 10), 12):
            if k == count // 2 - 1:  # there the curvature changes
                continue
            step, middle = dense[k + 10] - dense[k], (dense[k + 10] + dense[k]) / 2
            h = np.linalg.norm(step)
            arch = dense[k + 5] - middle
            ways = [np.cross(step, random.normal(size=3)) for _ in range(3)] + [arch, -arch]
            for way in ways:
                length = np.linalg.norm(way)
                if length < 1e-9:
                    continue
                center = middle + way / length * np.sqrt(reach**2 - h**2 / 4)
                apart = np.linalg.norm(dense - center, axis=1) - reach
                if apart[9::10].min() > -1e-9:  # no other place is deeper
                    deepest.append(apart.min())
                    bend = 8 * np.linalg.norm(arch) / h**2
                    assert apart.min() > -1.02 * h**2 / 8 * (1 / reach + bend) - 1e-8
    assert len(deepest) > 100
    assert -deep < min(deepest) < -deep / 2


# ---------------------------------------------------------------- in a problem


@pytest.mark.sampled
@pytest.mark.parametrize("segments, soft", [(1, 1e-3), (2, None)])
def test_derivatives_in_a_program(segments: int, soft: float | None) -> None:
    m = model(segments)
    limits = (
        TorqueLimit(0, 2.5),
        KeepClear((*SOME, Box(), Cylinder(length=0.2)), places=3, soft=soft),
    )
    t = Transcription(replace(tracking_problem(m, 2), limits=limits))
    program, random = t.program, np.random.default_rng(0)
    w, p = (random.uniform(0.2, 0.5, x.shape[0]) for x in (program.w, program.p))
    _, J = program.gauss_newton["jac_g"](w, p)
    g = ca.Function("g", [program.w, program.p], [program.g])
    rows = [i for i, name in enumerate(program.names_g) if "clearance" in name]
    assert len(rows) == 2 * 5 * 2 * 3
    way = random.normal(size=len(w))
    moved = [np.asarray(g(w + s * 1e-6 * way, p)).ravel() for s in (1, -1)]
    slope = (moved[0] - moved[1])[rows] / 2e-6
    assert np.asarray(J @ way).ravel()[rows] == pytest.approx(slope, rel=1e-6, abs=1e-7)


def test_what_cannot_be_is_said_by_name() -> None:
    """A ball that the arm is in already, and a step in which it cannot leave."""
    m = model()
    start = start_at(m, find_equilibrium(m, pressures_from_torques(m, TORQUE)))
    tip = np.asarray(m.tip(start.x[:8])).ravel()
    inside = KeepClear((Sphere(tuple(tip + [0.0123, 0, 0]), 0.05),), places=4)
    t = Transcription(replace(tracking_problem(m, 2), limits=(TorqueLimit(0, 2.5), inside)))
    step = Mpc(t, RealTime(t)).step(start.x, start.u, np.tile(tip, (2, 1)))
    assert step.status == "failed: QP infeasible"
    assert "clearance of sphere 1 to section 2 at 100 % in interval 1 by 0.07 m" in step.worst


def test_solvers_agree_beside_a_ball() -> None:
    """Asked to go 20 mm towards a ball that is 10 mm away, both stop where the envelope touches."""
    m = model()
    start = start_at(m, find_equilibrium(m, pressures_from_torques(m, TORQUE)))
    tip = np.asarray(m.tip(start.x[: m.strains])).ravel()
    ball = Sphere(tuple(tip + [0.0923, 0.0, 0.02]), 0.05)
    limits = (TorqueLimit(0, 2.5), KeepClear((ball,), 1e-3, places=4, soft=1e-3))
    t = Transcription(replace(tracking_problem(m, 4), limits=limits))
    parameters = t.parameters(start.x, start.u, np.tile(tip + [0.02, 0, 0], (4, 1)))
    guess = t.resting(start.x, start.u)
    found = [make_solver(name, t).solve(parameters, guess) for name in ("ipopt", "sqp")]
    assert all(solution.solved for solution in found)
    (u, _, x), (other, _, _) = (t.split(solution.w) for solution in found)
    assert other == pytest.approx(u, abs=1e-3)
    clearance = arm_clearance(m, (ball,), 4)(x[:, : m.strains]).clearance
    assert clearance[-1, 0] == pytest.approx(1e-3, abs=2e-4)
    assert clearance.min() > 0.5e-3


@pytest.mark.slow
def test_a_loop_keeps_the_arm_clear_of_a_ball() -> None:
    """A circle leads 27 mm through a ball; followed until behind it, with the limit and without."""
    m = model()
    posture = InverseStatics(m).solve(Position((0.04, 0.0, 0.6))).posture
    reference = Reference(Circle((0, 0, 0.6), 0.08), TimeLaw(2.0, 0.6, 0.5))
    ball = Sphere((-0.09, 0.0, 0.55), 0.05)
    least = {}
    for soft in (1e-3, None):
        problem: Ocp = tracking_problem(m, 10)
        if soft is not None:
            keep = KeepClear((ball,), 1e-3, soft=soft)
            problem = replace(problem, limits=(*problem.limits, keep))
        t = Transcription(problem)
        run = close_loop(Mpc(t, RealTime(t)), Idas(m), reference, start_at(m, posture))
        assert run.status == "finished" and run.summary()["failures"] == 0
        least[soft] = 1e3 * float(arm_clearance(m, (ball,))(run.q).clearance.min())
    assert least[None] < -25
    assert 0.2 < least[1e-3] < 1.0


# ---------------------------------------------------------------- slips


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: KeepClear(()), r"KeepClear\.obstacles is empty: give at least one"),
        (
            lambda: KeepClear(BALL),
            r"obstacles = Sphere.*must be a tuple of obstacles, also for one",
        ),  # type: ignore[arg-type]
        (lambda: KeepClear((BALL, 3)), r"obstacles\[1\] = 3: must be an obstacle \(Plane, Cyl"),  # type: ignore[arg-type]
        (lambda: KeepClear((BALL,), np.inf), r"margin = inf: must be a finite number in m"),
        (
            lambda: KeepClear((BALL,), places=0),
            r"places = 0: must be a whole number from 1 to 1000",
        ),
        (lambda: KeepClear((BALL,), places=2.5), r"places = 2\.5"),  # type: ignore[arg-type]
        (lambda: KeepClear((BALL,), soft=0.0), r"KeepClear\(soft=0\.0\): must be above 0"),
        (lambda: arm_clearance(model(), ()), r"obstacles is empty"),
        (lambda: arm_clearance(model(), (BALL,), places=0), r"places = 0: must be a whole"),
        (lambda: arm_clearance(model(), (BALL,))(np.zeros((3, 7))), r"\(3, 7\): must be N×8"),
        (lambda: arm_clearance(model(), (BALL,))(np.zeros((0, 8))), r"of one posture or more"),
    ],
)
def test_slips(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()
