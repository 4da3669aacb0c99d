"""What a path asks of arm and drive at full speed: an estimate before the run.

A harmonic of the lap at a time, linear, near the middle of the path. The inputs u of a harmonic y
are those that the controller's costs like best,

    min |(G(ω) u - y)/deviation|² + what effort, changes of input and rates of the strains cost,

and the harmonics of G u - y add up to how far the tip is off.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from softmpc.control.costs import StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.ocp import Ocp
from softmpc.control.response import Response
from softmpc.control.rest_path import RestPath

__all__ = ["AtSpeed"]

SAMPLES = 256  # of a lap
HARMONICS = 30
# The estimate knows neither the grid in time nor limits. At 0.2 to 0.4 s a lap closed loops were
# off by 1.3 to 3.5 times as much (RMS): `python -m tests.benchmarks.speeds`.
MEASURED = 3.5
STILL = 1e-6  # of the way that an input moves the tip at most: it does not move there

Array = np.ndarray


class AtSpeed:
    """`off` is how far the tip is off (N, m), `u` the inputs (N×k), at phases (N) of a lap.

    `gain` is how much more input the first harmonic needs than at rest; `share` the number of
    harmonics with 99 % of the motion.
    """

    def __init__(self, rest: RestPath, response: Response, ocp: Ocp) -> None:
        self.law, path = rest.reference.law, rest.reference.path
        self.phase, omega = np.arange(SAMPLES) / SAMPLES, 2 * np.pi / self.law.lap_time
        drift = path.position(np.array([1.0])) - path.position(np.array([0.0]))
        lap = np.fft.rfft(path.position(self.phase) - self.phase[:, None] * drift, axis=0)
        self.share = _main_share(lap)
        to_input = _inverse(response(0.0))  # inputs that move the tip so, at rest
        self.gain = float(np.linalg.norm(_inverse(response(omega) @ to_input), 2))
        off, more = np.zeros_like(lap), np.zeros((len(lap), len(to_input)), complex)
        for k in range(1, HARMONICS):
            u = _best_input(ocp, response, k * omega, lap[k])
            at_rest = to_input @ lap[k]  # what of the path's motion is not to be had is no matter
            off[k], more[k] = response(k * omega) @ u - response(0.0) @ at_rest, u - at_rest
        self.off = MEASURED * np.linalg.norm(np.fft.irfft(off, SAMPLES, axis=0), axis=1)
        first = np.ceil(self.law.smooth_start / self.law.lap_time)  # lap at full speed
        times = (first + self.phase) * self.law.lap_time + self.law.smooth_start / 2
        self.u = rest.held(times) + np.fft.irfft(more, SAMPLES, axis=0)

    @cached_property
    def rate(self) -> Array:
        """Rates of the inputs (N×k), 1/s."""
        step = self.law.lap_time / SAMPLES
        return np.asarray((np.roll(self.u, -1, axis=0) - self.u) / step)


def _inverse(G: Array) -> Array:
    """Of how the tip moves, but for ways on which it does not: those out of a plane, say."""
    return np.asarray(np.linalg.pinv(G, rcond=STILL))


def _best_input(ocp: Ocp, response: Response, omega: float, y: Array) -> Array:
    """Amplitudes of the inputs (k) for those of the tip (3), by the costs that are known here."""
    scale, turn = response.model.layout.u.scale, 1 - np.exp(-1j * omega * ocp.step)
    rates = 1j * omega * response.strains(omega) / response.model.layout.dq.scale[:, None]
    rows: dict[type, Array] = {
        TipPosition: response(omega), Torque: np.diag(1 / scale),
        TorqueRate: turn * np.diag(1 / scale), StrainRate: rates,
    }  # fmt: skip
    known = [cost for cost in ocp.costs if type(cost) in rows]
    A = np.vstack([rows[type(cost)] / cost.deviation for cost in known])
    b = [
        y / cost.deviation if type(cost) is TipPosition else np.zeros(len(rows[type(cost)]))
        for cost in known
    ]
    return np.asarray(np.linalg.lstsq(A, np.concatenate(b), rcond=None)[0])


def _main_share(harmonics: Array) -> float:
    """Number of the harmonic up to which 99 % of the path's motion lies."""
    power = np.cumsum((np.abs(harmonics[1:]) ** 2).sum(axis=1))
    return float(1 + np.searchsorted(power, 0.99 * power[-1]))
