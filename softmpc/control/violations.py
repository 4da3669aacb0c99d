"""Which limits and equations a trajectory breaks most, in words: what, where, by how much."""

from __future__ import annotations

import numpy as np

from softmpc.control.linearisation import Linearisation
from softmpc.control.trajectory import Moment, Trajectory
from softmpc.control.transcription import Transcription

__all__ = ["Violations"]

NAMED = 3  # violations in a message
SMALLEST = 1e-6  # scaled, that is worth a word

Array = np.ndarray


class Violations:
    """Names the violations of trajectories of one transcription."""

    def __init__(self, transcription: Transcription) -> None:
        self.t = t = transcription
        self._linearisation = Linearisation(t, "never")
        self._bounds, self._row_bounds = t.variable_bounds(), t.row_bounds()
        self._names = [*t.variable_names(), *t.row_names()]
        layout, rows = t.model.layout, t.objective.rows
        slacks, stages = t.nu - t.inputs, len(t.tableau.c)
        forces = [_FORCES.get(unit, "") for unit in layout.q.units]
        units = [*layout.u.units, *("" for _ in range(slacks)), *("" for _ in range(t.na))]
        units += [*layout.x.units, *stages * forces, *layout.x.units]
        self._units = [*units, *(row.unit for row in rows)]
        scales = [t.w_scale[: t.nw], np.tile(layout.r.scale, stages), t.x_scale]
        self._scales = np.concatenate([*scales, [row.scale for row in rows]])
        idle = np.zeros(t.nx + t.nu + t.N * t.nr)
        self._amounts(Moment.of(t, idle), Trajectory.of(t, np.zeros(t.N * t.nw)))  # made now

    def worst(self, moment: Moment, w: Array, count: int = NAMED) -> str:
        """The worst violations of scaled variables w, relative to their scales; "" without any.

        Such as "T_3 in interval 1 by 0.2 N·m; balance of kappa_x_1_1 (stage 2) in interval 4 by …".
        """
        over = self._amounts(moment, Trajectory.of(self.t, w))
        places = np.argsort(-over.round(6), axis=None, kind="stable")[:count]  # first of equals
        words = []
        for k, i in zip(*np.unravel_index(places, over.shape), strict=True):
            if over[k, i] > SMALLEST:
                amount = f"{over[k, i] * self._scales[i]:.2g} {self._units[i]}".strip()
                words.append(f"{self._names[i]} in interval {k + 1} by {amount}")
        return "; ".join(words)

    def _amounts(self, moment: Moment, at: Trajectory) -> Array:
        """How far each variable and row is outside (N × their number), scaled; NaN is infinite."""
        measured = self._linearisation.measure(moment, at)
        values = np.hstack([at.u, at.a, at.x, measured.defects, measured.rows])
        low, high = (
            np.concatenate(pair) for pair in zip(self._bounds, self._row_bounds, strict=True)
        )
        over = np.maximum(low - values, values - high)
        return np.nan_to_num(np.maximum(over, 0.0), nan=np.inf, posinf=np.inf)


_FORCES = {"1/m": "N·m²", "": "N·m"}  # that belong to a strain of that unit
