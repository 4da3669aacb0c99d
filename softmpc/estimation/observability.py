"""What the readings tell of the state and the disturbance, before anything moves.

Linearised at rest, and in units that mean something: each variable begins unknown to its whole
scale, and readings with their noise and rates come for a while, without process noise. A direction
that is then still unknown to a large share of that is not observable in practice, whatever the
rank of a matrix in floating point.

    state          after 0.1 s with the disturbance known: not seen, and not gone by itself
    disturbance    after 2 s with nothing known: not seen, and it does not go away (not detectable)

Offset-free tracking needs [A - I, B_d; C, C_d] to have full column rank. Where the arm has a rest,
that is the rank of what d does to the readings at rest, C (I - A)⁻¹ B_d + C_d: its singular
values count standard deviations of a step's readings for a disturbance of full size.
(Pannocchia and Rawlings, AIChE Journal 49, 2003; Maeder, Borrelli and Morari, Automatica 45, 2009.)
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softmpc.errors import InputError
from softmpc.estimation.kalman import expected, predicted, updated
from softmpc.estimation.process import Process
from softmpc.estimation.sensors import TICK, Reading, Sensor

__all__ = ["Direction", "Linear", "Observability", "linear_at", "observability"]

LOG = logging.getLogger(__name__)
Array = np.ndarray
STEP = 0.02  # s
STATES, ALL = 0.1, 2.0  # s of readings
PERIODS = 10  # of the slowest sensor, that it looks at in any case
WEAK, UNSEEN = 0.1, 0.5  # shares of a scale that are still unknown
AT_REST = 1.0  # standard deviations by which a disturbance of full size must move these
TWIST = "twist, with which tips on the axis of a straight arm do not move; damped, it dies away"
HINTS = {
    "kappa_z": "tips on the axis hardly move with twist: leave kappa_z out of the disturbance",
    "offset of": "pressures tell offsets of inputs from forces on strains: add a sensor of them, "
    "UnitPressures or [rig.unit_pressures], with less noise if there is one; or leave the offsets "
    "out, inputs=False or [rig.estimator] offsets = false",
    "force on": "leave this force out, or let a sensor look at that section",
}


@dataclass(frozen=True)
class Direction:
    """A combination of variables that readings hardly tell.

    `deviation`: its standard deviation at the end, as a share of scales.
    """

    deviation: float
    variables: tuple[str, ...]  # the largest first

    def __str__(self) -> str:
        return f"{', '.join(self.variables)} (unknown to {100 * self.deviation:.0f} % of full)"


@dataclass(frozen=True)
class Linear:
    """s' = A s over `step` seconds, readings y = H s with variances R of as many a step."""

    step: float
    A: Array
    H: Array
    R: Array
    nx: int


@dataclass(frozen=True)
class Observability:
    """What readings tell. `rank` counts disturbances that are seen at rest, of `needed`; `rest` has
    the standard deviations by which those of full size move the readings of a step (20 ms) at rest,
    the least last; `names` are those of the disturbance."""

    states: tuple[Direction, ...]
    disturbances: tuple[Direction, ...]
    rest: Array
    outputs: int
    names: tuple[str, ...]

    @property
    def needed(self) -> int:
        return len(self.rest)

    @property
    def rank(self) -> int:
        return int(np.sum(self.rest >= AT_REST))

    @property
    def offset_free(self) -> bool:
        """Whether a constant disturbance shows in the readings at rest, each in its own way."""
        return self.rank == self.needed

    @property
    def undetectable(self) -> tuple[Direction, ...]:
        return tuple(one for one in self.disturbances if one.deviation >= UNSEEN)

    def weak_states(self) -> list[str]:
        """One line for each direction of the state of which readings tell little."""
        lines = []
        for one in self.states:
            twist = all("kappa_z" in name for name in one.variables)
            lines.append(f"state {one}" + f": {TWIST}" * twist)
        return lines

    def weak_disturbances(self) -> list[str]:
        """The same of the disturbance."""
        lines = [f"disturbance {one}" for one in self.disturbances]
        if not self.offset_free:
            lines.append(f"disturbance at rest: {self.rank} of {self.needed} directions show")
        return lines

    def tell(self) -> None:
        """Log what is weak: of the disturbance as a warning, for offset-free control needs it."""
        for line in self.weak_disturbances():
            LOG.warning("readings tell little of the %s", line)
        for line in self.weak_states():
            LOG.info("readings tell little of the %s", line)

    def require_detectable(self) -> None:
        """Raise `InputError` where a part of the disturbance can never be known."""
        lost = self.undetectable
        if not lost:
            return
        mentioned = {name for one in lost for name in one.variables}
        names = ", ".join(name for name in self.names if name in mentioned)
        hint = next((text for key, text in HINTS.items() if key in names), HINTS["force on"])
        raise InputError(
            f"the sensors do not tell {len(lost)} of {self.needed} directions of the disturbance "
            f"({self.outputs} values are measured), combinations of {names}; {hint}"
        )


