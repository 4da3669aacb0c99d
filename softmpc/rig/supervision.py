"""What happens when things go wrong: a small state machine, and the log of what it did and why.

    normal      the controller runs on the estimate
    degraded    it still does, on less: a sensor is silent, or the plan of an earlier step is used
    fall-back   the estimate or the solver cannot be trusted: the reference stands still, and the
                input is what holds it at rest by the model
    safe stop   too long in fall-back: inputs are ramped to the arm at rest

The worst condition that holds decides; the way back up takes a while of good conditions.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from enum import IntEnum

from softmpc.errors import InputError
from softmpc.estimation.sensors import TICK

__all__ = ["Condition", "State", "Supervision", "Supervisor", "Transition"]


class State(IntEnum):
    """What the controller does; a higher one is worse."""

    NORMAL = 0
    DEGRADED = 1
    FALL_BACK = 2
    SAFE_STOP = 3

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


@dataclass(frozen=True)
class Supervision:
    """Times (s) and counts at which states change.

    `resume`: whether it leaves a safe stop by itself once all is well; otherwise `reset` does.
    """

    silent_after: float = 0.05  # beyond its period and latency, without a good reading
    blind_after: float = 0.3  # without a good reading of the tips
    failed_steps: int = 8  # of the solver in a row
    tip_spread: float = 0.03  # m, standard deviation of the tip that is too much
    stop_after: float = 1.0  # in fall-back
    recover_after: float = 0.2  # of good conditions
    ramp: float = 1.0  # s for full input, in a safe stop
    resume: bool = True

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if one.name != "resume" and not 0 < value < 3600:
                raise InputError(f"Supervision.{one.name} = {value!r}: must be above 0, below 3600")


@dataclass(frozen=True)
class Condition:
    """Something that is not as it should be, and the best state that it allows."""

    state: State
    cause: str


@dataclass(frozen=True)
class Transition:
    """A change of state: when (s), from where, to where, why."""

    time: float
    before: State
    after: State
    cause: str

    def __str__(self) -> str:
        return f"{self.time:7.3f} s  {self.before} → {self.after}: {self.cause}"


class Supervisor:
    """The state of one loop; `update` once a step."""

    def __init__(self, settings: Supervision | None = None) -> None:
        self.settings = settings or Supervision()
        self.reset()

    def reset(self, tick: int = 0) -> None:
        """Begin in `NORMAL`; the way out of a safe stop for an operator."""
        self.state = State.NORMAL
        self.log: list[Transition] = []
        self._entered = tick  # the present state
        self._good_since: int | None = None  # conditions that allow a better one

    def update(self, tick: int, conditions: Iterable[Condition]) -> State:
        """The state from this tick on, given all that is wrong."""
        found = list(conditions)
        worst = max(found, key=lambda one: one.state, default=None)
        allowed = State.NORMAL if worst is None else worst.state
        long = (tick - self._entered) * TICK >= self.settings.stop_after
        if self.state is State.FALL_BACK and allowed >= State.FALL_BACK and long:
            held = f"fall-back for {self.settings.stop_after:g} s, {worst.cause if worst else ''}"
            return self._go(tick, State.SAFE_STOP, held)
        if allowed > self.state and worst is not None:
            return self._go(tick, allowed, worst.cause)
        if allowed >= self.state or (
            self.state is State.SAFE_STOP and not self._may_resume(allowed)
        ):
            self._good_since = None
            return self.state
        if self._good_since is None:
            self._good_since = tick
        if (tick - self._good_since) * TICK < self.settings.recover_after:
            return self.state
        return self._go(tick, allowed, "recovered" if worst is None else f"only {worst.cause}")

    def _may_resume(self, allowed: State) -> bool:
        """Whether it may leave a safe stop: not for fall-back, which has led there."""
        return self.settings.resume and allowed < State.FALL_BACK

    def _go(self, tick: int, state: State, cause: str) -> State:
        self.log.append(Transition(tick * TICK, self.state, state, cause))
        self.state, self._entered, self._good_since = state, tick, None
        return state
