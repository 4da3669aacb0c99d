"""Parts of a choice: candidates, rates, and the bound."""

from __future__ import annotations

import itertools

import pytest

from softmpc.accuracy import choose_families
from softmpc.accuracy.bound import CALIBRATED, Calibration, bound_m, conformal_factor, score
from softmpc.accuracy.candidates import AS_GIVEN, Candidate, Option, undominated
from softmpc.accuracy.candidates_loop import loop_space
from softmpc.accuracy.choose_families import GOALS
from softmpc.accuracy.choose_loop import plant_of
from softmpc.accuracy.choose_rate import rate_hz
from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.loop_task import coarser
from softmpc.errors import InputError, SceneError

LOOP = {"track": {"path": "point", "center": [0.1, 0.0, 0.57], "laps": 1}}
MM = 1e-3


def test_undominated() -> None:
    """Of a grid the corner; and what is finer in one thing and coarser in another stays."""
    a, b = ([Option(slot, rank, f"{slot}{rank}", {slot: rank}) for rank in (1, 2)] for slot in "ab")
    corner, more_a, more_b = (Candidate((x, y)) for x, y in ((a[0], b[0]), (a[1], b[0]),
                                                             (a[0], b[1])))  # fmt: skip
    assert undominated([AS_GIVEN, more_a, corner, more_b]) == [corner]
    assert undominated([AS_GIVEN, more_a, more_b]) == [more_a, more_b]
    assert undominated([AS_GIVEN]) == [AS_GIVEN]


def test_loops_at_a_rate_look_ahead_as_far_as_given() -> None:
    document = LOOP | {"track": LOOP["track"] | {"controller": {"step": 0.02, "horizon": 25}}}
    for hertz in (20.0, 100.0, 160.0):
        space = loop_space(Task(document), hertz)
        for candidate in itertools.chain(*space.rounds):
            own = candidate.configuration.document(Task(document))["track"]["controller"]
            assert own["step"] == pytest.approx(1 / hertz)
            steps = sum(own["grid"]) if "grid" in own else own["horizon"]
            assert steps * own["step"] == pytest.approx(0.5, abs=own["step"])
            assert ("grid" in own) != ("horizon" in own)


@pytest.mark.parametrize(
    ("center", "across", "plane"),
    [
        ([0.1, 0.0, 0.57], [0.0, 1.0, 0.0], "bending about y alone"),
        ([0.0, 0.1, 0.57], [1.0, 0.0, 0.0], "bending about x alone"),
        ([0.1, 0.0, 0.57], [0.0, 0.0, 1.0], ""),
    ],
)
def test_a_plane_is_left_out_only_where_the_path_stays_in_the_other(
    center: list[float], across: list[float], plane: str
) -> None:
    """Bending about y moves the tip in the plane of x and z."""
    path = {"path": "circle", "center": center, "normal": across, "diameter": 0.04, "laps": 1}
    names = [extra.name for extra in loop_space(Task(LOOP | {"track": path}), None).extras]
    assert [name for name in names if name.startswith("bending")] == [plane][: bool(plane)]
    assert "no twist" in names


def test_a_controllers_scene_in_a_file_cannot_be_varied() -> None:
    own = LOOP | {"track": LOOP["track"] | {"controller": {"scene": "other.toml"}}}
    with pytest.raises(SceneError, match=r"other\.toml"):
        loop_space(Task(own), None)


@pytest.mark.parametrize(
    ("text", "hertz"), [("100Hz", 100.0), ("100 Hz", 100.0), ("0.1kHz", 100.0), ("2.5Hz", 2.5)]
)
def test_rates(text: str, hertz: float) -> None:
    assert rate_hz(text) == pytest.approx(hertz)


@pytest.mark.parametrize("text", ["100", "Hz", "fast", "-5Hz", "0Hz", "1e9Hz", "nanHz", "1.2.3Hz"])
def test_rates_that_are_none(text: str) -> None:
    with pytest.raises(InputError, match="rate"):
        rate_hz(text)


def test_conformal_factor() -> None:
    """The rank by counting: of all places a new score may take, 90 % are not above."""
    scores = [float(k) for k in range(1, 20)]
    assert conformal_factor(scores) == 18.0
    assert conformal_factor(scores[::-1]) == 18.0
    assert conformal_factor(scores[:9]) == 9.0
    assert conformal_factor(scores[:8]) == float("inf")
    assert conformal_factor([-score for score in scores]) == 0.0


def test_the_bound_undoes_the_score(monkeypatch: pytest.MonkeyPatch) -> None:
    error = {"error_m": 3 * MM, "doubt_m": 0.2 * MM}
    assert score(error, 3.5 * MM) == pytest.approx(2.5)
    monkeypatch.setitem(CALIBRATED, "loop", Calibration(2.5, 30))
    assert bound_m("loop", error) == pytest.approx(3.5 * MM)


def test_the_references_of_a_loop_say_different_things(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def doubted(task: Task, own: Configuration) -> dict[str, float]:
        asked.append(dict(own.changes))
        return {"error_m": 1 * MM, "doubt_m": 0.1 * MM}

    monkeypatch.setattr(choose_families, "doubted_error", doubted)
    family, task = GOALS["loop"], Task(LOOP)
    found = [family.reference(task, name) for name in family.references(task)]
    assert asked == [{"track.controller.scene.model.segments": 2}]
    assert found[1]["doubt_m"] == 0.1 * MM
    assert found[0]["about"] != found[1]["about"]
    plant = plant_of(task)
    assert f"with {plant.segments} segments" in found[0]["about"]
    assert all(f"one with {coarser(plant).segments} " in one["about"].replace("a plant", "one")
               for one in found)  # fmt: skip
