"""Is a path feasible? What is not, where and by how much, before anything moves.

    reach        a place of the path that the arm at rest cannot hold
    tip box      a place outside the box that the controller keeps the tip in
    torque       inputs at rest beyond what the controller may use
    torque rate  inputs at rest that have to change faster than they may
    bandwidth    the controller would be off by more than its costs allow
    … at speed   torque, or its rate, beyond the limits where the path runs at full speed
    controller   a place that the controller's own model, where it is another one, cannot hold
    planned …    torque, or its rate, of a plan beyond the limits; nothing else of a plan is checked
    start        a place where a plan begins at rest and the plant cannot

What is at full speed is an estimate, see `AtSpeed`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softmpc.control.at_speed import AtSpeed
from softmpc.control.costs import TipPosition
from softmpc.control.limits import Limit, TipBox, TorqueLimit, TorqueRateLimit
from softmpc.control.ocp import Ocp
from softmpc.control.paths import Reference
from softmpc.control.response import Response
from softmpc.control.rest_path import (
    IN_REACH,
    NODES,
    RestPath,
    along,
    find_rest_path,
    lap_of,
)
from softmpc.errors import InputError
from softmpc.model.model import Model
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.reach import FAR, too_far

__all__ = [
    "Finding", "Preflight", "beyond", "check_reach", "find_preflight", "input_unit", "stretches",
]  # fmt: skip

SAMPLE = 5e-3  # s
OTHER_NODES = 32  # of the lap, for the controller's own model
# Of an input's scale, beyond its limits at speed: the units share a torque in more ways than the
# estimate knows. Closed loops of which it says 0.2 were off by 1 mm at most.
SHARED = 0.2
OTHER_REACH = 1e-3  # m that models of one arm may differ: feedback makes up for it
SLACK = 1e-6  # of an input's scale
LOOKED_AT = 4  # places of a lap, to see whether all of it is far away:
AWAY = 0.1  # of the arm's length

Array = np.ndarray
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Finding:
    """One part of a path that cannot be followed."""

    kind: str  # see the top of this file
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
            "tip box": "outside the box of the tip",
            "torque": "torque at rest above what is allowed",
            "torque rate": "torque at rest changes faster than allowed",
            "bandwidth": "too fast for the controller's costs: off",
            "torque at speed": "torque at full speed above what is allowed",
            "torque rate at speed": "torque at full speed changes faster than allowed",
            "controller": "out of reach of the controller's own model",
            "planned torque": "torque of the plan beyond what is allowed",
            "planned torque rate": "torque of the plan changes faster than allowed",
            "start": "the plant cannot rest where the plan begins, it is off",
        }[self.kind]
        if self.unit.startswith("Pa"):  # pressures are the input
            what = what.replace("torque", "pressure")
        note = f" ({self.note})" if self.note else ""
        when = f"t = {self.start:.2f} to {self.end:.2f} s"
        amount = f"{self.excess:{'.0f' if self.excess >= 100 else '.3g'}} {self.unit}"
        return f"{self.kind}: {when}: {what} by up to {amount}, at ({place}) m{note}"


@dataclass(frozen=True, eq=False)
class Preflight:
    """What is known of a path before the run."""

    rest: RestPath | None  # of a plan there is none
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
        if self.rest is None:
            return np.zeros(0)
        return self.rest.jump_times(_times(self.rest.reference))


def find_preflight(
    inverse: InverseStatics,
    reference: Reference,
    ocp: Ocp,
    nodes: int = NODES,
    progress: Progress | None = None,
) -> Preflight:
    """Check a reference against the arm, and against limits, costs and model of a problem.

    `progress` is that of `find_rest_path`.
    """
    limits, step = ocp.limits, ocp.step
    rest = find_rest_path(inverse, reference, nodes, progress)
    response = Response(inverse.model, rest.middle.q, rest.middle.pressures)
    response.warn_of_short_sight(float(ocp.nodes[-1]))
    findings = [*_reach(rest), *_boxed(rest, limits)]
    findings += [*_torque(rest, limits), *_rate(rest, limits, step)]
    fast = AtSpeed(rest, response, ocp)
    if any(isinstance(cost, TipPosition) for cost in ocp.costs):
        findings += _at_speed(fast, rest, ocp)
    if ocp.model is not inverse.model:
        findings += _out_of_model(InverseStatics(ocp.model, starts=inverse.starts), rest)
    return Preflight(rest, tuple(findings), _facts(rest, response, fast))


def check_reach(
    inverse: InverseStatics, reference: Reference, project: bool = False
) -> Finding | None:
    """The place of a path that is far away, where all of it is; without looking at each place.

    Raises `InputError` where some place is beyond all that the arm could ever reach; to `project`
    it may be a little beyond. Such places say that the path is in another unit.
    """
    places = reference.path.position(lap_of(reference).phase)
    farthest = places[int(np.argmax(np.linalg.norm(places, axis=1)))]
    why = too_far(inverse.model.scene, farthest.tolist(), times=FAR if project else 1.0)
    if why:
        raise InputError(f"the path is out of reach: {why}")
    if project:
        return None
    some = reference.path.position(lap_of(reference, LOOKED_AT).phase)
    near = AWAY * inverse.model.scene.manipulator.length
    first = along(inverse, some[:1])
    if first[0].distance < near:
        return None
    far = np.array([one.distance for one in first + along(inverse, some[1:], first[0])])
    worst, note = int(np.argmax(far)), f"no place of the {len(far)} looked at is in reach"
    place, excess = tuple(some[worst].tolist()), 1e3 * float(far[worst])
    found = Finding("reach", 0.0, reference.duration, place, excess, "mm", note)
    return found if far.min() >= near else None


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

    return stretches("reach", rest.reference, t, 1e3 * far, 1e3 * IN_REACH, "mm", held_back)


def _boxed(rest: RestPath, limits: Sequence[Limit]) -> list[Finding]:
    """Where the path leaves the box of the arm's tip; a box of another section's is not looked at.

    A soft one is left at a price, and the tip keeps near its side.
    """
    reference, t = rest.reference, _times(rest.reference)
    places, last = reference.position(t), len(rest.model.scene.manipulator.sections)
    found = []
    for limit in limits:
        if isinstance(limit, TipBox) and limit.section in (None, last):
            over = beyond(places[:, ["xyz".index(limit.axis)]], limit.low, limit.high)
            note = f"{limit.axis} from {limit.low:g} to {limit.high:g} m"
            found += stretches("tip box", reference, t, 1e3 * over, 1e3 * IN_REACH, "mm", note)
    return found


def _torque(rest: RestPath, limits: Sequence[Limit]) -> list[Finding]:
    t, unit = _times(rest.reference), input_unit(rest.model)
    u, over = rest.inputs(t), np.zeros(len(t))
    for limit in limits:
        if isinstance(limit, TorqueLimit):
            over = np.maximum(over, np.maximum(u - limit.high, limit.low - u).max(axis=1))
    scale = float(rest.model.layout.u.scale.max())
    return stretches("torque", rest.reference, t, over, SLACK * scale, unit)


def _rate(rest: RestPath, limits: Sequence[Limit], step: float) -> list[Finding]:
    """Away from jumps, where the inputs at rest have no rate."""
    t, unit = _times(rest.reference), input_unit(rest.model)
    rate, over = _rates(rest, t), np.zeros(len(t))
    for limit in limits:
        if isinstance(limit, TorqueRateLimit):
            over = np.maximum(over, (rate - limit.high / step).max(axis=1))
            over = np.maximum(over, (limit.low / step - rate).max(axis=1))
    scale = float(rest.model.layout.u.scale.max())
    return stretches("torque rate", rest.reference, t, over, SLACK * scale / step, f"{unit}/s")


def _rates(rest: RestPath, t: Array) -> Array:
    """Rates of the inputs at rest (N×k)."""
    h = SAMPLE
    rate = (rest.inputs(t + h) - rest.inputs(t - h)) / (2 * h)
    jumps = rest.in_transit(t) | rest.in_transit(t + h) | rest.in_transit(t - h)
    return np.where(jumps[:, None], 0.0, rate)


def input_unit(model: Model) -> str:
    """The unit of a model's inputs."""
    return "N·m" if model.scene.actuation.input == "torque" else "Pa"


