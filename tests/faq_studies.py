"""How the messages of studies come about that the page of messages quotes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from click.testing import CliRunner

from softmpc.accuracy.configuration import Task
from softmpc.accuracy.store import Store
from softmpc.cli.main import main

__all__ = ["OF_STUDIES"]

ARM = {"effects": {"gravity": [0.0, 0.0, 9.81]}}


def study(*words: str) -> Callable[[], object]:
    """What the command says of an arm without motion and path."""

    def call() -> object:
        Path("arm.toml").write_text("[effects]\ngravity = [0.0, 0.0, 9.81]\n", encoding="utf-8")
        return CliRunner().invoke(main, ["study", "arm.toml", *words]).output

    return call


def other_study() -> object:
    for quick in (True, False):
        Store("kept", Task(ARM, ".", quick))
    return ""


OF_STUDIES: dict[str, Callable[[], object]] = {
    "family '…' cannot be measured": study("--family", "motion"),
    "unknown axis of rest": study("--axis", "horizon"),
    "holds another study": other_study,
}
