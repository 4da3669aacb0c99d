"""What every solver of a transcribed problem gets and returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from softmpc.control.transcription import NonlinearProgram, Transcription

if TYPE_CHECKING:
    from softmpc.control.input_guard import InputGuard
    from softmpc.control.linearisation import Linearisation
    from softmpc.control.trajectory import Moment

__all__ = ["NO_MULTIPLIERS", "Solution", "Solver", "Split", "split", "worst_violation"]

NO_MULTIPLIERS = np.zeros(0)
FEASIBLE = 1e-4  # largest scaled violation of a result at the iteration cap that is still used


@dataclass(frozen=True)
class Solution:
    """What a solver found: scaled variables and multipliers, and how good they are."""

    solved: bool
    status: str  # of the solver
    w: np.ndarray
    lam_w: np.ndarray  # of the bounds; empty where a solver starts without
    lam_g: np.ndarray
    cost: float
    violation: float  # largest violation of a scaled constraint
    worst: str  # which one, by name
    iterations: int
    seconds: float
    kkt: float = float("nan")  # largest residual of the conditions of an optimum, scaled
    qp: str = ""  # how the last quadratic program ended, where there is one
    share: float = 1.0  # of the last step that was taken

    @property
    def capped(self) -> bool:
        """Whether the solver stopped because it had no more iterations."""
        return not self.solved and "iteration" in self.status.lower()

    @property
    def usable(self) -> bool:
        """Good enough to be applied, and to start from."""
        good = self.solved or (self.capped and self.violation <= FEASIBLE)
        return good and bool(np.all(np.isfinite(self.w)))


class Solver(Protocol):
    """Solves the program of one transcription again and again.

    Where it has an attribute `timed` that is true `solve` takes a `time_limit` (s) too.
    """

    transcription: Transcription

    def solve(
        self, parameters: np.ndarray, guess: np.ndarray, multipliers: Solution | None = None
    ) -> Solution:
        """Solve from `guess`; `multipliers` of a solved neighbour make it a warm start."""


class Split(Solver, Protocol):
    """A solver that can do most of its work before the state is known, where `splits` is true."""

    linearisation: Linearisation
    splits: bool

    def prepare(self, moment: Moment, w: np.ndarray) -> None:
        """All that needs no measurement, around the variables `w`; `moment.x` is expected."""

    def limit_inputs(self, guard: InputGuard) -> None:
        """Plan within these limits of the input and of its change."""

    def feedback(self, x: np.ndarray, time_limit: float | None = None) -> Solution:
        """The rest, for the scaled state x as measured."""


def split(solver: Solver) -> Split | None:
    """The solver, where it splits its work."""
    return cast(Split, solver) if getattr(solver, "splits", False) else None


def worst_violation(program: NonlinearProgram, w: np.ndarray, g: np.ndarray) -> tuple[float, str]:
    """The largest violation of a bound or constraint, and its name."""
    over_w = np.maximum(program.bounds[0] - w, w - program.bounds[1])
    over_g = np.maximum(program.bounds_g[0] - g, g - program.bounds_g[1])
    over = np.nan_to_num(np.concatenate([over_w, over_g]), nan=np.inf)
    i = int(np.argmax(over))
    return float(max(over[i], 0.0)), (program.names + program.names_g)[i]
