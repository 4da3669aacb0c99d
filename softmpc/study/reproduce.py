"""What the paper prints beside what the model gives, row by row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.errors import InputError, unknown_name
from softmpc.model.presets import DEFAULT_PRESET, preset
from softmpc.study import reproduce_motions as motions
from softmpc.study import reproduce_statics as statics
from softmpc.study.paper_readings import OURS, PaperRuns
from softmpc.study.reproduce_records import Topic

__all__ = ["TOPICS", "Reproduction", "reproduce"]

# Key of a topic -> what computes it; in the order of the paper.
TOPICS: dict[str, Callable[[PaperRuns], Topic]] = {
    "drive": statics.drive,
    "limit+x": statics.limit_plus_x,
    "limit-x": statics.limit_minus_x,
    "workspace": statics.workspace,
    "posture": statics.limit_posture,
    "fig6": motions.fig6,
    "fig7": motions.fig7,
    "fig8": motions.fig8,
    "fig11a": statics.rests_of_unit_4,
    "fig11b": statics.rests_of_unit_1,
    "fig13": motions.fig13,
    "fig14": motions.fig14,
    "errors": motions.errors,
}


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Topics of the paper side by side with one parameter set, and the runs they come from."""

    status: str  # "finished" or "interrupted"
    parameters: str  # name of the set
    topics: tuple[Topic, ...]
    runs: PaperRuns

    @property
    def lost(self) -> dict[str, str]:
        """Topics for which our own model gave nothing, and why."""
        return {
            topic.key: reason
            for topic in self.topics
            for name, reason in topic.failures.items()
            if name.startswith(OURS)
        }

    def summary(self) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        return {
            "status": self.status,
            "parameters": self.parameters,
            "topics": [topic.summary() for topic in self.topics],
        }

    def columns(self) -> dict[str, np.ndarray]:
        """One row a number of a reading, for a CSV file."""
        records = [
            {"topic": topic.key, "where": topic.where, **record, "parameters": self.parameters}
            for topic in self.topics
            for record in topic.records()
        ]
        return {
            name: np.array([_cell(record[name]) for record in records], dtype=object)
            for name in (records[0] if records else {})
        }


def _cell(value: Any) -> Any:
    """A value for CSV: empty where there is none."""
    return "" if value is None or (isinstance(value, float) and np.isnan(value)) else value


def reproduce(
    parameters: str = DEFAULT_PRESET,
    only: Sequence[str] = (),
    progress: Callable[[int, int], None] | None = None,
) -> Reproduction:
    """Compute all topics, or some of `TOPICS`, with a preset's parameters.

    `progress(done, all)` is called after each. Ctrl-C ends it with status "interrupted" and what
    was computed. Raises `InputError` for an unknown topic, `ParameterError` for an unknown preset.
    """
    for key in only:
        if key not in TOPICS:
            raise InputError(unknown_name("topic", key, TOPICS))
    keys = [key for key in TOPICS if not only or key in only]
    runs, status = PaperRuns(preset(parameters)), "finished"
    done: list[Topic] = []
    try:
        for key in keys:
            done.append(TOPICS[key](runs))
            if progress:
                progress(len(done), len(keys))
    except KeyboardInterrupt:
        status = "interrupted"
    return Reproduction(status, parameters, tuple(done), runs)