def linear_at(
    process: Process,
    sensors: Sequence[Sensor],
    readings: Sequence[Reading],
    x: Array,
    u: Array,
) -> Linear:
    """The estimator's model at a state of rest."""
    p = process
    s = np.concatenate([x, np.zeros(len(p.disturbance))]) / p.scale
    _, A, _ = p.advance(s, u, STEP)
    H, R = [np.zeros((0, p.size))], [np.zeros(0)]
    for sensor, reading in zip(sensors, readings, strict=True):
        if sensor.dropout < 1.0:
            rows = np.hstack([reading(x, u)[1] * p.scale[: p.nx], reading.by_u @ p.disturbance.G])
            H.append(rows)
            each = sensor.period * TICK / STEP / (1.0 - sensor.dropout)
            R.append(sensor.variances(reading, p.model) * each)
    return Linear(STEP, A, np.vstack(H), np.concatenate(R), p.nx)


def observability(
    process: Process, sensors: Sequence[Sensor], readings: Sequence[Reading], x: Array, u: Array
) -> Observability:
    """What sensors tell of a model at the state of rest x under the input u (SI)."""
    at = linear_at(process, sensors, readings, x, u)
    names = process.model.layout.x.names + process.disturbance.names
    slowest = max(sensor.period for sensor in sensors) * TICK
    state, everything = np.ones(process.size), np.ones(process.size)
    state[at.nx :] = 0.0
    after = _unknown(at, state, max(STATES, PERIODS * slowest))
    states = _directions(after[: at.nx, : at.nx], names[: at.nx])
    after = _unknown(at, everything, max(ALL, PERIODS * slowest))
    lasting = _directions(after[at.nx :, at.nx :], names[at.nx :])
    return Observability(states, lasting, _at_rest(at), len(at.H), names[at.nx :])


def _unknown(at: Linear, variances: Array, seconds: float) -> Array:
    """Covariance after a time of readings, without process noise."""
    P, s, none = np.diag(variances), np.zeros(len(variances)), np.zeros(len(variances))
    e = np.zeros(len(at.H))
    for _ in range(round(seconds / at.step)):
        P = predicted(P, at.A, none)
        _, P = updated(s, P, expected(P, e, at.H, at.R))
    return P


def _directions(P: Array, names: Sequence[str]) -> tuple[Direction, ...]:
    """Those known worse than `WEAK`, the worst first."""
    values, vectors = np.linalg.eigh(P)
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        deviation = float(np.sqrt(max(value, 0.0)))
        if deviation < WEAK:
            break
        shares = np.abs(vector)
        order = [int(i) for i in np.argsort(-shares) if shares[i] >= 0.3 * shares.max()]
        found.append(Direction(deviation, tuple(names[i] for i in order)))
    return tuple(found)


def _at_rest(at: Linear) -> Array:
    """Singular values (nd) of what d does to a set of readings at rest, in deviations."""
    nx = at.nx
    nd = len(at.A) - nx
    settled = np.linalg.solve(np.eye(nx) - at.A[:nx, :nx], at.A[:nx, nx:])
    gain = (at.H[:, :nx] @ settled + at.H[:, nx:]) / np.sqrt(at.R)[:, None]
    found = np.linalg.svd(gain, compute_uv=False) if gain.size else np.zeros(0)
    return np.concatenate([found, np.zeros(max(nd - len(found), 0))])
