"""Shapes of obstacles: distances by brute force over their surfaces, ways out, no NaN anywhere."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import CONSERVATIVE, Array, States, differences, model_of
from arms import numbers as num
from numpy.testing import assert_allclose
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from softmpc.errors import ParameterError
from softmpc.model.contact import Contact
from softmpc.model.effect_tables import read_record, write_record
from softmpc.model.obstacles import Box, Cylinder, Obstacle, Sphere, obstacle_names
from softmpc.model.tables import Table

RADIUS = 0.03  # of the sphere that touches
BALL = Sphere((0.1, -0.2, 0.3), 0.25)
HOLLOW = replace(BALL, side="inside")
BRICK = Box((0.2, 0.1, 0.4), (0.3, 0.2, 0.5))
TURNED = replace(BRICK, rotation=(40.0, -70.0, 110.0))
CAN = Cylinder((0.1, 0.3, 0.2), (1.0, 2.0, -2.0), 0.2, length=0.3)
TIN = replace(CAN, side="inside", length=0.5)
SHAPES = {"ball": BALL, "hollow": HOLLOW, "box": BRICK, "turned": TURNED, "can": CAN, "tin": TIN}
each_shape = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)


def function_of(shape: Obstacle) -> ca.Function:
    """Depth, way out, slope of the depth, and slope of the way out."""
    place = ca.SX.sym("place", 3)
    depth, out = shape.depth(place, RADIUS)
    outputs = [depth, out, ca.gradient(depth, place), ca.jacobian(out, place)]
    return ca.Function("shape", [place], [ca.densify(ca.SX(x)) for x in outputs])


def surface(shape: Obstacle) -> tuple[Array, Any]:
    """Points of the surface less than 3 mm apart, and whether places (N×3) are within it."""
    if isinstance(shape, Sphere):
        count = 150_000  # a spiral with even area
        z = 1 - (2 * np.arange(count) + 1) / count
        turn = np.pi * (1 + 5**0.5) * np.arange(count)
        ring = np.sqrt(1 - z**2)
        points = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
        center = np.array(shape.center)
        return (
            center + shape.radius * points,
            lambda x: np.linalg.norm(x - center, axis=1) < shape.radius,
        )
    if isinstance(shape, Box):
        half = np.array(shape.size) / 2
        turn = Rotation.from_rotvec(shape.rotation, degrees=True)
        steps = np.linspace(-1, 1, 180)
        faces = []
        for axis, side in product(range(3), (-1, 1)):
            square = np.stack(np.meshgrid([side], steps, steps), axis=-1).reshape(-1, 3)
            faces.append(np.roll(square, axis, axis=1) * half)
        return turn.apply(np.concatenate(faces)) + shape.center, lambda x: np.all(
            np.abs(turn.inv().apply(x - shape.center)) < half, axis=1
        )
    assert isinstance(shape, Cylinder)
    axis, middle = np.array(shape.axis), np.array(shape.point)
    frame = np.linalg.svd(axis[None])[2]  # rows: the axis or its opposite, and two across
    turns, heights = np.linspace(0, 2 * np.pi, 900), np.linspace(-0.5, 0.5, 220) * shape.length
    rings = [(shape.radius, h) for h in heights]
    rings += [(r, h) for r in np.linspace(0, shape.radius, 100) for h in heights[[0, -1]]]
    points = np.concatenate(
        [
            h * frame[0]
            + r * (np.cos(turns)[:, None] * frame[1] + np.sin(turns)[:, None] * frame[2])
            for r, h in rings
        ]
    )

    def within(x: Array) -> Array:
        local = (x - middle) @ frame.T
        radial = np.hypot(local[:, 1], local[:, 2]) < shape.radius
        return np.asarray(radial & (np.abs(local[:, 0]) < shape.length / 2))

    return points + middle, within


@pytest.mark.sampled
@each_shape
def test_depth_is_that_of_the_nearest_point_of_the_surface(shape: Obstacle) -> None:
    points, within = surface(shape)
    places = points.mean(axis=0) + np.random.default_rng(0).normal(size=(3000, 3)) * 0.2
    distance = KDTree(points).query(places)[0]
    inside = within(places)
    assert 100 < inside.sum() < 2900
    beyond = np.where(inside, -distance, distance)
    kept_inside = getattr(shape, "side", "outside") == "inside"
    depth = num(function_of(shape).map(len(places))(places.T)[0]).ravel()
    error = depth - (RADIUS + beyond if kept_inside else RADIUS - beyond)
    far = distance > 0.01  # a grid is 2 mm from a point on the surface, 0.2 mm from one far off
    assert np.abs(error).max() < 2.2e-3 and np.abs(error[far]).max() < 2.2e-4


@each_shape
def test_the_way_out_is_where_depth_falls(shape: Obstacle) -> None:
    """Finite differences of the depth; where planes of several nearest walls meet, none exist."""
    function, random = function_of(shape), np.random.default_rng(1)
    compared = 0
    for place in random.normal(size=(150, 3)) * 0.3 + 0.2:
        depth, out, slope, _ = (num(x) for x in function(place))
        step = np.full(3, 1e-5)
        found = differences(lambda x: np.array(float(function(x)[0])), place, step)
        assert_allclose(slope, -out, atol=1e-12)
        assert np.linalg.norm(out) == pytest.approx(1, abs=1e-9)
        if np.abs(np.linalg.norm(found) - 1) < 1e-6:  # not across a ridge within the shape
            assert_allclose(found, -out, atol=1e-6)
            compared += 1
        step_out = float(function(place + 1e-6 * out)[0])
        assert step_out == pytest.approx(depth[0] - 1e-6, abs=1e-9)
    assert compared > 140


@each_shape
def test_curvature_of_the_way_out(shape: Obstacle) -> None:
    function, random = function_of(shape), np.random.default_rng(2)
    near = 0
    for place in random.normal(size=(60, 3)) * 0.3 + 0.2:
        _, _, _, bend = (np.asarray(x) for x in function(place))
        found = differences(lambda x: num(function(x)[1]), place, np.full(3, 1e-5))
        near += bool(np.abs(found - bend).max() < 1e-5)
    assert near > 55  # the others are within steps of a ridge


def odd_places(shape: Obstacle) -> list[Array]:
    """Centre, axis, faces, edges and corners, and places a hair from them."""
    if isinstance(shape, Sphere):
        local = [np.zeros(3), np.array([shape.radius, 0, 0])]
        center, frame = np.array(shape.center), np.eye(3)
    elif isinstance(shape, Box):
        half = np.array(shape.size) / 2
        local = [half * signs for signs in product((-1, 0, 1, 1 + 1e-13, 1.5), repeat=3)]
        local += [(half - half.min()) * signs for signs in product((-1, 0, 1), repeat=3)]
        center, frame = np.array(shape.center), shape.edges
    else:
        assert isinstance(shape, Cylinder)
        radii, heights = (0, 1, 1 + 1e-13, 2), (0, 1, -1, 1 + 1e-13, 3)
        local = [
            np.array([shape.radius * r, 0, shape.length / 2 * h])
            for r, h in product(radii, heights)
        ]
        frame = np.linalg.svd(np.array(shape.axis)[None])[2][::-1].T
        center = np.array(shape.point)
    random = np.random.default_rng(3)
    exact = [center + frame @ one for one in local]
    return [one + h * random.normal(size=3) for one in exact for h in (0, 1e-15, 1e-9)]


@each_shape
def test_never_nan(shape: Obstacle) -> None:
    """Nor an infinite slope, also in floating-point numbers that are exactly on an edge."""
    aligned = [replace(shape, center=(0.0, 0.0, 0.0))] if hasattr(shape, "center") else []
    for one in (shape, *aligned):
        function = function_of(one)
        for place in odd_places(one):
            depth, out, slope, bend = (num(x) for x in function(place))
            assert all(np.isfinite(x).all() for x in (depth, out, slope, bend))
            assert_allclose(slope, -out, atol=1e-9)
            assert np.linalg.norm(out) < 1 + 1e-9


def test_a_box_has_a_way_out_from_its_middle() -> None:
    """The nearest wall, also where several are as near."""
    for size, wanted in (((0.3, 0.2, 0.5), 0.1), ((0.4, 0.4, 0.4), 0.2)):
        depth, out, *_ = function_of(Box((1, 2, 3), size))([1, 2, 3])
        assert float(depth) == pytest.approx(RADIUS + wanted)
        assert np.linalg.norm(num(out)) == 1


def test_an_endless_cylinder_costs_what_its_formula_does() -> None:
    """Its ends are not there where they are not asked for; far away they make no difference."""
    place = ca.SX.sym("place", 3)
    shape = Cylinder((0.1, 0.3, 0.2), (1.0, 2.0, -2.0), 0.2)
    axis, offset = ca.DM(shape.axis), place - ca.DM(shape.point)
    across = offset - axis * ca.dot(axis, offset)
    distance = ca.sqrt(ca.sumsqr(across) + (1e-6 * 0.2) ** 2)
    formula = [0.2 + RADIUS - distance, across / distance]
    counts = [
        ca.Function("f", [place], list(outputs), {"cse": True}).n_instructions()
        for outputs in (shape.depth(place, RADIUS), formula)
    ]
    assert counts[0] == counts[1]
    long = function_of(replace(shape, length=100.0))
    for at in np.random.default_rng(4).normal(size=(20, 3)):
        for a, b in zip(long(at), function_of(shape)(at), strict=True):
            assert_allclose(num(a), num(b), atol=1e-9)


@pytest.mark.sampled
@pytest.mark.parametrize(
    "shape", [BRICK, TURNED, CAN, HOLLOW], ids=["box", "turned", "can", "hollow"]
)
def test_contact_keeps_the_energy(shape: Any) -> None:
    """Where the arm is: in motion its energies change by the powers alone."""
    name = "point" if isinstance(shape, Cylinder) else "center"
    m = model_of(effects=(*CONSERVATIVE, Contact((replace(shape, **{name: (0, 0, 0.3)}),))))
    states, touched = States(m, 3), 0
    for _ in range(4):
        q, dq, _, p = states.motion()
        ddq = num(m.forward_dynamics(q, dq, p))

        def energy(t: Array, q: Array = q, dq: Array = dq, ddq: Array = ddq) -> float:
            moved = q + t[0] * dq + t[0] ** 2 / 2 * ddq, dq + t[0] * ddq
            return sum(float(e) for e in m.energies.call(list(moved)))

        rate = differences(energy, np.zeros(1), np.array([1e-5]))[0]
        powers = {k: float(v) for k, v in m.powers(q=q, dq=dq, p=p).items()}
        size = sum(abs(v) for v in powers.values())
        assert rate == pytest.approx(sum(powers.values()), abs=1e-6 * size)
        assert powers["contact_damping"] <= 0
        touched += powers["contact_damping"] < -1e-3
    assert touched > 1


# ---------------------------------------------------------------- scenes and slips


@each_shape
def test_scene_files_keep_shapes(shape: Obstacle) -> None:
    for one in (shape, Cylinder()):
        assert read_record(type(one), Table(write_record(one), "[obstacle]")) == one


def test_names_of_several() -> None:
    assert obstacle_names((BALL, BRICK, HOLLOW)) == ("sphere 1", "box 1", "sphere 2")


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Sphere(radius=0), r"Sphere\.radius = 0 m: must be above 0 and at most 100 m$"),
        (lambda: Sphere(radius=np.inf), r"Sphere\.radius = inf m"),
        (lambda: Sphere(side="out"), "did you mean 'outside'"),
        (lambda: Box(size=(1, 2)), r"Box\.size = \(1\.0, 2\.0\): must be 3 numbers"),
        (lambda: Box(size=(1, 0, 2)), r"Box\.size\[1\] = 0 m: must be above 0"),
        (lambda: Box(rotation=(0, 0, np.nan)), r"Box\.rotation\[2\] = nan deg"),
        (lambda: Cylinder(length=0), r"length = 0 m: must be above 0 and at most 100 m, or inf"),
        (lambda: Cylinder(length=-np.inf), r"Cylinder\.length = -inf m"),
        (lambda: Cylinder(length=np.nan), r"Cylinder\.length = nan m"),
    ],
)
def test_slips(make: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        make()
