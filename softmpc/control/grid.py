"""The steps of all intervals of a horizon as constant matrices: no AD, and no CasADi, in here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softmpc.control.discretise import held_inputs
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
        forms = [StepForm.of(model, tableau, h) for h in each]
        of_rate, to_strain, kept, to_rate = _stacked(forms, which)
        drive = model.drive
        times = np.multiply.outer(each, tableau.c)
        held = held_inputs(drive.A, drive.B, times.ravel())
        phi, gamma = (part.reshape(*times.shape, *part.shape[1:])[which] for part in held)
        return cls(model, tableau, all_of_them, of_rate, to_strain, kept, to_rate, phi, gamma)

    @cached_property
    def by_length(self) -> tuple[Array, Array, Array]:
        """How `of_rate`, `to_strain` and `to_rate` change with the lengths."""
        forms = [StepForm.by_length(self.model, self.tableau, h) for h in self.lengths]
        of_rate, to_strain, _, to_rate = _stacked(forms, slice(None))
        return of_rate, to_strain, to_rate


def _stacked(forms: list[StepForm], which: Array | slice) -> list[Array]:
    names = ("of_rate", "to_strain", "kept", "to_rate")
    return [np.array([getattr(form, name) for form in forms], float)[which] for name in names]
