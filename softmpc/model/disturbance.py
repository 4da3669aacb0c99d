"""What a model does not know: constant forces on its strains and offsets of its inputs.

    r(q, dq, ddq, P) = F d,    the drive is given u + G d

A payload, a stiffer wall or a friction that the model lacks look like such a d at rest; an
estimator finds it and a controller takes it into account. It is scaled: 1 is what full pressure
does to a strain, or the largest torque.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softmpc.errors import InputError, unknown_name
from softmpc.model.layout import Layout
from softmpc.model.scene import STRAINS, Scene

__all__ = ["SEEN", "Disturbance"]

SEEN = ("epsilon", "kappa_x", "kappa_y")  # strains that move the tips of their sections at once


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Unknown quantities d (D): forces F d on the strains (n×D), offsets G d of the inputs (k×D).

    Compared by identity, as models are; make it with `Disturbance.of`.
    """

    names: tuple[str, ...]
    F: np.ndarray
    G: np.ndarray

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def of(
        cls, scene: Scene, strains: Sequence[str] | None = None, inputs: bool | None = None
    ) -> Disturbance:
        """One force for each of these strains of each section, the same on all its segments.

        With `inputs` one offset for each input as well; by default where inputs are torques, for
        the pressures that they leave can be measured. The strains are by default all of the scene
        but twist: a tip on its section's axis does not move with it.
        """
        layout = Layout.of(scene)
        if strains is None:
            strains = [kind for kind in SEEN if kind in scene.strains]
        for kind in strains:
            if kind not in scene.strains:
                raise InputError(unknown_name("Disturbance strains", kind, scene.strains))
        torques = scene.actuation.input == "torque"
        forces = [
            (kind, section)
            for section in range(1, len(scene.manipulator.sections) + 1)
            for kind in STRAINS
            if kind in strains
        ]
        offsets = layout.u.names if (torques if inputs is None else inputs) else ()
        F = np.zeros((len(layout.q), len(forces) + len(offsets)))
        G = np.zeros((len(layout.u), len(forces) + len(offsets)))
        for column, (kind, section) in enumerate(forces):
            for row, name in enumerate(layout.q.names):
                if name.startswith(f"{kind}_{section}_"):
                    F[row, column] = layout.r.scale[row]
        G[:, len(forces) :] = np.diag(layout.u.scale)[:, : len(offsets)]
        names = tuple(f"force on {kind}_{section}" for kind, section in forces)
        return cls(names + tuple(f"offset of {name}" for name in offsets), F, G)
