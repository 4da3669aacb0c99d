"""Is a path feasible? What is not, where and by how much, before anything moves.

    reach        a place of the path that the arm at rest cannot hold
    torque       inputs at rest beyond what the controller may use
    torque rate  inputs at rest that have to change faster than they may
    bandwidth    arm and drive would have to be led beyond their reach to be in time
    controller   a place that the controller's own model, where it is another one, cannot hold

For the last one the path is led: each of its harmonics is enlarged and turned in phase by what arm
and drive lose at its frequency, near the middle of the path. At rest, the led path needs the
inputs that the path needs at speed. It is an estimate, good to some tens of per cent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softmpc.control.limits import Limit, TorqueLimit, TorqueRateLimit
from softmpc.control.paths import Reference
from softmpc.control.response import Response
from softmpc.control.rest_path import IN_REACH, NODES, RestPath, along, find_rest_path
from softmpc.model.model import Model
from softmpc.statics.inverse import InverseStatics

__all__ = ["Finding", "Preflight", "find_preflight"]

SAMPLE = 5e-3  # s
SAMPLES = 256  # of a lap, for its harmonics
HARMONICS = 30
LED_NODES = 32  # of the led lap
LED_REACH = 5e-3  # m that the led path may be out of reach: it is an estimate
OTHER_REACH = 1e-3  # m that models of one arm may differ: feedback makes up for it
SLACK = 1e-6  # of an input's scale

Array = np.ndarray


@dataclass(frozen=True)
class Finding:
    """One part of a path that cannot be followed."""

    kind: str  # "reach", "torque", "torque rate", "bandwidth" or "controller"
    start: float  # s
    end: float
    place: tuple[float, ...]  # of the reference where it is worst, m
    excess: float  # in `unit`
    unit: str
    note: str = ""

    @property
    def text(self) -> str:
        """One line for people."""
        place = ", ".join(f"{x:.3f}" for x in self.place)
        what = {
            "reach": "out of reach",
            "torque": "torque at rest above what is allowed",
            "torque rate": "torque at rest changes faster than allowed",
            "bandwidth": "faster than arm and drive: led, it is out of reach",
            "controller": "out of reach of the controller's own model",
        }[self.kind]
        note = f" ({self.note})" if self.note else ""
        when = f"t = {self.start:.2f} to {self.end:.2f} s"
        amount = f"{self.excess:.3g} {self.unit}"
        return f"{self.kind}: {when}: {what} by up to {amount}, at ({place}) m{note}"


@dataclass(frozen=True, eq=False)
class Preflight:
    """What is known of a path before the run."""

    rest: RestPath
    findings: tuple[Finding, ...]
    facts: dict[str, float]  # numbers of arm and path, see `find_preflight`

    @property
    def feasible(self) -> bool:
        return not self.findings

    @property
    def lines(self) -> list[str]:
        """What is infeasible, a line each."""
        return [finding.text for finding in self.findings]

    @cached_property
    def jumps(self) -> Array:
        """Times (s) at which the nearest posture jumps."""
        return self.rest.jump_times(_times(self.rest.reference))


def find_preflight(
    inverse: InverseStatics,
    reference: Reference,
    limits: Sequence[Limit] = (),
    step: float = 0.025,
    nodes: int = NODES,
    controller: Model | None = None,
) -> Preflight:
    """Check a reference against the arm and the limits of a controller with that step (s).

    `controller` is the controller's model where that is not the arm's.
    """
    rest = find_rest_path(inverse, reference, nodes)
    response = Response(inverse.model, rest.middle.q, rest.middle.pressures)
    findings = [*_reach(rest), *_torque(rest, limits), *_rate(rest, limits, step)]
    led = _Led(inverse, rest, response)
    findings += led.findings
    if controller is not None and controller is not inverse.model:
        findings += _beyond(InverseStatics(controller, starts=inverse.starts), rest)
    return Preflight(rest, tuple(findings), _facts(rest, response, led))


# --- at rest -----------------------------------------------------------------------------------


def _times(reference: Reference) -> Array:
    return np.arange(0.0, reference.duration + SAMPLE / 2, SAMPLE)


def _reach(rest: RestPath) -> list[Finding]:
    t = _times(rest.reference)
    far = rest.out_of_reach(t)

    def held_back(worst: int) -> str:
        place = rest.reference.position(t[worst : worst + 1])[0]
        node = int(np.argmin(np.linalg.norm(rest.targets - place, axis=1)))
        active = rest.found[node].active
        return f"held back by {', '.join(active)}" if active else ""

    return _stretches("reach", rest, t, 1e3 * far, 1e3 * IN_REACH, "mm", held_back)


def _torque(rest: RestPath, limits: Sequence[Limit]) -> list[Finding]:
    t, unit = _times(rest.reference), _unit(rest)
    u, over = rest.inputs(t), np.zeros(len(t))
    for limit in limits:
        if isinstance(limit, TorqueLimit):
            over = np.maximum(over, np.maximum(u - limit.high, limit.low - u).max(axis=1))
    scale = float(rest.model.layout.u.scale.max())
    return _stretches("torque", rest, t, over, SLACK * scale, unit)


def _rate(rest: RestPath, limits: Sequence[Limit], step: float) -> list[Finding]:
    """Away from jumps, where the inputs at rest have no rate."""
    t, unit = _times(rest.reference), _unit(rest)
    rate, over = _rates(rest, t), np.zeros(len(t))
    for limit in limits:
        if isinstance(limit, TorqueRateLimit):
            over = np.maximum(over, (rate - limit.high / step).max(axis=1))
            over = np.maximum(over, (limit.low / step - rate).max(axis=1))
    scale = float(rest.model.layout.u.scale.max())
    return _stretches("torque rate", rest, t, over, SLACK * scale / step, f"{unit}/s")


def _rates(rest: RestPath, t: Array) -> Array:
    """Rates of the inputs at rest (N×k)."""
    h = SAMPLE
    rate = (rest.inputs(t + h) - rest.inputs(t - h)) / (2 * h)
    jumps = rest.in_transit(t) | rest.in_transit(t + h) | rest.in_transit(t - h)
    return np.where(jumps[:, None], 0.0, rate)


def _unit(rest: RestPath) -> str:
    return "N·m" if rest.model.scene.actuation.input == "torque" else "Pa"


def _beyond(inverse: InverseStatics, rest: RestPath) -> list[Finding]:
    """Where another model of the arm does not get to the places in reach."""
    some = np.unique(np.linspace(0, len(rest.found) - 1, LED_NODES).round().astype(int))
    far = np.array([one.distance for one in along(inverse, rest.tips[some])])
    t = _times(rest.reference)
    phase = rest.lap.within(rest.reference.law.phase(t))
    excess = 1e3 * np.interp(phase, rest.lap.phase[some], far)
    return _stretches("controller", rest, t, excess, 1e3 * OTHER_REACH, "mm")


def _stretches(
    kind: str,
    rest: RestPath,
    t: Array,
    excess: Array,
    allowed: float,
    unit: str,
    note: object = None,
) -> list[Finding]:
    """One finding for each stretch of time in which the excess (N) is above what is allowed."""
    over = np.concatenate([[0], (excess > allowed).astype(int), [0]])
    starts, ends = np.flatnonzero(np.diff(over) == 1), np.flatnonzero(np.diff(over) == -1)
    findings = []
    for a, b in zip(starts, ends, strict=True):
        worst = a + int(np.argmax(excess[a:b]))
        place = rest.reference.position(t[worst : worst + 1])[0]
        said = note(worst) if callable(note) else ""
        findings.append(
            Finding(kind, t[a], t[b - 1], tuple(place.tolist()), float(excess[worst]), unit, said)
        )
    return findings


# --- at speed ----------------------------------------------------------------------------------


class _Led:
    """The lap as arm and drive must be led to follow it, at full speed."""

    def __init__(self, inverse: InverseStatics, rest: RestPath, response: Response) -> None:
        self.rest, law = rest, rest.reference.law
        self.phase = np.arange(SAMPLES) / SAMPLES
        path, omega = rest.reference.path, 2 * np.pi / law.lap_time
        lap = path.position(self.phase)
        drift = path.position(np.array([1.0])) - path.position(np.array([0.0]))
        harmonics = np.fft.rfft(lap - self.phase[:, None] * drift, axis=0)
        self.share = _main_share(harmonics)
        still = response(0.0)
        led = np.zeros_like(harmonics)
        led[0] = harmonics[0]
        to_input = np.linalg.pinv(still)  # inputs that move the tip so, at rest
        for k in range(1, HARMONICS):
            led[k] = np.linalg.solve(response(k * omega) @ to_input, harmonics[k])
        self.gain = float(np.linalg.norm(np.linalg.inv(response(omega) @ to_input), 2))
        self.lap = np.fft.irfft(led, SAMPLES, axis=0) + self.phase[:, None] * drift
        self.found = self._found(inverse)

    def _found(self, inverse: InverseStatics) -> tuple[Array, Array]:
        """How far the led path is out of reach (K), and the inputs that hold it (K×k)."""
        nodes = self.lap[:: SAMPLES // LED_NODES]
        found = along(inverse, nodes, self.rest.found[0])
        far = np.array([one.distance for one in found])
        u = [one.pressures if one.torques is None else one.torques for one in found]
        return far, np.array(u)

    @property
    def findings(self) -> list[Finding]:
        """Where it is out of reach by more than the path itself."""
        t = _times(self.rest.reference)
        phase = self.rest.reference.law.phase(t)
        nodes = np.arange(LED_NODES + 1) / LED_NODES
        far = np.interp(phase % 1.0, nodes, np.append(self.found[0], self.found[0][0]))
        excess = 1e3 * (far - self.rest.out_of_reach(t))
        excess = np.where(t < self.rest.reference.law.smooth_start, 0.0, excess)
        return _stretches("bandwidth", self.rest, t, excess, 1e3 * LED_REACH, "mm")

    @property
    def fastest(self) -> float:
        """Largest rate of an input (1/s), as a mean over one node of the lap."""
        u = self.found[1]
        step = self.rest.reference.law.lap_time / LED_NODES
        return float(np.abs(np.diff(u, axis=0)).max() / step)


def _main_share(harmonics: Array) -> float:
    """Number of the harmonic up to which 99 % of the path's motion lies."""
    power = np.cumsum((np.abs(harmonics[1:]) ** 2).sum(axis=1))
    return float(1 + np.searchsorted(power, 0.99 * power[-1]))


def _facts(rest: RestPath, response: Response, led: _Led) -> dict[str, float]:
    """Numbers of arm and path: SI, frequencies in Hz."""
    t, lap = _times(rest.reference), rest.reference.law.lap_time
    facts = {
        "largest_input_at_rest": float(rest.u.max()),
        "largest_input_rate_at_rest": float(np.abs(_rates(rest, t)).max()),
        "largest_input_rate_at_speed": led.fastest,
        "path_frequency_hz": led.share / lap,
        "lead": led.gain,
    }
    for name, poles in (("arm", response.arm_poles), ("drive", response.drive_poles)):
        if len(poles):
            facts[f"slowest_{name}_pole_hz"] = float(np.abs(poles[0]) / (2 * np.pi))
    return facts