def _out_of_model(inverse: InverseStatics, rest: RestPath) -> list[Finding]:
    """Where another model of the arm does not get to the places in reach."""
    some = np.unique(np.linspace(0, len(rest.found) - 1, OTHER_NODES).round().astype(int))
    far = np.array([one.distance for one in along(inverse, rest.tips[some])])
    t = _times(rest.reference)
    phase = rest.lap.within(rest.reference.law.phase(t))
    excess = 1e3 * np.interp(phase, rest.lap.phase[some], far)
    return stretches("controller", rest.reference, t, excess, 1e3 * OTHER_REACH, "mm")


def stretches(
    kind: str,
    reference: Reference,
    t: Array,
    excess: Array,
    allowed: float,
    unit: str,
    note: str | Callable[[int], str] = "",
) -> list[Finding]:
    """One finding for each stretch of time in which the excess (N) is above what is allowed.

    `note` is about each, or makes one of the row where it is worst.
    """
    over = np.concatenate([[0], (excess > allowed).astype(int), [0]])
    starts, ends = np.flatnonzero(np.diff(over) == 1), np.flatnonzero(np.diff(over) == -1)
    findings = []
    for a, b in zip(starts, ends, strict=True):
        worst = a + int(np.argmax(excess[a:b]))
        place = reference.position(t[worst : worst + 1])[0]
        said = note(int(worst)) if callable(note) else note
        findings.append(
            Finding(kind, t[a], t[b - 1], tuple(place.tolist()), float(excess[worst]), unit, said)
        )
    return findings


