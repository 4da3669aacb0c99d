"""A trajectory of a transcribed problem as matrices, and what a solve is told of the moment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softmpc.control.transcription import Transcription

__all__ = ["Moment", "Trajectory"]

Array = np.ndarray


@dataclass(frozen=True)
class Trajectory:
    """Scaled decisions u (N×nu), stage accelerations a (N×s·n) and states x at the ends (N×nx)."""

    u: Array
    a: Array
    x: Array

    @classmethod
    def of(cls, t: Transcription, w: Array) -> Trajectory:
        """From the variables of a program."""
        rows = np.asarray(w, float).reshape(t.N, t.nw)
        return cls(rows[:, : t.nu], rows[:, t.nu : t.nu + t.na], rows[:, t.nu + t.na :])

    @property
    def w(self) -> Array:
        return np.hstack([self.u, self.a, self.x]).ravel()

    @property
    def first(self) -> Trajectory:
        """Its first interval."""
        return Trajectory(self.u[:1], self.a[:1], self.x[:1])

    def moved(self, step: Trajectory, share: float) -> Trajectory:
        """Some share of a step further."""
        return Trajectory(self.u + share * step.u, self.a + share * step.a, self.x + share * step.x)


@dataclass(frozen=True)
class Moment:
    """The parameters of a program: state now and decisions before (scaled), references (N×nr)."""

    x: Array
    u_before: Array
    given: Array

    @classmethod
    def of(cls, t: Transcription, parameters: Array) -> Moment:
        """From the parameters of a program."""
        x, u, given = np.split(np.asarray(parameters, float), [t.nx, t.nx + t.nu])
        return cls(x, u, given.reshape(t.N, t.nr))

    @property
    def first(self) -> Moment:
        """The same for the first interval alone."""
        return replace(self, given=self.given[:1])

    def before(self, at: Trajectory) -> tuple[Array, Array]:
        """States and decisions before each interval of a trajectory (N×nx, N×nu)."""
        return np.vstack([self.x, at.x[:-1]]), np.vstack([self.u_before, at.u[:-1]])
