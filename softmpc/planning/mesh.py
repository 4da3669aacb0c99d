"""Intervals of a plan, and how its motions become vectors of moves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from softmpc.control.transcription import Transcription

__all__ = ["Mesh", "Phases"]

GRADING = 1.5  # power of the time that is left, over the intervals that are left

Array = np.ndarray


@dataclass(frozen=True)
class Phases:
    """How many intervals each phase has, and whether the arm rests at its end.

    Intervals of a phase that ends at rest become shorter towards it: all that is fast, such as the
    drive, has to come to rest there too, and does so in the last of them. Others are equally long.
    """

    counts: tuple[int, ...]
    rests: tuple[bool, ...]

    @property
    def N(self) -> int:
        return sum(self.counts)

    @cached_property
    def of_interval(self) -> Array:
        """The phase of each interval (N)."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    @cached_property
    def ends(self) -> Array:
        """The last interval of each phase."""
        return np.cumsum(self.counts) - 1

    @cached_property
    def share(self) -> Array:
        """Of each interval in the duration of its phase (N)."""
        shares = []
        for count, rests in zip(self.counts, self.rests, strict=True):
            left = np.linspace(1.0, 0.0, count + 1) ** (GRADING if rests else 1.0)
            shares.append(-np.diff(left))
        return np.concatenate(shares)

    def lengths(self, durations: Array) -> Array:
        """Of the intervals (N), s."""
        return np.asarray(durations[self.of_interval] * self.share)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Where a quadratic program has its moves: inputs (N×k), states (N×nx), durations, in a row."""

    t: Transcription
    phases: Phases

    @property
    def inputs(self) -> int:
        """How many moves are inputs."""
        return self.t.N * self.t.nu

    @property
    def moves(self) -> int:
        return self.inputs + self.t.N * self.t.nx + len(self.phases.counts)

    def split(self, v: Array) -> tuple[Array, Array, Array]:
        """Moves as those of inputs, states and durations."""
        u, x, durations = np.split(v, [self.inputs, self.moves - len(self.phases.counts)])
        return u.reshape(self.t.N, -1), x.reshape(self.t.N, -1), durations

    @cached_property
    def of_u(self) -> Array:
        """Places of the inputs of each interval (N×k)."""
        return np.arange(self.inputs).reshape(self.t.N, -1)

    @cached_property
    def of_x(self) -> Array:
        """Places of the states at its end (N×nx)."""
        return self.inputs + np.arange(self.t.N * self.t.nx).reshape(self.t.N, -1)

    @cached_property
    def of_duration(self) -> Array:
        """Place of the duration of its phase (N)."""
        return self.moves - len(self.phases.counts) + self.phases.of_interval

    def matrix(self, values: Array, columns: Array, count: int | None = None) -> sparse.csr_matrix:
        """Rows from their entries: values and columns have one row (…×entries) each."""
        values, columns = (a.reshape(-1, a.shape[-1]) for a in np.broadcast_arrays(values, columns))
        rows = np.broadcast_to(np.arange(len(values))[:, None], values.shape)
        used = values != 0
        entries = values[used], (rows[used], columns[used])
        return sparse.csr_matrix(entries, (len(values) if count is None else count, self.moves))

    @cached_property
    def input_itself(self) -> sparse.csr_matrix:
        """Picks the inputs from moves (N·k rows)."""
        return sparse.eye(self.inputs, self.moves, format="csr")

    @cached_property
    def input_change(self) -> sparse.csr_matrix:
        """Their changes from interval to interval; the first from the one before the plan."""
        before = sparse.eye(self.inputs, self.moves, k=-self.t.nu, format="csr")
        return self.input_itself - before

    @cached_property
    def length(self) -> sparse.csr_matrix:
        """Length of the interval that each input is held for (N·k rows)."""
        share, place = self.phases.share, self.of_duration
        each = self.t.nu
        return self.matrix(np.repeat(share, each)[:, None], np.repeat(place, each)[:, None])
