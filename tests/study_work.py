"""A small family of measurements for the tests of studies; workers import this module."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from softmpc.accuracy import study
from softmpc.accuracy.configuration import Configuration, Task
from softmpc.accuracy.families import FAMILIES
from softmpc.accuracy.family import Family, Numbers
from softmpc.accuracy.work import Case, Measure
from softmpc.errors import SceneError

if TYPE_CHECKING:
    import pytest

ROOT = Path(__file__).resolve().parents[1]
SIZES = (1, 2, 4)
REFERENCES = ("coarse", "fine")


@dataclass(frozen=True)
class Noted:
    """What was done, by the lines of the file that `document["log"]` names."""

    what: str  # "rest error axis/name"
    process: int
    began: float
    ended: float
    cores: int  # the process could run on


def noted(log: str | os.PathLike[str]) -> list[Noted]:
    """All that was finished, in the order of their ends."""
    lines = (line.split("\t") for line in Path(log).read_text().splitlines())
    return [Noted(a, int(b), float(c), float(d), int(e)) for a, b, c, d, e in lines]


class Pretended(Family):
    """A series of first and one of second order; numbers depend on the configuration alone.

    Keys of the document steer it: `log`, `seconds` a measurement takes, `kill` (what kills its
    process), `fail` (what has no result, for a reason), `break` (what has a bug), `refuse` (why a
    family is not measured at all).
    """

    name: ClassVar[str] = "pretended"
    about: ClassVar[str] = "An error that is known, and a cost that is known."
    error_label: ClassVar[str] = "error (m)"
    cost_label: ClassVar[str] = "time (s)"

    def missing(self, task: Task) -> str:
        return str(task.document.get("refuse", {}).get(self.name, ""))

    def configurations(self, task: Task) -> Sequence[Configuration]:
        made = [Configuration("as given", "as given")]
        for axis, order in (("first", 1.0), ("second", 2.0)):
            made += [
                Configuration(axis, f"{axis} {n}", {axis: n}, axis, 1 / n, order) for n in SIZES
            ]
        return [*made, Configuration("first", "again", {"second": 1})]  # the same as on its axis

    def references(self, task: Task) -> Sequence[str]:
        return REFERENCES

    def reference(self, task: Task, name: str) -> Numbers:
        _work(task, f"{self.name} reference {name}")
        return {"about": f"the {name} one", "value": float(REFERENCES.index(name))}

    def error(
        self, task: Task, configuration: Configuration, references: Mapping[str, Numbers]
    ) -> Numbers:
        _work(task, f"{self.name} error {configuration.identity}")
        assert [references[name]["value"] for name in REFERENCES] == [0.0, 1.0]
        order, size = configuration.order or 0.0, configuration.size or 1.0
        return {"error_m": 0.1 * size**order / 3, "doubt_m": 1e-9}

    def cost(self, task: Task, configuration: Configuration) -> Numbers:
        _work(task, f"{self.name} cost {configuration.identity}")
        segments = 1 / (configuration.size or 1.0)
        return {
            "time_s": 1e-5 * segments, "spread_s": 1e-6, "ratio": segments,
            "instructions": int(1000 * segments),
        }  # fmt: skip


class Other(Pretended):
    """The same by another name."""

    name: ClassVar[str] = "other"

    def configurations(self, task: Task) -> Sequence[Configuration]:
        return [
            Configuration("as given", "as given"),
            Configuration("third", "third 1", {"third": 1}),
        ]


FAKES: dict[str, Family] = {family.name: family for family in (Pretended(), Other())}


@dataclass(frozen=True)
class Measuring(Measure):
    """As `Measure`, by a process that may not know these families yet."""

    def __call__(self, case: Case) -> dict[str, Any]:
        FAMILIES.update(FAKES)
        return super().__call__(case)


def only_fakes(patch: pytest.MonkeyPatch) -> None:
    """Studies have these families alone, in workers too."""
    for name in [*FAMILIES]:
        patch.delitem(FAMILIES, name)
    for name, family in FAKES.items():
        patch.setitem(FAMILIES, name, family)
    patch.setattr(study, "Measure", Measuring)


def start(*arguments: object) -> subprocess.Popen[str]:
    """`study_runs.py` in a process group of its own, as in a terminal."""
    environment = os.environ | {"PYTHONPATH": f"{ROOT / 'tests'}{os.pathsep}{ROOT}"}
    command = [sys.executable, str(ROOT / "tests" / "study_runs.py"), *map(str, arguments)]
    return subprocess.Popen(
        command, env=environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        start_new_session=True,
    )  # fmt: skip


def _work(task: Task, what: str) -> None:
    document = task.document
    if what in document.get("fail", []):
        raise SceneError("does not come to rest")
    if what in document.get("break", []):
        raise KeyError("a bug")
    began = time.monotonic()
    if what in document.get("kill", []):
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(document.get("seconds", 0.0))
    if log := document.get("log"):
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0
        line = [what, os.getpid(), began, time.monotonic(), cores]
        with open(log, "a") as file:
            file.write("\t".join(map(str, line)) + "\n")
