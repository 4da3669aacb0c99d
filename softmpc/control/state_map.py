"""The controller's state from the plant's, where the two are different scenes of one arm.

Strains of the controller's segments are means of the plant's over the same stretch of the section,
so that the bending of a section stays the same. Strains and drive states go by name. What only the
controller knows is put in: strains as zero, drive states in balance with the pressures.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softmpc.errors import SceneError
from softmpc.model.model import Model

__all__ = ["StateMap"]

Array = Any


class StateMap:
    """x of the controller's model is `A x + B u` of the plant's; `SceneError` for different arms.

    The inputs are the same, and the plant's go to the controller as they are.
    """

    def __init__(self, plant: Model, controller: Model) -> None:
        self.plant, self.controller = plant, controller
        _check_same_arm(plant, controller)
        strains = _strains(plant, controller)
        by_z, by_u = _drive(plant, controller)
        n, m = strains.shape
        rows, columns = len(controller.layout.x), len(plant.layout.x)
        self.A = np.zeros((rows, columns))
        self.A[:n, :m] = self.A[n : 2 * n, m : 2 * m] = strains
        self.A[2 * n :, 2 * m :] = by_z
        self.B = np.zeros((rows, len(plant.layout.u)))
        self.B[2 * n :] = by_u

    @property
    def is_identity(self) -> bool:
        """Whether both have the same states."""
        same = self.plant.layout.x.names == self.controller.layout.x.names
        return same and bool(np.array_equal(self.A, np.eye(len(self.A)))) and not self.B.any()

    def __call__(self, x: Array, u: Array) -> Array:
        """State of the controller's model (nx) for state and input of the plant (SI)."""
        return self.A @ np.asarray(x, float) + self.B @ np.asarray(u, float)


def _check_same_arm(plant: Model, controller: Model) -> None:
    ours, theirs = controller.scene, plant.scene
    units = [[len(s.unit_angles) for s in scene.manipulator.sections] for scene in (ours, theirs)]
    if units[0] != units[1]:
        raise SceneError(
            f"the controller's arm has {units[0]} units in its sections and the plant's "
            f"{units[1]}: both must be scenes of one arm"
        )
    kinds = ours.actuation.input, theirs.actuation.input
    if kinds[0] != kinds[1]:
        raise SceneError(
            f"the controller's actuation {ours.actuation.name!r} takes {kinds[0]}s and the plant's "
            f"{theirs.actuation.name!r} {kinds[1]}s: choose two with the same input"
        )


def _strains(plant: Model, controller: Model) -> Array:
    """Controller's strains from the plant's (n×m), by the names of sections and kinds."""
    ours, theirs = controller.scene.segments, plant.scene.segments
    share = _overlaps(ours, theirs)
    columns = {name: j for j, name in enumerate(plant.layout.q.names)}
    matrix = np.zeros((controller.strains, plant.strains))
    for row, name in enumerate(controller.layout.q.names):
        kind, section, segment = name.rsplit("_", 2)
        for j in range(theirs):
            column = columns.get(f"{kind}_{section}_{j + 1}")
            if column is not None:
                matrix[row, column] = share[int(segment) - 1, j]
    return matrix


def _overlaps(ours: int, theirs: int) -> Array:
    """How much of each of our equal segments lies in each of theirs (ours×theirs)."""
    a, b = np.arange(ours)[:, None] / ours, np.arange(theirs) / theirs
    length = np.minimum(a + 1 / ours, b + 1 / theirs) - np.maximum(a, b)
    share = np.maximum(length, 0.0) * ours
    return np.where(share < 1e-12, 0.0, share)


def _drive(plant: Model, controller: Model) -> tuple[Array, Array]:
    """Controller's drive states from the plant's and its input."""
    ours, theirs = controller.layout.z.names, plant.layout.z.names
    # In balance with the pressures: at rest under the inputs that hold them.
    balanced = np.zeros((len(ours), len(plant.layout.p)))
    if ours:
        gain = controller.drive.static_gain
        balanced = np.asarray(controller.drive.at_rest(np.linalg.inv(gain)))
    by_z, by_u = balanced @ plant.drive.C, balanced @ plant.drive.D
    columns = {name: j for j, name in enumerate(theirs)}
    slow = _slow_modes(plant)
    for row, name in enumerate(ours):
        kind, unit = name.rsplit("_", 1)
        if name in columns:
            by_z[row], by_u[row] = np.eye(len(theirs))[columns[name]], 0.0
        elif kind == "P_slow" and theirs:
            by_z[row], by_u[row] = slow[int(unit) - 1], 0.0
    return by_z, by_u


def _slow_modes(plant: Model) -> Array:
    """The slowest mode's share of each unit's pressure, from the plant's drive states (m×h).

    It is the left eigenvector of the unit's slowest pole, scaled as `P_slow` is.
    """
    drive, units = plant.drive, len(plant.layout.p)
    found = np.zeros((units, len(drive.A)))
    for j in range(units if len(drive.A) else 0):
        own = slice(j, None, units)
        poles, modes = np.linalg.eig(drive.A[own, own])
        k = int(np.argmin(np.abs(poles)))
        mode = np.linalg.inv(modes)[k] * (drive.C[j, own] @ modes[:, k])
        found[j, own] = mode.real
    return found
