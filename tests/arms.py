"""Arms, states and small tools that several tests share."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from oracles.paper_literal import LiteralSection

from softmpc.model.effects import Coriolis, Effect, Gravity, Inertia, RotaryInertia
from softmpc.model.model import Model, build
from softmpc.model.parameters import Manipulator, Section
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene

Array = NDArray[np.float64]

LEAN: tuple[Effect, ...] = (Gravity(), Inertia(), Coriolis())  # item 6 of the acceptance list
CONSERVATIVE: tuple[Effect, ...] = (*LEAN, RotaryInertia())
PAPER = chen2022()
# Other sizes, four units, none of them at a round angle.
SMALL = Section(
    length=0.15,
    young_modulus=1.5e6,
    shear_modulus=0.45e6,
    bending_radius=0.021,
    disc_radius=0.025,
    unit_offset=0.012,
    unit_area=2.0e-4,
    wall_area=3.0e-4,
    mass=0.2,
    unit_angles=tuple(math.radians(a) for a in (10.0, 100.0, 190.0, 280.0)),
)
ONE_UNIT = replace(SMALL, length=0.2, unit_angles=(0.7,), young_modulus=2e6)


def arm(*sections: Section) -> Manipulator:
    return Manipulator(name="test arm", sections=sections)


MIXED = arm(PAPER.sections[0], SMALL)


def model_of(manipulator: Manipulator = PAPER, **slots: Any) -> Model:
    return build(Scene(manipulator, **slots))


def literal_section(section: Section) -> LiteralSection:
    """A section as the literal transcription wants it."""
    shared = {f.name for f in fields(Section)} & {f.name for f in fields(LiteralSection)}
    return LiteralSection(**{name: getattr(section, name) for name in shared})


class States:
    """Random states of a model: strains of the size that full pressure causes, and rates alike."""

    def __init__(self, model: Model, seed: int = 0) -> None:
        self.model, self.random = model, np.random.default_rng(seed)

    def _draw(self, scale: Array) -> Array:
        return np.asarray(self.random.uniform(-1, 1, len(scale)) * scale)

    def q(self) -> Array:
        return self._draw(self.model.layout.q.scale)

    def motion(self) -> tuple[Array, Array, Array, Array]:
        """(q, dq, ddq, p)."""
        layout = self.model.layout
        p = self.random.uniform(0, 1, len(layout.p)) * layout.p.scale
        return self.q(), self._draw(layout.dq.scale), self._draw(layout.ddq.scale), p


def numbers(values: Any) -> Array:
    """A CasADi result as a NumPy array, columns as vectors."""
    array = np.asarray(values, dtype=float)
    return array.ravel() if array.ndim == 2 and array.shape[1] == 1 else array


def differences(function: Callable[[Array], Any], at: Array, step: Array) -> Array:
    """Jacobian by central differences of sixth order, one column an entry of `at`."""
    columns = []
    for j, h in enumerate(step):
        shift = np.zeros(len(at))
        shift[j] = h
        pairs = [
            numbers(function(at + m * shift)) - numbers(function(at - m * shift)) for m in (1, 2, 3)
        ]
        columns.append((45 * pairs[0] - 9 * pairs[1] + pairs[2]) / (60 * h))
    return np.stack(columns, axis=-1)


def largest(found: Any, wanted: Any, rows: Array | None = None) -> float:
    """Largest error relative to the largest entry of each row (or `rows`)."""
    found, wanted = np.asarray(found, dtype=float), np.asarray(wanted, dtype=float)
    size = np.abs(wanted).reshape(len(wanted), -1).max(axis=1) if rows is None else rows
    error = np.abs(found - wanted).reshape(len(wanted), -1).max(axis=1)
    return float((error / np.maximum(size, 1e-300)).max())
