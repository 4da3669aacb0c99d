"""Pareto fronts: against all pairs compared, ties, the floor, what is no number."""

from __future__ import annotations

import numpy as np
import pytest

from softmpc.accuracy.configuration import Configuration
from softmpc.accuracy.front import front
from softmpc.accuracy.points import FamilyResult, Point

NAN, INF = float("nan"), float("inf")


def point(
    name: str, time_s: float | None, error_m: float | None, doubt_m: float | None = None
) -> Point:
    error = {"status": "measured", "error_m": error_m, "doubt_m": doubt_m}
    return Point(
        Configuration("axis", name, {"name": name}), error, {"status": "measured", "time_s": time_s}
    )


def names(*points: Point) -> list[str]:
    return [one.name for one in front(FamilyResult("rest", {}, points)).points]


def test_points_are_in_order_of_cost() -> None:
    points = [point("c", 3.0, 0.1), point("a", 1.0, 1.0), point("x", 2.5, 0.6), point("b", 2, 0.5)]
    assert names(*points) == ["a", "b", "c"]


@pytest.mark.parametrize("seed", range(20))
def test_front_is_what_nothing_beats(seed: int) -> None:
    """Each pair compared; few values, so that there are ties in time, in error and in both."""
    times, errors, doubts = np.random.default_rng(seed).integers(1, 8, (3, 30)).astype(float)
    points = [
        point(str(i), t, e, d)
        for i, (t, e, d) in enumerate(zip(times, errors, doubts / 3, strict=True))
    ]
    places = [(t, max(e, d)) for t, e, d in zip(times, errors, doubts / 3, strict=True)]
    beaten = [
        any(
            (q[0] <= p[0] and q[1] <= p[1] and q != p) or (q == p and j < i)
            for j, q in enumerate(places)
        )
        for i, p in enumerate(places)
    ]
    left = sorted((places[i], str(i)) for i in range(30) if not beaten[i])
    assert names(*points) == [name for _, name in left]


def test_ties() -> None:
    assert names(point("worse", 1.0, 0.5), point("better", 1.0, 0.4)) == ["better"]
    assert names(point("slow", 2.0, 0.5), point("fast", 1.0, 0.5)) == ["fast"]
    assert names(point("first", 1.0, 0.5), point("second", 1.0, 0.5)) == ["first"]


def test_what_is_hardly_better_is_not_on_it() -> None:
    points = point("good", 1.0, 0.5), point("same", 2.0, 0.496), point("better", 3.0, 0.494)
    assert names(*points) == ["good", "better"]


def test_at_the_floor_only_the_cheapest_is_known_to_be_good() -> None:
    """1 nm and 1 µm cannot be told apart where the reference may be off by 5 µm."""
    points = [
        point("coarse", 1.0, 1e-3, 5e-6),
        point("cheap", 2.0, 1e-6, 5e-6),
        point("dear", 3.0, 1e-9, 5e-6),
    ]
    assert names(*points) == ["coarse", "cheap"]
    assert [one.at_floor for one in points] == [False, True, True]
    assert [one.proved_m for one in points] == [1e-3, 5e-6, 5e-6]
    found = front(FamilyResult("rest", {}, tuple(points))).summary()
    assert [one["at_floor"] for one in found] == [False, True]


def test_what_is_no_number_is_not_on_it() -> None:
    points = [
        point("good", 1.0, 0.5),
        *(point(f"time {t}", t, 1e-9) for t in (NAN, INF, None)),
        *(point(f"error {e}", 1e-9, e) for e in (NAN, INF, None)),
    ]
    assert names(*points) == ["good"]
    assert names(*points[1:]) == []
    assert names() == []
    assert names(Point(Configuration("axis", "not measured"))) == []


def test_an_effect_added_has_no_error_and_is_not_on_it() -> None:
    change = Point(Configuration("effects", "with weight"), {"change_m": 1e-9}, {"time_s": 1e-9})
    assert names(change, point("good", 1.0, 0.5)) == ["good"]


def test_the_same_scene_on_two_axes_is_one_point_and_marked_on_both() -> None:
    one, other = (
        Point(Configuration(axis, axis, {"model.segments": 1}), {"error_m": 0.5}, {"time_s": 1.0})
        for axis in ("segments", "formulation")
    )
    worse = point("worse", 2.0, 0.6)
    found = front(FamilyResult("rest", {}, (one, other, worse)))
    assert found.points == (one,)
    assert one in found and other in found and worse not in found
