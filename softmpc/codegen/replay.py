"""A flight log through a controller again, and what came out of that beside what the log says.

Decisions that depended on the clock are taken as the log has them: a step that was late then is
late again, a quadratic program that ran out of time does so again, and none else.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from softmpc.codegen.flight_format import (
    QP,
    SOURCES,
    STATUSES,
    Limits,
    Reset,
    Settings,
    Snapshot,
    StepRecord,
)
from softmpc.codegen.flight_log import FlightLog
from softmpc.errors import InputError

__all__ = ["Comparison", "Player", "Replayed", "compare", "play"]

Array = np.ndarray
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Outcome:
    """What a controller did in a step of a replay; -1: it does not say."""

    u: Array
    status: int
    qp: int = -1
    source: int = -1
    iterations: int = -1


class Player(Protocol):
    """A controller that goes through a log."""

    name: str
    build: str  # as `Header.build`

    def reset(self) -> None:
        """Forget everything."""

    def restore(self, snapshot: Snapshot) -> bool:
        """Remember what the snapshot says; False where that is not possible."""

    def set(self, setting: Limits | Settings) -> None:
        """Take what a user has set."""

    def step(self, record: StepRecord) -> Outcome:
        """A step with the inputs of the record, and its decisions of the clock."""


@dataclass
class Replayed:
    """What came out: outcomes of the steps that could be replayed, by their place in the log."""

    name: str
    build: str  # as `Header.build`
    outcomes: dict[int, Outcome] = field(default_factory=dict)
    left_out: int = 0  # steps before the first place at which a replay can begin, or after a gap


def play(log: FlightLog, player: Player, progress: Progress | None = None) -> Replayed:
    """Run the steps of a log through a player.

    It begins at a reset or a snapshot. Where steps are missing it waits for the next one.
    """
    found = Replayed(player.name, player.build)
    ready, place, expected, total = False, 0, -1, len(log.steps)
    player.reset()
    for event in log.events:
        if isinstance(event, StepRecord):
            ready = ready and event.number == expected and event.whole
            if ready:
                found.outcomes[place] = player.step(event)
            else:
                found.left_out += 1
            place, expected = place + 1, event.number + 1
            if progress is not None:
                progress(place, total)
        elif isinstance(event, Reset):
            player.reset()
            ready, expected = True, event.number
        elif isinstance(event, Snapshot):
            if not (ready and event.number == expected):
                player.reset()
                ready, expected = player.restore(event), event.number
        else:
            player.set(event)
    return found


# ---------------------------------------------------------------- compared


@dataclass(frozen=True)
class Comparison:
    """A replay beside its log. Differences are in N·m, or in Pa for arms driven by pressures."""

    name: str
    steps: int
    left_out: int
    same_build: bool
    tolerance: float
    difference: Array  # of u, the largest in each step; NaN where it was not replayed
    differing: tuple[int, ...]  # places of steps whose input is beyond the tolerance
    statuses: tuple[tuple[int, str, str], ...]  # place, recorded, replayed, where these differ
    same_bits: int  # steps whose input is the same to the last bit

    @property
    def agrees(self) -> bool:
        """Whether all inputs and statuses do."""
        return not self.differing and not self.statuses

    @property
    def largest(self) -> float:
        """Largest difference of an input."""
        return float(np.nanmax(self.difference, initial=0.0))


def compare(
    log: FlightLog, replayed: Replayed, tolerance: float | None = None, other: float = 1e-8
) -> Comparison:
    """Step by step. Without a `tolerance` the same build must give the same bits, any `other`.

    Raises `InputError` where no step could be replayed.
    """
    if not replayed.outcomes:
        raise InputError(
            f"{log.path}: nothing to replay by {replayed.name}: the log has {len(log.steps)} steps "
            "and none of them follows a reset or a snapshot that this controller can begin with"
        )
    same_build = replayed.build == log.header.build
    allowed = tolerance if tolerance is not None else 0.0 if same_build else other
    steps, real = log.steps, log.header.real
    difference = np.full(len(steps), np.nan)
    statuses, same_bits = [], 0
    for place, outcome in replayed.outcomes.items():
        recorded = steps[place]
        difference[place] = _apart(outcome.u, recorded.u)
        same_bits += outcome.u.astype(real).tobytes() == recorded.u.astype(real).tobytes()
        words = _words(recorded, outcome), _words(outcome, outcome)
        if words[0] != words[1]:
            statuses.append((place, *words))
    over = np.flatnonzero(difference > allowed)
    return Comparison(
        name=replayed.name,
        steps=len(replayed.outcomes),
        left_out=replayed.left_out,
        same_build=same_build,
        tolerance=allowed,
        difference=difference,
        differing=tuple(int(place) for place in over),
        statuses=tuple(statuses),
        same_bits=same_bits,
    )


def _apart(a: Array, b: Array) -> float:
    """Largest difference; infinite where one alone is not finite."""
    both = np.abs(a - b)
    return float(np.max(np.where(np.isfinite(both), both, np.where(a == b, 0.0, np.inf))))


def _words(one: StepRecord | Outcome, known: Outcome) -> str:
    """Status, program and source in words, of what the other side knows as well."""
    words = [STATUSES[one.status]]
    if known.qp >= 0 and one.status == len(STATUSES) - 1:
        words.append(
            f"QP {QP[one.qp] or 'not asked'}" if one.qp < len(QP) else "QP ended otherwise"
        )
    if known.source >= 0:
        words.append(f"input from {SOURCES[one.source]}")
    return ", ".join(words)
