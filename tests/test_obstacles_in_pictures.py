"""Obstacles in pictures: areas and circles by closed forms, and where they are on the pages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from arms import PAPER, model_of
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from softmpc.model.effects import Contact
from softmpc.model.model import Model
from softmpc.model.obstacles import Box, Cylinder, Obstacle, Plane, Sphere
from softmpc.model.scene import default_effects
from softmpc.simulation.result import Simulation, titles_of
from softmpc.view import animation
from softmpc.view.arm import Arm
from softmpc.view.motion import motion_figure
from softmpc.view.obstacles import draw_cuts, draw_obstacles
from softmpc.view.posture import posture_figure

BOX = np.array([[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]])
POST = Cylinder(point=(-0.2, 0.0, 0.4), axis=(0.0, 1.0, 0.0), radius=0.05)


def faces_of(axes: Any) -> list[np.ndarray]:
    """Corners of all polygons in three-dimensional axes, without those that only pad."""
    found = []
    for one in axes.collections:
        if isinstance(one, Poly3DCollection):
            corners = np.array(np.ma.filled(one._faces, np.nan))
            padding = getattr(one, "_invalid_vertices", False)
            corners[np.broadcast_to(padding, corners.shape[:2])] = np.nan
            found += [face[np.isfinite(face).all(axis=1)] for face in corners]
    return found


def drawn(obstacle: Obstacle, box: np.ndarray = BOX) -> list[np.ndarray]:
    axes: Any = Figure().add_subplot(projection="3d")
    seen = draw_obstacles(axes, (obstacle,), box)
    faces = faces_of(axes)
    assert seen == bool(faces)
    corners = np.concatenate([*faces, np.zeros((0, 3))])
    assert np.all(corners >= box[0] - 1e-12) and np.all(corners <= box[1] + 1e-12)
    return faces


def area(faces: list[np.ndarray]) -> float:
    """Sum of the areas of flat polygons."""
    return sum(
        float(np.linalg.norm(np.cross(f - f[0], np.roll(f, -1, axis=0) - f[0]).sum(axis=0))) / 2
        for f in faces
    )


@pytest.mark.parametrize(
    ("normal", "wanted"),
    [((1.0, 0.0, 0.0), 1.0), ((1.0, 0.0, 1.0), 2**0.5), ((1.0, 1.0, 1.0), 0.75 * 3**0.5)],
)
def test_a_plane_is_clipped_to_the_box(normal: Any, wanted: float) -> None:
    """Through the middle of a unit cube: a square, a rectangle and a regular hexagon."""
    faces = drawn(Plane(point=(0.0, 0.0, 0.5), normal=normal))
    assert area(faces) == pytest.approx(wanted, rel=1e-6)
    assert drawn(Plane(point=(0.0, 0.0, 9.0), normal=(0.0, 0.0, 1.0))) == []


def test_a_cylinder_is_clipped_to_the_box() -> None:
    whole = drawn(Cylinder(point=(0.1, 7.0, 0.5), axis=(0.0, 1.0, 0.0), radius=0.3))
    assert area(whole) == pytest.approx(2 * np.pi * 0.3, rel=2e-3)
    half = drawn(Cylinder(point=(0.5, 0.0, 0.5), axis=(0.0, 1.0, 0.0), radius=0.3))
    assert area(half) == pytest.approx(np.pi * 0.3, rel=2e-3)
    wide = drawn(Cylinder(point=(90.0, 0.0, 0.5), axis=(0.0, 1.0, 0.0), radius=90.0))
    assert area(wide) == pytest.approx(1.0, rel=1e-3)  # almost the plane x = 0
    places = np.concatenate(wide)
    assert np.abs(np.hypot(places[:, 0] - 90.0, places[:, 2] - 0.5) - 90.0).max() < 1e-4


def test_bodies_are_drawn_whole_and_clipped() -> None:
    """Areas of a ball, a turned box and a cylinder with its ends, and what a wide ball shows."""
    ball = drawn(Sphere((0.1, 0.0, 0.5), 0.3))
    assert area(ball) == pytest.approx(4 * np.pi * 0.3**2, rel=5e-3)
    assert area(drawn(Sphere((0.5, 0.0, 0.5), 0.3))) == pytest.approx(2 * np.pi * 0.3**2, rel=1e-2)
    box = drawn(Box((0.0, 0.1, 0.5), (0.1, 0.2, 0.3), (30.0, -40.0, 50.0)))
    assert area(box) == pytest.approx(2 * (0.02 + 0.03 + 0.06))
    can = drawn(Cylinder((0.1, 0.0, 0.5), (1.0, 1.0, 0.0), 0.2, length=0.3))
    assert area(can) == pytest.approx(2 * np.pi * 0.2 * (0.3 + 0.2), rel=5e-3)
    cut = drawn(Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.2, length=0.6))
    assert area(cut) == pytest.approx(np.pi * 0.2 * (0.6 + 0.2), rel=5e-3)  # its upper half
    assert len({len(face) for face in cut}) == 1  # for Matplotlib's limits of the axes
    wide = drawn(Sphere((90.0, 0.0, 0.5), 90.0))
    assert area(wide) == pytest.approx(1.0, rel=1e-3)  # almost the plane x = 0
    places = np.concatenate(wide) - [90.0, 0.0, 0.5]
    assert np.abs(np.linalg.norm(places, axis=1) - 90.0).max() < 1e-4
    assert drawn(Sphere((9.0, 0.0, 0.5), 0.3)) == []


def lines_of(obstacle: Obstacle, across: int = 0) -> np.ndarray:
    """Places (K×2) of the outlines that the plane view has."""
    axes = Figure().add_subplot()
    draw_cuts(axes, (obstacle,), across, BOX)
    paths = axes.collections[-1].get_paths() if axes.collections else []
    return np.concatenate([*(path.vertices for path in paths), np.zeros((0, 2))])


def test_the_plane_view_has_what_the_plane_cuts() -> None:
    circle = lines_of(POST)
    assert len(circle) > 40
    np.testing.assert_allclose(np.hypot(circle[:, 0] + 0.2, circle[:, 1] - 0.4), 0.05, atol=1e-4)
    assert len(lines_of(POST, across=1)) == 0  # the plane x = 0 passes the post by
    tilted = lines_of(Plane(point=(0.0, 3.0, 0.4), normal=(3.0, 0.0, 4.0)))
    np.testing.assert_allclose(tilted @ [0.6, 0.8], 0.32, atol=1e-9)
    ball = lines_of(Sphere((0.1, 0.03, 0.5), 0.05))
    np.testing.assert_allclose(np.hypot(ball[:, 0] - 0.1, ball[:, 1] - 0.5), 0.04, atol=2e-4)
    box = lines_of(Box((0.1, 0.0, 0.5), (0.2, 0.1, 0.3)))
    sides = np.abs(box - [0.1, 0.5]) / [0.1, 0.15]
    np.testing.assert_allclose(sides.max(axis=1), 1.0, atol=0.03)  # its corners are cut off
    tube = lines_of(Cylinder(axis=(0.0, 0.0, 1.0), radius=0.08, side="inside"))
    np.testing.assert_allclose(np.abs(tube[:, 0]), 0.08, atol=1e-6)


def motion_of(model: Model) -> Simulation:
    """A made-up bend towards the post."""
    time, q = np.linspace(0, 1, 11), np.zeros((11, model.strains))
    q[:, model.layout.q.names.index("kappa_y_2_1")] = np.linspace(0, -4, 11)
    tips = np.stack([np.asarray(model.frames(one)[0]).T for one in q])
    none = {name: np.zeros((11, len(getattr(model.layout, name)))) for name in "zup"}
    about = {"title": "Made up", "status": "finished", "wall_s": 1.0, "titles": titles_of(model)}
    return Simulation(
        time=time, q=q, dq=0 * q, tips=tips, tip_speeds=tips[..., 0] ** 2, **none, **about
    )


@pytest.mark.parametrize("obstacles", [(), (POST,)])
def test_obstacles_are_in_the_pictures(obstacles: tuple[Obstacle, ...]) -> None:
    effects = (*default_effects(), *([Contact(obstacles=obstacles)] if obstacles else []))
    model = model_of(PAPER, effects=effects)
    made = motion_figure(model, motion_of(model))
    names = [text.get_text() for text in made.legends[0].get_texts()]
    assert ("obstacle" in names) == bool(obstacles)
    space, plane = made.axes[:2]
    assert any(at_post(corners) for corners in faces_of(space)) == bool(obstacles)
    assert len(plane.collections) == (2 if obstacles else 0)  # filled, and its outline


@pytest.mark.parametrize("obstacles", [(), (POST,)])
def test_obstacles_are_in_the_pictures_of_a_posture(obstacles: tuple[Obstacle, ...]) -> None:
    effects = (*default_effects(), *([Contact(obstacles=obstacles)] if obstacles else []))
    model = model_of(PAPER, effects=effects)
    made = posture_figure(model, np.zeros(model.strains))
    names = [text.get_text() for text in made.legends[0].get_texts()]
    assert ("obstacle" in names) == bool(obstacles)
    assert any(at_post(corners) for corners in faces_of(made.axes[0])) == bool(obstacles)
    assert len(made.axes[1].collections) == (2 if obstacles else 0)


@pytest.mark.parametrize("obstacles", [(), (POST,)])
def test_obstacles_are_in_the_animation(obstacles: tuple[Obstacle, ...]) -> None:
    effects = (*default_effects(), *([Contact(obstacles=obstacles)] if obstacles else []))
    made, space = animation._stage(Arm(model_of(PAPER, effects=effects)), BOX, animation.Film())
    assert any(at_post(corners) for corners in faces_of(space)) == bool(obstacles)
    names = [text.get_text() for legend in made.legends for text in legend.get_texts()]
    assert names == (["obstacle"] if obstacles else [])


def at_post(corners: np.ndarray) -> bool:
    return bool(np.allclose(np.hypot(corners[:, 0] + 0.2, corners[:, 2] - 0.4), 0.05))