# --- at speed ----------------------------------------------------------------------------------


def _at_speed(fast: AtSpeed, rest: RestPath, ocp: Ocp) -> list[Finding]:
    """Where it is too fast for the controller's costs, and beyond which limits."""
    unit, scale = input_unit(rest.model), float(rest.model.layout.u.scale.max())
    over, faster = np.zeros(len(fast.phase)), np.zeros(len(fast.phase))
    for limit in ocp.limits:
        if isinstance(limit, TorqueLimit):
            over = np.maximum(over, beyond(fast.u, limit.low, limit.high))
        elif isinstance(limit, TorqueRateLimit):
            bounds = limit.low / ocp.step, limit.high / ocp.step
            faster = np.maximum(faster, beyond(fast.rate, *bounds))
    allowed = min(cost.deviation for cost in ocp.costs if isinstance(cost, TipPosition))
    law, t = rest.reference.law, _times(rest.reference)
    over_all = rest.reference, t

    def over_time(excess: Array) -> Array:
        at, ring = np.append(fast.phase, 1.0), np.append(excess, excess[0])
        return np.where(t < law.smooth_start, 0.0, np.interp(law.phase(t) % 1.0, at, ring))

    return [
        *stretches("bandwidth", *over_all, over_time(1e3 * fast.off), 1e3 * allowed, "mm"),
        *stretches("torque at speed", *over_all, over_time(over), SHARED * scale, unit),
        *stretches(
            "torque rate at speed", *over_all, over_time(faster), SHARED * scale, f"{unit}/s"
        ),
    ]


def beyond(values: Array, low: float, high: float) -> Array:
    """How far the worst of each row (N×k) is outside (N)."""
    return np.asarray(np.maximum(np.maximum(values - high, low - values).max(axis=1), 0.0))


def _facts(rest: RestPath, response: Response, fast: AtSpeed) -> dict[str, float]:
    """Numbers of arm and path: SI, frequencies in Hz."""
    t, lap = _times(rest.reference), rest.reference.law.lap_time
    facts = {
        "largest_input_at_rest": float(rest.u.max()),
        "largest_input_rate_at_rest": float(np.abs(_rates(rest, t)).max()),
        "largest_input_rate_at_speed": float(np.abs(fast.rate).max()),
        "path_frequency_hz": fast.share / lap,
        "lead": fast.gain,
    }
    for name, poles in (("arm", response.arm_poles), ("drive", response.drive_poles)):
        if len(poles):
            facts[f"slowest_{name}_pole_hz"] = float(np.abs(poles[0]) / (2 * np.pi))
    return facts
