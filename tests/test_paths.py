"""Tip paths and the time law against their definitions."""

import numpy as np
import pytest

from softmpc.control.paths import (
    Circle,
    FigureEight,
    Helix,
    Line,
    Reference,
    TimeLaw,
    Waypoints,
    read_waypoints,
)
from softmpc.errors import SceneError

PHASE = np.linspace(0, 1, 201)
CENTER = (0.1, -0.2, 0.6)


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, 0, 0), (1, 2, 3)])
def test_circle_keeps_its_radius_and_plane(normal: tuple[float, ...]) -> None:
    places = Circle(CENTER, 0.08, normal).position(PHASE) - CENTER
    assert np.linalg.norm(places, axis=1) == pytest.approx(0.04, abs=1e-15)
    assert places @ np.array(normal, float) == pytest.approx(0, abs=1e-15)
    length = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
    assert length == pytest.approx(np.pi * 0.08, rel=1e-4)


def test_figure_eight_is_as_wide_and_high_as_asked_and_crosses_its_center() -> None:
    places = FigureEight(CENTER, 0.08, 0.04).position(PHASE)
    assert np.ptp(places, axis=0) == pytest.approx([0.08, 0.04, 0], abs=1e-5)
    for phase in (0.0, 0.5, 1.0):
        assert FigureEight(CENTER, 0.08, 0.04).position(np.array([phase]))[0] == pytest.approx(
            CENTER
        )


def test_helix_rises_by_its_pitch_a_lap_and_line_returns() -> None:
    helix = Helix(CENTER, 0.06, 0.02).position(np.array([0.0, 1.0, 2.0]))
    assert np.diff(helix, axis=0) == pytest.approx(np.array([[0, 0, 0.02]] * 2), abs=1e-15)
    line = Line((0, 0, 0.6), (0.01, 0.02, 0.5)).position(np.array([0, 0.5, 1.0]))
    assert line == pytest.approx(np.array([[0, 0, 0.6], [0.01, 0.02, 0.5], [0, 0, 0.6]]))


@pytest.mark.parametrize("closed", [True, False])
def test_waypoints_go_through_all_points_and_join_laps(closed: bool) -> None:
    points = ((0.0, 0.0, 0.6), (0.03, 0.0, 0.6), (0.03, 0.03, 0.58), (0.0, 0.03, 0.6))
    path = Waypoints(points, closed)
    dense = path.position(np.linspace(0, 1, 20001))
    for point in points:
        assert np.linalg.norm(dense - point, axis=1).min() < 1e-5
    ends = path.position(np.array([0.0, 1.0 - 1e-12, 1.0, 2.0]))
    assert ends == pytest.approx(np.tile(points[0], (4, 1)), abs=1e-9)


def test_waypoints_file(tmp_path) -> None:
    file = tmp_path / "points.csv"
    file.write_text("x,y,z\n0,0,0.6\n0.02,0,0.6\n0.02,0.02,0.61\n")
    assert read_waypoints(file, False).points[2] == (0.02, 0.02, 0.61)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "no such file"),
        ("x,y\n0,0\n1,1\n", "needs columns x, y, z"),
        ("x,y,z\n0,0,0.6\n0.02,oops,0.6\n", "line 3"),
        ("x,y,z\n0,0,0.6\n", "two or more"),
        ("x,y,z\n0,0,0.6\n0,0,0.6\n1,0,0\n", "same place"),
    ],
)
def test_bad_waypoints_say_what_is_wrong(tmp_path, text: str | None, message: str) -> None:
    file = tmp_path / "points.csv"
    if text is not None:
        file.write_text(text)
    with pytest.raises(SceneError, match=message):
        read_waypoints(file, False)


def test_time_law_starts_smoothly_and_runs_evenly() -> None:
    law = TimeLaw(4.0, 2, smooth_start=1.0)
    t = np.linspace(-0.5, law.duration, 9001)
    phase = law.phase(t)
    assert phase[t <= 0] == pytest.approx(0)
    assert phase[-1] == pytest.approx(2)
    speed = np.gradient(phase, t)
    assert np.all(np.diff(speed) > -1e-9)
    assert speed[t > 1.01] == pytest.approx(1 / 4, rel=1e-6)
    acceleration = np.gradient(speed, t)
    assert np.abs(np.diff(acceleration)).max() < 0.01  # no jump


def test_reference_without_smooth_start_is_linear_in_time() -> None:
    reference = Reference(Line((0, 0, 0), (1, 0, 0)), TimeLaw(2.0, 1, 0.0))
    assert reference.duration == 2.0
    assert reference.position([1.0])[0] == pytest.approx([1, 0, 0])


def test_zero_normal_is_refused() -> None:
    with pytest.raises(SceneError, match="must not be zero"):
        Circle(CENTER, 0.1, (0, 0, 0)).position(PHASE)
