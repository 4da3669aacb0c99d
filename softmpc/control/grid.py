"""The steps of all intervals of a horizon as constant matrices: no AD, and no CasADi, in here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softmpc.control.discretise import held_input
from softmpc.control.step_form import StepForm
from softmpc.model.model import Model
from softmpc.simulation.tableau import Tableau

__all__ = ["Grid"]

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Grid:
    """Forms and drive of N intervals of some lengths, by a tableau with s stages.

    `to_strain` and `to_rate` (N×s×s), `of_rate` (N×s) and `kept` (N) are those of `StepForm`; the
    drive is exact up to each stage, z_s = Φ z + Γ u (N×s×…).
    """

    model: Model
    tableau: Tableau
    lengths: Array  # N, s
    of_rate: Array
    to_strain: Array
    kept: Array
    to_rate: Array
    phi: Array
    gamma: Array

    @classmethod
    def of(cls, model: Model, tableau: Tableau, lengths: Sequence[float] | Array) -> Grid:
        """Intervals of one length share their work."""
        all_of_them = np.asarray(lengths, float)
        each, which = np.unique(all_of_them, return_inverse=True)
        kept = _stacked([StepForm.of(model, tableau, h) for h in each], which)
        A, B = model.drive.A, model.drive.B
        drives = [[held_input(A, B, c * h) for c in tableau.c] for h in each]
        drive = [np.array([[pair[i] for pair in d] for d in drives])[which] for i in (0, 1)]
        return cls(model, tableau, all_of_them, *kept, *drive)

    @cached_property
    def by_length(self) -> tuple[Array, Array, Array]:
        """How `of_rate`, `to_strain` and `to_rate` change with the lengths."""
        forms = [StepForm.by_length(self.model, self.tableau, h) for h in self.lengths]
        of_rate, to_strain, _, to_rate = _stacked(forms, slice(None))
        return of_rate, to_strain, to_rate


def _stacked(forms: list[StepForm], which: Array | slice) -> list[Array]:
    names = ("of_rate", "to_strain", "kept", "to_rate")
    return [np.array([getattr(form, name) for form in forms], float)[which] for name in names]
