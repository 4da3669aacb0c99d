"""Contact: pushes of obstacles against loads, their shape, and what they keep the arm from."""

from __future__ import annotations

from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import LEAN, PAPER, Array, States, arm, differences, model_of
from arms import numbers as num
from numpy.testing import assert_allclose

from softmpc.errors import ParameterError, SceneError
from softmpc.model.actuation import PressureDrive
from softmpc.model.contact import Contact, ContactPush
from softmpc.model.effects import Effect, EnvironmentDamping, Gravity, MaterialDamping, TipLoad
from softmpc.model.model import Model, build
from softmpc.model.obstacles import Cylinder, Obstacle, Plane
from softmpc.model.scene import Scene
from softmpc.simulation.inputs import InputProfile, Step
from softmpc.simulation.run import simulate
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium

RADIUS = 0.0323  # of the arm's envelope
BENT = (0.6e6, 0.0, 0.0, 0.0, 0.3e6, 0.3e6)  # the tip is at x = -0.35 m
REFERENCE = Plane((0.0, 0.0, 0.55), (0.0, 0.0, -1.0))


def push(depth: float, stiffness: float = 1e4, softness: float = 1e-3) -> float:
    """The force (N) of the documented law, written out."""
    if depth <= 0:
        return 0.0
    x = min(depth / softness, 1.0)
    return stiffness * (softness * (x**3 - x**4 / 2) + max(depth - softness, 0.0))


def at_rest(
    obstacles: tuple[Obstacle, ...],
    *effects: Effect,
    pressures: Any = 0.0,
    segments: int = 2,
    **slots: Any,
) -> tuple[Model, Equilibrium]:
    m = model_of(segments=segments, effects=(*effects, Contact(obstacles, **slots)))
    found = find_equilibrium(m, np.broadcast_to(pressures, 6))
    assert found.converged
    return m, found


# ---------------------------------------------------------------- force and load


@pytest.mark.sampled
@pytest.mark.parametrize("load", [1.0, 40.0])
def test_a_plane_across_the_arm_carries_what_the_rod_does_not(load: float) -> None:
    """Pulled down onto a floor: the load is E A ε and the push of the floor together."""
    section = PAPER.sections[0]
    floor = Plane((0.0, 0.0, 0.5 + RADIUS), (0.0, 0.0, -1.0))
    _, found = at_rest((floor,), TipLoad((0.0, 0.0, load)))
    depth = found.tips[-1][2] - 0.5
    pull = section.axial_stiffness * depth / 0.5
    assert 0 < pull < load
    assert push(depth) + pull == pytest.approx(load, rel=1e-8)


def test_a_wall_beside_the_arm_pushes_like_a_dead_force() -> None:
    """With the push of the wall given as a load, and no wall, the posture is the same."""
    wall = Plane((0.1, 0.0, 0.0), (-1.0, 0.0, 0.0))
    _, found = at_rest((wall,), Gravity(), TipLoad((6.0, 0.0, 0.0)), places=1, segments=1)
    depths = found.tips[:, 0] + RADIUS - 0.1
    assert depths[0] < 0 < depths[1]
    load = TipLoad((6.0 - push(depths[1]), 0.0, 0.0))
    alone = find_equilibrium(model_of(effects=(Gravity(), load)), np.zeros(6))
    assert_allclose(alone.q, found.q, atol=1e-9)


# ---------------------------------------------------------------- shapes


def sphere_depth(obstacle: Obstacle, place: Array) -> tuple[float, Array]:
    depth, out = obstacle.depth(ca.DM(place), RADIUS)
    return float(depth), num(ca.densify(ca.DM(out)))


@pytest.mark.parametrize(
    "obstacle, distance",
    [
        (Plane((1, 2, 3), (0, 0, 5)), lambda x: x[2] - 3),
        (Plane((0, 0, 0), (1, 0, -1)), lambda x: (x[0] - x[2]) / np.sqrt(2)),
        (Cylinder((0, 1, 0), (0, 0, -2), 0.3), lambda x: np.hypot(x[0], x[1] - 1) - 0.3),
        (Cylinder((0, 0, 2), (3, 0, 0), 0.2, "inside"), lambda x: 0.2 - np.hypot(x[1], x[2] - 2)),
    ],
)
def test_distances(obstacle: Obstacle, distance: Any) -> None:
    """Depth is the radius less the distance; the way out is where depth falls fastest."""
    random = np.random.default_rng(0)
    for place in random.normal(size=(20, 3)):
        depth, out = sphere_depth(obstacle, place)
        assert depth == pytest.approx(RADIUS - distance(place), abs=1e-11)
        slope = differences(
            lambda x: np.array(sphere_depth(obstacle, x)[0]), place, np.full(3, 1e-4)
        )
        assert_allclose(out, -slope, atol=1e-8)
        assert np.linalg.norm(out) == pytest.approx(1, abs=1e-8)


def test_the_middle_of_a_tube_has_derivatives() -> None:
    m = model_of(effects=(Gravity(), Contact((Cylinder(radius=0.1, side="inside"),))))
    K, _ = m.stiffness(0, 0)
    free, _ = model_of(effects=(Gravity(),)).stiffness(0, 0)
    assert_allclose(np.asarray(K), np.asarray(free), atol=1e-12)


# ---------------------------------------------------------------- the law


def law(depth: Any) -> tuple[Any, Any, Any]:
    x = ca.SX.sym("x")
    force = ContactPush(REFERENCE, RADIUS, 1e4, 1e-3).force(x)
    slope = ca.gradient(force, x)
    return ca.Function("law", [x], [force, slope, ca.gradient(slope, x)])(depth)


