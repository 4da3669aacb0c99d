"""Pictures of an accuracy study: labels with units, nothing overlaps, nothing is left out."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text

from softmpc.accuracy.configuration import Configuration
from softmpc.accuracy.front import front
from softmpc.accuracy.points import FamilyResult, Point, Study
from softmpc.view.accuracy import front_figure, study_figures
from softmpc.view.accuracy_labels import place_labels
from softmpc.view.accuracy_style import log_scale, marks
from softmpc.view.style import figure

DOCUMENT: dict[str, Any] = {
    "schema": 1,
    "title": "An arm <of tests>",
    "model": {"segments": 1},
    "track": {"controller": {"step": 0.025, "horizon": 20}},
}
DONE = "measured"
# Tip errors (m) at 1, 2, 4, 8 segments, of docs/equations.md.
TIPS = {
    "lumped mass": (1.0, (0.113, 0.063, 0.032, 0.017)),
    "2 Gauss points": (2.0, (0.0096, 0.0022, 0.00055, 0.00014)),
}
FORMS = {
    "Newton-Euler, as printed": (None, (0.080, 0.046, 0.125, 0.2)),
    "Newton-Euler, full wrench": (1.0, (0.157, 0.090, 0.048, 0.025)),
}


def point(
    axis: str, name: str, error: dict[str, Any], time_s: float | None, ratio: float = 1.0,
    **more: Any,
) -> Point:  # fmt: skip
    more.setdefault("changes", {"name": name})
    cost = {} if time_s is None else {
        "status": DONE, "time_s": time_s, "spread_s": time_s / 20, "ratio": ratio,
        "instructions": int(1e9 * time_s), "build_s": 2.0, "memory_mib": 120.0, "c_bytes": 250_000,
    }  # fmt: skip
    return Point(
        Configuration(axis, name, **more), {"status": DONE, **error} if error else {}, cost
    )


def series_of(
    axis: str, table: dict[str, Any], key: str, dear: float, scale: float = 1.0, doubt: float = 2e-6
) -> Iterator[Point]:
    """Points of series over 1, 2, 4, 8 segments."""
    for i, (name, (order, errors)) in enumerate(table.items()):
        for count, error in zip((1, 2, 4, 8), errors, strict=True):
            numbers = {
                "error_m": scale * error, "doubt_m": doubt, "frequency_error": error / 3,
                "integration_m": 1e-9,
            }  # fmt: skip
            yield point(
                axis, f"{name}, {count} segment{'s' if count > 1 else ''}", numbers,
                dear * count**1.2 * (1 + 0.3 * i), count * 1.1,
                changes={key: count, "name": name}, series=name, size=1 / count, order=order,
            )  # fmt: skip


def rest() -> FamilyResult:
    given = point("as given", "as given", {"error_m": 0.0096, "doubt_m": 2e-6}, 21e-6, changes={})
    points = [
        given,
        *series_of("segments and mass", TIPS, "model.segments", 16e-6),
        *series_of("formulation", FORMS, "model.segments", 30e-6),
        point("elasticity", "elasticity strain", {"error_m": 0.02, "doubt_m": 2e-6}, 22e-6),
        point("elasticity", "elasticity <printed>", {"error_m": 1e-6, "doubt_m": 2e-6}, 3e-3),
        point("elasticity", "not timed", {"error_m": 0.02, "doubt_m": 2e-6}, None),
        point("effects", "without weight", {"change_m": 0.061}, 18e-6, 0.9),
        point("effects", "without damping", {"change_m": 1e-5}, 19e-6, 0.95),
        Point(Configuration("effects", "broken"), {"status": "needs $inertia$ <first>"}, {}),
        *(
            point("compilation", f"{how}, {n} segments", {"error_m": 0.0096 / n**2},
                  n**1.5 * base, changes={"model.segments": n}, compile=how)
            for how, base in (("never", 20e-6), ("always", 4e-6)) for n in (1, 2, 4)
        ),
    ]  # fmt: skip
    return FamilyResult("rest", {"rod": "an extensible rod"}, tuple(points))


def integrators() -> Iterator[Point]:
    """Series by step, with a theory, and by tolerance, without one."""
    for k, size in enumerate((0.04, 0.02, 0.01)):
        numbers = {"error_m": 0.012, "doubt_m": 4e-5, "integration_m": 3e-5 / 8**k,
                   "integration_doubt_m": 1e-8}  # fmt: skip
        yield point("integrator", f"radau-2, step {1e3 * size:g} ms", numbers, 0.02 * 2**k, 2.0**k,
                    changes={"simulate.step": size}, series="radau-2 by its step", size=size,
                    order=3.0)  # fmt: skip
    for k, size in enumerate((1e-4, 1e-6, 1e-8)):
        numbers = {"error_m": 0.012, "doubt_m": 4e-5, "integration_m": 2e-4 / 50**k,
                   "integration_doubt_m": 1e-8}  # fmt: skip
        yield point("integrator", f"idas, tolerance {size:g}", numbers, 0.3 * 1.7**k, 8.0 * 1.7**k,
                    changes={"simulate.tolerance": size}, series="idas by its tolerance",
                    size=size)  # fmt: skip


def motion() -> FamilyResult:
    given = point("as given", "as given", {"error_m": 0.012, "doubt_m": 4e-5}, 0.05, changes={})
    drives = [("slow mode alone", 0.002, 0.8), ("static gain", 0.03, 0.4), ("friction", 0.011, 2.5)]
    points = [
        given,
        *series_of("segments and mass", TIPS, "model.segments", 0.05, 1.4, 4e-5),
        *(point("drive", n, {"error_m": e, "doubt_m": 4e-5}, 0.05 * r, r) for n, e, r in drives),
        point("effects", "without weight", {"error_m": 0.11, "doubt_m": 4e-5}, 0.04, 0.8),
        *integrators(),
        point("effects added", "drag in water", {"change_m": 0.04}, 0.08, 1.6),
        point("effects added", "tube inertance", {"change_m": 0.0021}, 0.06, 1.2),
    ]
    return FamilyResult("motion", {"fine model": "8 segments, 1e-10"}, tuple(points))


def loop() -> FamilyResult:
    given = point("as given", "as given", {"error_m": 0.003, "doubt_m": 1e-5}, 0.007, changes={})
    horizons = [(5, 0.02, 0.002), (10, 0.006, 0.0035), (40, 0.0029, 0.019)]
    steps = [(0.0125, 0.0024, 0.0071), (0.05, 0.008, 0.0069), (0.1, 0.03, 0.007)]

    def one(axis: str, name: str, error: float, time_s: float, **changes: Any) -> Point:
        numbers = {"error_m": error, "doubt_m": 1e-5, "own_plant_m": error / 10}
        own = {f"track.controller.{key}": value for key, value in changes.items()}
        return point(axis, name, numbers, time_s, time_s / 0.007, changes=own)

    points = [
        given,
        *(one("horizon", f"horizon of {n} steps", e, t, horizon=n) for n, e, t in horizons),
        *(one("step", f"step of {1e3 * s:g} ms", e, t, grid=None, step=s, horizon=round(0.5 / s))
          for s, e, t in steps),
        one("controller segments", "controller with 1 segment a section", 0.003, 0.007),
        *(one("controller segments", f"controller with {n} segments a section", e, t,
              **{"scene.model.segments": n}) for n, e, t in [(2, 9e-4, 0.02), (4, 6e-4, 0.09)]),
        one("solver", "ipopt", 0.0028, 0.3, solver="ipopt"),
        one("in C", "in Python", 0.003, 0.007),
        one("in C", "in C", 0.003, 0.001, made="in C"),
    ]  # fmt: skip
    return FamilyResult("loop", {"plant": "4 segments"}, tuple(points))


def study(*families: FamilyResult) -> Study:
    machine = {"processor": "a <processor>", "cores": 2, "load": 0.5, "compiler": None}
    chosen = families or (rest(), motion(), loop())
    return Study("An arm <of tests>", "finished", True, machine, chosen, DOCUMENT)


UNITS = re.compile(
    r"\((mm|µm|m|s|ms|µs|relative|ratio|number|steps|by name|of scaled states|lengths of a section)"
    r"\)$"
)


@pytest.fixture(scope="module")
def pictures() -> dict[str, Any]:
    return study_figures(study())


def texts_of(made: Any) -> list[Text]:
    """All that can be read in a picture, after its layout."""
    made.draw_without_rendering()
    found: list[Text] = []
    for axes in [one for one in made.axes if one.get_visible()]:
        low, high = sorted(axes.get_xlim()), sorted(axes.get_ylim())
        found += [t for t in axes.get_xticklabels() if low[0] <= t.get_position()[0] <= low[1]]
        found += [t for t in axes.get_yticklabels() if high[0] <= t.get_position()[1] <= high[1]]
        found += [axes.xaxis.label, axes.yaxis.label, axes.title, axes._left_title, *axes.texts]
        legend = axes.get_legend()
        found += legend.get_texts() if legend else []
    for legend in made.legends:
        found += legend.get_texts()
    return [t for t in [*found, *made.texts] if t.get_text() and t.get_visible()]


def overlapping(made: Figure) -> list[tuple[str, str]]:
    boxes = [(t.get_text(), Text.get_window_extent(t)) for t in texts_of(made)]
    return [(a, b) for (a, one), (b, two) in combinations(boxes, 2) if one.overlaps(two)]


# ---------------------------------------------------------------- all pictures


def test_a_picture_of_each_kind(pictures: dict[str, Any]) -> None:
    assert set(pictures) == {
        "work-precision-rest.png", "work-precision-motion.png", "work-precision-loop.png",
        "convergence-rest-segments-and-mass.png", "convergence-rest-formulation.png",
        "convergence-motion-segments-and-mass.png", "convergence-motion-integrator.png",
        "changes-rest.png", "changes-motion.png",
        "controllers-loop.png", "times-rest.png",
    }  # fmt: skip


def test_axes_have_labels_with_units(pictures: dict[str, Any]) -> None:
    for name, made in pictures.items():
        assert made.get_suptitle(), name
        for axes in [one for one in made.axes if one.get_visible()]:
            assert UNITS.search(axes.get_xlabel()), (name, axes.get_xlabel())
            if not name.startswith("changes"):  # bars have names instead
                assert UNITS.search(axes.get_ylabel()), (name, axes.get_ylabel())


@pytest.mark.slow
def test_nothing_overlaps(pictures: dict[str, Any]) -> None:
    chosen = pictures | {one: front_figure(study(), one) for one in ("rest", "motion", "loop")}
    for name, made in chosen.items():
        assert overlapping(made) == [], name
        for text in texts_of(made):
            box = Text.get_window_extent(text)
            assert all(made.bbox.contains(*corner) for corner in box.corners()), (name, text)


def test_one_axis_of_controllers_has_room() -> None:
    """For title and legend, which are wider than one panel has to be."""
    points = tuple(p for p in loop().points if p.configuration.axis in ("as given", "solver"))
    (made,) = [m for n, m in study_figures(study(FamilyResult("loop", {}, points))).items()
               if n == "controllers-loop.png"]  # fmt: skip
    boxes = [Text.get_window_extent(text) for text in texts_of(made)]
    assert all(made.bbox.contains(*corner) for box in boxes for corner in box.corners())


def test_legends_are_beside_the_data(pictures: dict[str, Any]) -> None:
    for name, made in pictures.items():
        made.draw_without_rendering()
        legends = [axes.get_legend() for axes in made.axes] + made.legends
        for legend in [one for one in legends if one]:
            box = legend.get_window_extent()
            covered = [a for a in made.axes if a.get_visible() and a.bbox.overlaps(box)]
            assert covered == [], name


def test_axes_are_told_apart_in_grey() -> None:
    """Each axis has a shape of its own, and neighbours differ in luminance too."""
    names = [f"axis {i}" for i in range(12)]
    many = FamilyResult("rest", {}, tuple(point(name, name, {}, None) for name in names))
    found = list(marks(many).values())
    assert len({mark.marker for mark in found}) == len(names)
    light = [float(np.dot(to_rgb(mark.colour), (0.2126, 0.7152, 0.0722))) for mark in found]
    assert all(abs(a - b) > 0.04 for a, b in pairwise(light))


# ---------------------------------------------------------------- what is in them


def test_the_front_is_named(pictures: dict[str, Any]) -> None:
    for family in (rest(), motion(), loop()):
        for made in (pictures[f"work-precision-{family.name}.png"],
                     front_figure(study(), family.name)):  # fmt: skip
            names = {t.get_text().replace("\n", " ") for t in made.axes[0].texts}
            assert names == {one.name for one in front(family).points}


def test_all_points_are_drawn(pictures: dict[str, Any]) -> None:
    """As many marks as points with error and time, at their places in µs and mm."""
    axes = pictures["work-precision-rest.png"].axes[0]
    drawn = {
        (round(float(x), 6), round(float(y), 6))
        for line in axes.lines if line.get_marker() not in ("None", "")
        for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
    }  # fmt: skip
    for one in rest().points:
        if one.error_m is not None and one.time_s is not None:
            high = max(one.error_m, one.doubt_m or 0.0)
            assert (round(one.time_s * 1e6, 6), round(high * 1e3, 6)) in drawn, one.name


def test_orders_stand_beside_theory(pictures: dict[str, Any]) -> None:
    def legend(name: str) -> list[str]:
        return [t.get_text() for t in pictures[name].axes[0].get_legend().get_texts()]

    assert "2 Gauss points:\norder 1.99 (theory 2)" in legend(
        "convergence-rest-segments-and-mass.png"
    )
    printed, full = legend("convergence-rest-formulation.png")[:2]
    assert printed.startswith("Newton-Euler, as printed:\ndoes not converge")
    assert full == "Newton-Euler, full wrench:\norder 0.92 (theory 1)"


def test_what_has_other_sizes_is_in_other_panels(pictures: dict[str, Any]) -> None:
    steps, tolerances = pictures["convergence-motion-integrator.png"].axes
    assert steps.get_xlabel() == "step (s)"
    assert tolerances.get_xlabel() == "tolerance (of scaled states)"
    assert steps.get_ylabel() == "error of integration alone (mm)"
    (told,) = [t.get_text() for t in steps.get_legend().get_texts()]
    assert told == "radau-2 by its step:\norder 3.00 (theory 3)"


def test_bars_are_as_long_as_the_changes(pictures: dict[str, Any]) -> None:
    left, right = pictures["changes-motion.png"].axes
    ends = {round(bar.get_x() + bar.get_width(), 6) for bar in left.patches}
    assert {110.0, 40.0, 2.1, 30.0, 11.0, 2.0} <= ends
    assert {t.get_text() for t in right.texts} == {"0.80", "1.60", "1.20", "0.40", "2.50"}


def test_the_budget_follows_the_step(pictures: dict[str, Any]) -> None:
    titled = {
        axes._left_title.get_text(): i
        for i, axes in enumerate(pictures["controllers-loop.png"].axes)
    }
    axes = pictures["controllers-loop.png"].axes[titled["step"] + 4]
    (budget,) = [line for line in axes.lines if line.get_label() == "budget: the step"]
    np.testing.assert_allclose(budget.get_ydata(), 1e3 * np.asarray(budget.get_xdata(), float))


def test_times_of_one_number_of_segments_are_told_by_name() -> None:
    given = point("as given", "as given", {}, 0.05, changes={})
    ways = [point("derivatives", f"{n}, 2 segments", {}, 0.1) for n in ("in loops", "written out")]
    made: Any = study_figures(study(FamilyResult("motion", {}, (given, *ways))))["times-motion.png"]
    assert made.axes[0].get_xlabel() == "derivatives (by name)"
    told = [text.get_text() for text in made.axes[0].get_xticklabels()]
    assert told == ["in loops, 2 segments", "written out, 2 segments"]
    assert overlapping(made) == []


def test_pictures_of_what_is_not_there() -> None:
    assert study_figures(study(FamilyResult("loop", {}, (), "the scene has no path"))) == {}
    bare = Point(Configuration("as given", "as given"))
    failed = Point(Configuration("horizon", "5"), {"status": "diverged"}, {"status": "diverged"})
    assert study_figures(study(FamilyResult("loop", {}, (bare, failed)))) == {}
    assert front_figure(study(FamilyResult("loop", {}, (bare, failed))), "loop").axes
    odd = point("horizon", "no number", {"error_m": float("nan"), "doubt_m": None}, 0.0)
    alone = point("horizon", "alone", {"error_m": 0.0}, 0.01)
    assert set(study_figures(study(FamilyResult("loop", {}, (odd, alone))))) == {
        "controllers-loop.png"
    }


@pytest.mark.parametrize("seed", range(4))
def test_crowded_names_find_room(seed: int) -> None:
    """Twelve names on points that are closer than the names are long."""
    made = figure(6.0, 4.5)
    axes = made.subplots()
    places = 10 ** (0.5 * np.random.default_rng(seed).normal(size=(12, 2)))
    axes.plot(*places.T, "o")
    log_scale(axes, "x", 3.0)
    log_scale(axes, "y", 3.0)
    names = [(x, y, f"a long name,\nthe {i}th") for i, (x, y) in enumerate(places.tolist())]
    place_labels(axes, names, [places])
    made.draw_without_rendering()
    boxes = [Text.get_window_extent(text) for text in axes.texts]
    assert not any(one.overlaps(two) for one, two in combinations(boxes, 2))
    assert all(axes.bbox.contains(*corner) for box in boxes for corner in box.corners())
