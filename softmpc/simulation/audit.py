"""Energy audit: what an arm stores is what was put in less what was lost.

    Σ energies(t) - Σ energies(0) = Σ ∫ powers dt,

term by term, over a recorded motion. The powers are integrated over the motion between the samples
(`between`), so that the usual 0.01 s will do. Where the balance of a piece is rough, as after a
jump of the input, the motion in it is integrated anew between the recorded states.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softmpc.errors import BuildError, InputError
from softmpc.model.effects import Coriolis
from softmpc.model.model import Model
from softmpc.simulation.between import MotionBetween
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.result import Simulation

__all__ = ["Audit", "audit"]

POINTS = 5  # of Gauss, in each stretch of time
GROWTH = 3.0  # of the stretches after a breakpoint, where the drive's fastest modes die out
ROUNDS, PARTS = 2, 16  # of finer pieces where the balance is rough, and how much finer
ROUGH = 2e-8  # of the turnover, in one piece
MOST = 500  # pieces made finer in one round
CHUNK = 4096  # stretches at once: bounds the memory
LEAST = 1e-6  # turnover, as a share of the energy of full strains: rest does not divide by zero


@dataclass(frozen=True, eq=False)
class Audit:
    """Energies and works at times `time` (K, s), each (K) in J and by name.

    A work is positive where energy is put into the arm: drive and load, mostly; damping never.
    `missing` says why the balance cannot close, if the scene has forces without an energy.
    """

    time: np.ndarray
    energies: dict[str, np.ndarray]
    works: dict[str, np.ndarray]
    missing: tuple[str, ...]
    least: float  # J, of `turnover`

    @property
    def error(self) -> np.ndarray:
        """Energy that came from nowhere (K, J): change of all energies less all works."""
        changes = [energy - energy[0] for energy in self.energies.values()]
        nothing = np.zeros(len(self.time))
        return np.asarray(sum(changes, nothing) - sum(self.works.values(), nothing))

    @property
    def turnover(self) -> float:
        """The most energy (J) that any term took up or gave away."""
        sizes = [np.abs(energy - energy[0]).max() for energy in self.energies.values()]
        sizes += [np.abs(work).max() for work in self.works.values()]
        return float(max([*sizes, self.least]))

    @property
    def closure(self) -> float:
        """Largest |error| over the turnover; nan where a term is missing."""
        return float("nan") if self.missing else float(np.abs(self.error).max()) / self.turnover

    def columns(self) -> dict[str, np.ndarray]:
        """Energies, works and the error as columns, titles with units."""
        columns = {"t [s]": self.time}
        columns |= {f"{name}_energy [J]": energy for name, energy in self.energies.items()}
        columns |= {f"{name}_work [J]": work for name, work in self.works.items()}
        return columns if self.missing else columns | {"error [J]": self.error}

    def at(self, time: np.ndarray) -> Audit:
        """The same at some of its times."""
        some = np.searchsorted(self.time, time)
        energies, works = (
            {name: values[some] for name, values in terms.items()}
            for terms in (self.energies, self.works)
        )
        return replace(self, time=time, energies=energies, works=works)

    def summary(self) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        return {
            "closure": None if self.missing else self.closure,
            "missing": list(self.missing),
            "turnover_j": self.turnover,
            "energy_change_j": {name: float(e[-1] - e[0]) for name, e in self.energies.items()},
            "work_j": {name: float(work[-1]) for name, work in self.works.items()},
        }


def audit(model: Model, simulation: Simulation, profile: InputProfile | None = None) -> Audit:
    """The energy balance of a motion that `simulate` made of this model.

    `profile` are its inputs, by default those the simulation remembers. Raises `InputError` where
    there are none or where model and simulation do not match. Where the motion between samples is
    not known, as of an arm with neither inertia nor damping, there are no works, and `missing` says
    why.
    """
    profile = profile or simulation.profile
    if profile is None:
        raise InputError("this simulation does not know its inputs: give audit their profile")
    if simulation.x.shape[1] != len(model.layout.x):
        raise InputError(
            f"a simulation of {simulation.x.shape[1]} states: this model has {len(model.layout.x)}"
        )
    missing = _missing(model)
    least = LEAST * float(np.abs(model.layout.r.scale * model.layout.q.scale).sum())
    if len(simulation.time) < 2:
        return Audit(simulation.time, _energies(model, simulation.x), {}, missing, least)
    try:
        motion = MotionBetween.of(model, simulation, profile)
    except BuildError as error:
        energies, missing = _energies(model, simulation.x), (*missing, f"work: {error}")
        return Audit(simulation.time, energies, {}, missing, least)
    whole = _audit(motion, profile, missing, least)
    for _ in range(0 if missing else ROUNDS):
        steps = np.abs(np.diff(whole.error))
        rough = (steps > ROUGH * whole.turnover) & (steps >= np.sort(steps)[-MOST:][0])
        if not rough.any():
            break
        motion = motion.refined(rough, PARTS)
        whole = _audit(motion, profile, missing, least)
    return whole.at(simulation.time)


def _audit(
    motion: MotionBetween, profile: InputProfile, missing: tuple[str, ...], least: float
) -> Audit:
    """At the ends of all pieces of a motion."""
    energies = _energies(motion.model, motion.x)
    return Audit(motion.time, energies, _works(motion, profile), missing, least)


def _energies(model: Model, x: np.ndarray) -> dict[str, np.ndarray]:
    q, dq, _ = np.split(x, [model.strains, 2 * model.strains], axis=1)
    return _named(model.energies, q, dq)


def _missing(model: Model) -> tuple[str, ...]:
    """Why the energies of a scene cannot balance, if so."""
    reasons, scene = [], model.scene
    law = scene.formulation.elasticity
    if "elastic" not in model.energies.name_out():
        reasons.append(f"elastic: the elastic law {law.name!r} has no energy; take 'energy'")
    if model.order == 2 and scene.effect(Coriolis) is None:
        reasons.append("kinetic: without the effect 'coriolis' inertia has no energy")
    return tuple(reasons)


def _works(motion: MotionBetween, profile: InputProfile) -> dict[str, np.ndarray]:
    """∫ of each power from the start to each end of a piece (J)."""
    ends = _stretches(motion, profile)
    piece = np.searchsorted(motion.time, ends[:-1], side="right") - 1
    names = motion.model.powers.name_out()
    gained = np.zeros((len(names), len(piece)))
    for first in range(0, len(piece), CHUNK):
        some = slice(first, first + CHUNK)
        gained[:, some] = _gained(motion, piece[some], ends[:-1][some], ends[1:][some])
    work = np.concatenate([np.zeros((len(names), 1)), np.cumsum(gained, axis=1)], axis=1)
    return dict(zip(names, work[:, np.searchsorted(ends, motion.time)], strict=True))


def _stretches(motion: MotionBetween, profile: InputProfile) -> np.ndarray:
    """Ends of the stretches of quadrature: of the pieces, and ever longer ones after a jump."""
    ends = motion.time
    if not motion.fastest:
        return ends
    jumps = np.union1d(ends[:1], profile.breakpoints)
    count = max(0, int(np.log(motion.fastest * np.median(motion.lengths)) / np.log(GROWTH)) + 1)
    cuts = np.add.outer(jumps, GROWTH ** np.arange(count) / motion.fastest).ravel()
    return np.union1d(ends, cuts[(cuts > ends[0]) & (cuts < ends[-1])])


def _gained(
    motion: MotionBetween, piece: np.ndarray, start: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """∫ of each power (powers × N, J) over stretches (N) by Gauss quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    length = (end - start)[:, None]
    time = start[:, None] + length * (1 + nodes) / 2
    at_nodes = (value.reshape(time.size, -1) for value in motion(piece, time))
    found = _named(motion.model.powers, *at_nodes)
    powers = np.stack([power.reshape(time.shape) for power in found.values()])
    return np.asarray((powers * weights).sum(axis=2) * length[:, 0] / 2)


def _named(function: Any, *arguments: np.ndarray) -> dict[str, np.ndarray]:
    """Scalar outputs (N each) of a CasADi function by name."""
    outputs = function.map(len(arguments[0])).call([argument.T for argument in arguments])
    names = function.name_out()
    return {name: np.asarray(value).ravel() for name, value in zip(names, outputs, strict=True)}