def test_force_is_twice_differentiable_and_zero_apart() -> None:
    for depth in (-1.0, -1e-9, 0.0):
        assert [float(v) for v in law(depth)] == [0.0, 0.0, 0.0]
    for edge in (0.0, 1e-3):
        below, above = (law(edge * (1 + s) + s * 1e-12) for s in (-1e-9, 1e-9))
        for left, right, size in zip(below, above, (10, 1e4, 1e7), strict=True):
            assert abs(float(left) - float(right)) < 1e-7 * size
    for depth in (1e-4, 7e-4, 5e-3):
        assert float(law(depth)[0]) == pytest.approx(push(depth), rel=1e-12)
    assert float(law(5e-3)[1]) == pytest.approx(1e4)


def test_contact_never_pulls() -> None:
    """However fast the arm comes or goes, on a floor its force points out, and rises with speed."""
    one = arm(PAPER.sections[0])
    floor = Contact((Plane((0, 0, 0.28), (0, 0, -1)),), places=1, damping=3.0)
    with_floor, without = (
        model_of(one, strains=("epsilon",), effects=(*LEAN, *extra)) for extra in ((floor,), ())
    )
    forces = []
    for speed in np.linspace(-40, 40, 21):
        at = (0.02, speed, 0.0, np.zeros(3))
        forces.append(float(with_floor.residual(*at) - without.residual(*at)) / 0.25)
    rest = push(0.25 * 1.02 + RADIUS - 0.28)
    assert forces[10] == pytest.approx(rest, rel=1e-12)
    assert min(forces) > 0
    assert np.all(np.diff(forces) > 0)


# ---------------------------------------------------------------- statics with contact


@cache
def free() -> Equilibrium:
    return find_equilibrium(model_of(segments=2, effects=(Gravity(),)), np.array(BENT))


@pytest.mark.sampled
@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e7])
@pytest.mark.parametrize("x", [-0.1, -0.3])
def test_a_wall_stops_the_bending_arm(x: float, stiffness: float) -> None:
    wall = Plane((x, 0.0, 0.0), (1.0, 0.0, 0.0))
    m, found = at_rest((wall,), Gravity(), pressures=BENT, stiffness=stiffness)
    assert found.stable
    assert free().tips[-1][0] < -0.35
    deep = x + RADIUS - found.tips[-1][0]
    assert 0 < deep < 1e-3 + 10 / stiffness
    energy = float(m.energies(q=found.q, dq=0)["contact"])
    assert 0 < energy < 20 * deep


def test_a_moving_arm_comes_to_rest_at_the_wall() -> None:
    """Swung against it, and after three seconds where the statics say."""
    wall = Contact((Plane((-0.15, 0.0, 0.0), (1.0, 0.0, 0.0)),))
    scene = Scene(PAPER, actuation=PressureDrive())
    m = build(scene.with_(effects=(*scene.effects, wall)))
    steps = [Step(unit, 0.1, p) for unit, p in ((1, 0.6e6), (5, 0.3e6), (6, 0.3e6))]
    motion = simulate(m, InputProfile.of(6, steps), 3.0)
    assert motion.status == "finished"
    deepest = -0.15 + RADIUS - motion.tips[:, -1, 0].min()
    rest = find_equilibrium(m, np.array(BENT))
    assert rest.tips[-1][0] - 5e-3 < -0.15 + RADIUS - deepest < rest.tips[-1][0]
    assert_allclose(motion.tips[-1, -1], rest.tips[-1], atol=2e-5)


def test_a_tube_holds_the_arm() -> None:
    tube = Cylinder(radius=0.1, side="inside")
    _, found = at_rest((tube,), Gravity(), pressures=BENT)
    assert found.stable
    assert 0 < np.hypot(*found.tips[-1][:2]) + RADIUS - 0.1 < 2e-3


def test_far_obstacles_change_nothing() -> None:
    far = (Plane((0, 0, 9), (0, 0, -1)), Cylinder((5, 0, 0)), Cylinder(radius=7, side="inside"))
    m, found = at_rest(far, Gravity(), pressures=BENT)
    assert_allclose(found.q, free().q, atol=1e-9)
    assert float(m.energies(q=found.q, dq=0)["contact"]) == 0


def test_a_body_at_the_place_of_another_is_one_body() -> None:
    """Contact at the tip and mass at the tip do not compute the tip twice."""
    m = model_of(effects=(Gravity(), Contact((REFERENCE,), places=1)))
    assert [len(s.bodies) for s in m.chain.segments] == [3, 3]
    states = States(model_of(effects=(*LEAN, EnvironmentDamping(), MaterialDamping())))
    assert np.isfinite(num(m.balance(states.q(), np.zeros(6)))).all()


# ---------------------------------------------------------------- slips


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Contact(), r"obstacles is empty"),
        (lambda: Contact((REFERENCE,), places=1.5), "places = 1.5: must be a whole number"),
        (
            lambda: Plane(normal=(0, 0, 0)),
            r"Plane\.normal = \(0\.0, 0\.0, 0\.0\): must not be zero",
        ),
        (lambda: Cylinder(axis=(0, 0, 0)), r"Cylinder\.axis"),
        (lambda: Cylinder(side="insde"), "did you mean 'inside'"),
        (
            lambda: Contact(REFERENCE),
            "must be a list of Plane or Cylinder or Sphere or Box objects",
        ),
        (
            lambda: Contact((3,)),
            r"obstacles\[0\] = 3: must be a Plane or Cylinder or Sphere or Box object",
        ),
        (lambda: Plane((0, 0)), r"Plane\.point = \(0\.0, 0\.0\): must be 3 numbers"),
    ],
)
def test_slips(make: Any, message: str) -> None:
    with pytest.raises((SceneError, ParameterError), match=message):
        make()
