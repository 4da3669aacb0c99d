"""Choosing a configuration: the search on a made-up family whose best answer is known."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

import pytest
from choosing_work import measured_here

from softmpc.accuracy import study
from softmpc.accuracy.bound import CALIBRATED, Calibration
from softmpc.accuracy.candidates import Option, motion_space
from softmpc.accuracy.choose import choose, goal_of
from softmpc.accuracy.choose_families import CONFIRMED, GOALS
from softmpc.accuracy.choose_file import evidence_lines, write_choice
from softmpc.accuracy.choose_rate import AtRate
from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.family import Family, Numbers
from softmpc.accuracy.work import Case
from softmpc.errors import InputError, SceneError
from softmpc.model.scene_file import read_document, scene_from_dict

SWING = {
    "title": "Swing",
    "simulate": {"duration": 0.2, "steps": [{"unit": 1, "at": 0.0, "torque": 1.0}]},
}
LOOP = {"track": {"path": "point", "center": [0.1, 0.0, 0.57], "laps": 1}}
MM = 1e-3


class Made(Family):
    """Errors and times by formulas of what a scene says; counts what it is asked for."""

    name: ClassVar[str] = "motion"
    about: ClassVar[str] = "made up"
    error_label: ClassVar[str] = "error (m)"
    cost_label: ClassVar[str] = "time (s)"

    def __init__(self) -> None:
        self.asked: list[tuple[str, str]] = []
        self.broken = False
        self.interrupt_after: float = float("inf")

    def missing(self, task: Task) -> str:
        return "" if "simulate" in task.document else "there is no table [simulate]"

    def configurations(self, task: Task) -> Sequence[Configuration]:
        return [Configuration("as given", "as given")]

    def references(self, task: Task) -> Sequence[str]:
        return ["fine"]

    def reference(self, task: Task, name: str) -> Numbers:
        self._ask("reference", name)
        return {"about": "a formula"}

    def error(
        self, task: Task, configuration: Configuration, references: Mapping[str, Numbers]
    ) -> Numbers:
        assert references["fine"]["about"] == "a formula"
        self._ask("error", configuration.name)
        if self.broken:
            raise SceneError("the arm is broken")
        return {"error_m": true_error(configuration.document(task)), "doubt_m": 0.1 * MM}

    def cost(self, task: Task, configuration: Configuration) -> Numbers:
        self._ask("cost", configuration.name)
        time_s = true_time(configuration.document(task))
        return {"time_s": time_s, "ratio": time_s / true_time(task.document)}

    def _ask(self, part: str, name: str) -> None:
        if len(self.asked) >= self.interrupt_after:
            raise KeyboardInterrupt
        self.asked.append((part, name))


def facts(document: Mapping[str, Any]) -> tuple[int, bool, int, str, bool, float]:
    scene = scene_from_dict(dict(document))
    names = [effect.name for effect in scene.effects]
    mass = scene.formulation.mass.name
    step = document["simulate"].get("tip_tolerance", 1e-6)
    return (scene.segments, mass == "gauss-1", len(scene.strains), scene.actuation.name,
            "coriolis" in names, step)  # fmt: skip


def true_error(document: Mapping[str, Any]) -> float:
    segments, light, strains, drive, coriolis, step = facts(document)
    drives = {"hydraulic": 0.0, "slow-mode": 0.3 * MM, "static": 40 * MM}
    lost = {4: 0.0, 3: 0.2 * MM, 2: 50 * MM}[strains]
    coarse = (30 if light else 16) * MM / segments**2
    return coarse + lost + drives[drive] + (0.0 if coriolis else 6 * MM) + step


def true_time(document: Mapping[str, Any]) -> float:
    segments, light, strains, drive, coriolis, step = facts(document)
    work = segments * (0.7 if light else 1.0) * (0.6 + 0.1 * strains) * (1.0 if coriolis else 0.9)
    return 0.01 * work * (1.0 if drive == "hydraulic" else 0.97) * (1e-6 / step) ** 0.05


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Made:
    family = Made()
    monkeypatch.setitem(GOALS, "motion", family)
    monkeypatch.setitem(CALIBRATED, "motion", Calibration(2.0, 30))
    monkeypatch.setattr(study, "measure_alone", measured_here)
    return family


def chosen(tolerance_mm: float, document: Mapping[str, Any] = SWING, **more: Any) -> Any:
    return choose(Task(dict(document)), tolerance_mm * MM, executor=1, **more)


# ---------------------------------------------------------------- what is chosen


def cheapest_of_all(tolerance_m: float) -> float:
    """The least time of every combination of the space, tried one by one."""
    space = motion_space(Task(SWING), tolerance_m)
    slots: dict[str, list[Option]] = {}
    for extra in space.extras:
        slots.setdefault(extra.slot, []).append(extra)
    times = []
    for candidate in itertools.chain(*space.rounds):
        for extras in itertools.product(*([None, *options] for options in slots.values())):
            own = candidate.with_(*(extra for extra in extras if extra))
            document = own.configuration.document(Task(SWING))
            try:
                bound = true_error(document) + 2.0 * 0.1 * MM
            except (SceneError, KeyError):
                continue
            if bound <= tolerance_m:
                times.append(true_time(document))
    return min(times)


@pytest.mark.parametrize("tolerance", [5.0, 25.0])
def test_the_cheapest_of_all_combinations(made: Made, tolerance: float) -> None:
    choice = chosen(tolerance)
    assert choice.status == "chosen"
    assert choice.chosen.bound_m <= tolerance * MM
    assert choice.chosen.point.time_s <= 1.05 * cheapest_of_all(tolerance * MM)
    tried = sum(part == "error" for part, _ in made.asked)
    assert tried == len(choice.evidence) <= 40  # of some thousand combinations


def test_the_bound_decides_and_not_the_measured_error(made: Made) -> None:
    """1 mm was measured of nothing chosen for 1.1 mm where the bound adds 0.2 mm."""
    for tolerance in (1.5,):
        found = chosen(tolerance).chosen
        assert found.point.error_m + 0.2 * MM == pytest.approx(found.bound_m)
        assert found.bound_m <= tolerance * MM


def test_only_those_that_can_win_are_timed(made: Made) -> None:
    choice = chosen(5.0)
    timed = [name for part, name in made.asked if part == "cost"]
    assert len(timed) == len(set(timed)) <= 10 < len(choice.evidence)
    assert [part for part, _ in made.asked].index("cost") > len(choice.evidence)


def test_what_saves_nothing_stays_in(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    """With times that are all the same the most accurate of those timed is taken."""
    monkeypatch.setattr(f"{__name__}.true_time", lambda document: 0.01)
    choice = chosen(25.0)
    errors = [one.bound_m for one in choice.timed if one.within]
    assert choice.chosen.bound_m == min(errors)


def test_another_tolerance_goes_on_from_what_is_kept(made: Made, tmp_path: Path) -> None:
    first = chosen(5.0, keep=tmp_path / "kept.jsonl")
    made.asked.clear()
    again = chosen(5.0, keep=tmp_path / "kept.jsonl")
    assert made.asked == []
    assert again.summary()["chosen"] == first.summary()["chosen"]


@pytest.mark.parametrize("after", [0, 3, 12])
def test_interrupted_choices_go_on(made: Made, tmp_path: Path, after: int) -> None:
    whole = chosen(5.0).summary()
    made.asked.clear()
    made.interrupt_after = after
    cut = chosen(5.0, keep=tmp_path / "kept.jsonl")
    assert cut.status == "interrupted" and cut.chosen is None
    done = made.asked.copy()
    made.asked.clear()
    made.interrupt_after = float("inf")
    after_all = chosen(5.0, keep=tmp_path / "kept.jsonl")
    assert not set(done) & set(made.asked)
    assert after_all.summary()["chosen"] == whole["chosen"]


def test_what_is_chosen_has_a_doubt_of_its_own(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    """The best one turns out to be in doubt: the next one is confirmed in its place."""
    first = chosen(5.0).chosen
    asked = []

    def confirmed(task: Task, own: Configuration) -> Numbers:
        asked.append(own.name)
        doubt = 1.0 if own.name == first.point.name else 0.05 * MM
        return {"error_m": true_error(own.document(task)), "doubt_m": doubt}

    monkeypatch.setitem(CONFIRMED, "motion", confirmed)
    choice = chosen(5.0)
    assert choice.status == "chosen"
    assert asked[0] == first.point.name and asked[-1] == choice.chosen.point.name
    assert len(asked) == len(set(asked)) >= 2
    own = choice.chosen.point.error
    assert own["doubt_m"] == 0.05 * MM
    assert choice.chosen.bound_m == pytest.approx(own["error_m"] + 2.0 * 0.05 * MM)
    shunned = next(one for one in choice.evidence if one.point.name == first.point.name)
    assert not shunned.within


def test_refused_where_nothing_is_confirmed(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(task: Task, own: Configuration) -> Numbers:
        raise SceneError("the plant stopped")

    monkeypatch.setitem(CONFIRMED, "motion", broken)
    choice = chosen(5.0)
    assert choice.status == "refused" and choice.chosen is None


# ---------------------------------------------------------------- refusals


def test_refused_where_nothing_is_accurate_enough(made: Made) -> None:
    choice = chosen(0.1)
    assert choice.status == "refused" and choice.chosen is None
    first, second, advice = choice.reasons
    assert "6 segments, 2 Gauss points" in first and "not 100 µm" in first
    assert "in doubt by 100 µm" in second
    assert "larger tolerance" in advice


def test_refused_where_nothing_can_be_run(made: Made) -> None:
    made.broken = True
    assert chosen(5.0).reasons == ("no candidate could be run: the arm is broken",)


@pytest.mark.parametrize(("hertz", "kept"), [(10.0, True), (1e4, False)])
def test_the_rate_is_kept_or_said_to_be_too_high(
    made: Made, monkeypatch: pytest.MonkeyPatch, hertz: float, kept: bool
) -> None:
    monkeypatch.setattr(AtRate, "_numbers", lambda work, case: {"step_s": 2 / 25})
    choice = chosen(5.0, rate_hz=hertz)
    assert choice.status == ("chosen" if kept else "refused")
    if kept:
        assert choice.chosen.step_s == 0.08 <= 1 / hertz
    else:
        assert "takes 80 ms, and 10000 Hz leaves 0.1 ms" in choice.reasons[0]
        assert "rate" in choice.reasons[-1]


def test_times_at_a_rate_are_those_of_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 20 steps, of which the second run of all is timed by a clock that we turn."""
    small = SWING | {"model": {"strains": ["epsilon", "kappa_y"]}, "actuation": {"kind": "static"}}
    ticks = itertools.count()
    monkeypatch.setattr("time.perf_counter", lambda: float(next(ticks)))
    found = AtRate(Task(small), rate_hz=100.0)(Case("motion", "cost"))
    assert found["status"] == "measured"
    assert found["steps"] == 20
    assert found["step_s"] >= 1.0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"tolerance_mm": 0.0}, "tolerance = 0.0 m: must be above 0"),
        ({"tolerance_mm": 5.0, "rate_hz": 0.0}, "rate = 0.0 Hz: must be above 0"),
        ({"tolerance_mm": 5.0, "goal": "motions"}, "goal"),
        ({"tolerance_mm": 5.0, "document": {}, "goal": "motion"}, r"no table \[simulate\]"),
    ],
)
def test_wrong_input(made: Made, arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        chosen(**arguments)
    assert made.asked == []


# ---------------------------------------------------------------- the file


def test_the_file_says_what_it_rests_on(made: Made, tmp_path: Path) -> None:
    document = SWING | {"simulate": {"duration": 0.2, "table": "../inputs.csv"}}
    home = tmp_path / "home"
    home.mkdir()
    (tmp_path / "inputs.csv").write_text("t,T_1\n0,0\n0.2,1\n", encoding="utf-8")
    choice = chosen(5.0, document)
    path = write_choice(choice, home, tmp_path / "out", "softmpc choose swing.toml")
    text = path.read_text(encoding="utf-8")
    head = text.partition("\n\n")[0]
    assert all(line.startswith("# ") for line in head.splitlines())
    for said in ("softmpc choose swing.toml", choice.chosen.point.name.split(",")[0], "90 %",
                 "a formula", "30 scenes"):  # fmt: skip
        assert said in head
    written = read_document(path)
    assert written.pop("title") == "Swing, within 5 mm" and written.pop("schema") == 1
    table = written["simulate"].pop("table")
    assert (path.parent / table).read_bytes() == (tmp_path / "inputs.csv").read_bytes()
    expected = {k: dict(v) for k, v in choice.document.items() if k not in ("title", "schema")}
    expected["simulate"].pop("table")
    assert written == expected
    json.dumps(choice.summary())


# ---------------------------------------------------------------- parts


def test_nine_scenes_are_enough_for_ninety_per_cent(
    made: Made, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert [Calibration(1.0, n).enough for n in (0, 8, 9, 30)] == [False, False, True, True]
    for scenes, said in ((0, "calibrated on no scenes, too few"), (1, "on 1 scene, too few")):
        monkeypatch.setitem(CALIBRATED, "motion", Calibration(2.0, scenes))
        lines = "\n".join(evidence_lines(chosen(5.0)))
        assert said in lines and "90 %" not in lines


def test_goals(made: Made, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("rest", "loop"):
        monkeypatch.setattr(type(GOALS[name]), "missing", lambda self, task: "")
    assert goal_of(Task(SWING)) == "motion"
    assert goal_of(Task(SWING | LOOP)) == "loop"
    assert goal_of(Task({})) == "rest"
    assert goal_of(Task(SWING | LOOP), "rest") == "rest"
