"""Where a motion leaves the range in which the model's hydraulics and strains hold.

(34) takes the flow as laminar and the water in the tube as massless, pressures may fall below
vapour pressure, pistons may leave their cylinders: the equations do not notice. `motion_warnings`
looks at the samples of a motion and says what was passed, where, and which effect to add. What
happens between samples is not seen: after a step of torque the flow peaks within 3 ms.
`late_inputs` looks at what the motion does not reach.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.model.drive_effects import Cavitation, EndStops, TubeInertance, TurbulentLoss
from softmpc.model.drive_laws import reynolds_per_flow
from softmpc.model.hydraulics import tube_inertance

if TYPE_CHECKING:
    from softmpc.model.model import Model
    from softmpc.simulation.inputs import InputProfile

__all__ = ["VAPOUR", "MotionWarning", "late_inputs", "motion_warnings", "reynolds_numbers"]

LAMINAR = 2300.0  # Reynolds number up to which pipe flow is laminar
SMOOTH = 1e5  # up to which Blasius's law was measured
VAPOUR = -99e3  # Pa, gauge: below it water boils, whatever the equations say
SUCTION = -5e3  # Pa, gauge: less is not worth a word
INERT = 0.1  # of the highest pressure
SLACK = 1e-4  # m, of the piston's travel
SQUEEZED = -0.5  # ε; at -1 a segment has no length
MOST_NAMES = 5  # in one text
STRETCHED = 1.0  # ε; rubber stiffens, (17) does not


@dataclass(frozen=True)
class MotionWarning:
    """One range that was left, at its worst: `value` against `limit` at `time` (s).

    `kind` is one of "turbulence", "smooth_tube", "inertance", "vapour", "suction", "stroke",
    "strain", "unstable_start" and "late_input"; `where` names the unit or strain; `effect` is
    what to add to the scene, if anything.
    """

    kind: str
    time: float
    where: str
    value: float
    limit: float
    unit: str
    effect: str | None
    text: str


def reynolds_numbers(model: Model, z: Any) -> np.ndarray:
    """Reynolds number in each tube (K×m), at drive states z (K×h); K×0 without tubes."""
    return np.abs(_flows(model, np.atleast_2d(z))) * reynolds_per_flow(_hydraulics(model))


def motion_warnings(model: Model, time: Any, z: Any, u: Any, q: Any = None) -> list[MotionWarning]:
    """What of the model's range was left, by samples at `time` (K) of z (K×h), u (K×k), q (K×n).

    Without q, strains are not looked at, nor pistons that the arm moves. Empty when all is well.
    """
    time, z, u = (np.asarray(x, dtype=float) for x in (time, z, u))
    samples = _Samples(model, time, z, u, q)
    if len(samples.time) == 0:
        return []
    found: list[MotionWarning] = []
    for check in (_reynolds, _inertance, _pressures, _stroke, _strains):
        found += check(samples)
    return found


def late_inputs(profile: InputProfile, duration: float) -> list[MotionWarning]:
    """One warning of steps and ramps that begin when the motion, of `duration` (s), is over."""
    late = sorted(
        (float(time), unit)
        for unit, curve in enumerate(profile.curves, 1)
        for time in curve.starts
        if time >= duration
    )
    if not late:
        return []
    named = ", ".join(f"unit {unit} at t = {time:g} s" for time, unit in late[:MOST_NAMES])
    more = f" and {len(late) - MOST_NAMES} more" if len(late) > MOST_NAMES else ""
    said = (
        f"the motion ends at t = {duration:g} s, before these inputs begin: {named}{more}; take a "
        "longer duration, or leave them out"
    )
    first, unit = late[0]
    return [MotionWarning("late_input", first, f"unit {unit}", first, duration, "s", None, said)]


@dataclass(frozen=True)
class _Samples:
    model: Model
    time: np.ndarray
    z: np.ndarray
    u: np.ndarray
    q: Any

    def has(self, kind: Any) -> bool:
        return self.model.scene.effect(kind) is not None

    def worst(self, values: np.ndarray) -> tuple[float, int, float]:
        """Time, column and value of the largest entry (K×m)."""
        row, column = np.unravel_index(int(np.argmax(values)), values.shape)
        return float(self.time[row]), int(column), float(values[row, column])


def _hydraulics(model: Model) -> Any:
    return model.scene.manipulator.hydraulics


def _flows(model: Model, z: np.ndarray) -> np.ndarray:
    return np.asarray(model.tube_flows.map(len(z))(z.T)).T


def _power_of_ten(value: float) -> str:
    digits, exponent = f"{value:.1e}".split("e")
    return f"{digits}·10^{int(exponent)}"


def _reynolds(s: _Samples) -> Iterator[MotionWarning]:
    numbers = reynolds_numbers(s.model, s.z)
    if not numbers.size:
        return
    time, unit, value = s.worst(numbers)
    turbulent = s.has(TurbulentLoss)
    limit = SMOOTH if turbulent else LAMINAR
    if value <= limit:
        return
    reached = f"Re reached {_power_of_ten(value)} at t = {time:.3g} s, unit {unit + 1}"
    if turbulent:
        said = (
            f"the loss of a smooth tube is known up to Re = {_power_of_ten(limit)}, but {reached}"
        )
        yield MotionWarning("smooth_tube", time, f"unit {unit + 1}", value, limit, "", None, said)
    else:
        said = (
            f"(34) is laminar, up to Re = {limit:g}, but {reached}: add the effect turbulent_loss"
        )
        name = TurbulentLoss.name
        yield MotionWarning("turbulence", time, f"unit {unit + 1}", value, limit, "", name, said)


def _inertance(s: _Samples) -> Iterator[MotionWarning]:
    """Pressure that the flow's change from sample to sample would take, against the highest."""
    if s.has(TubeInertance) or len(s.time) < 2:
        return
    flows = _flows(s.model, s.z)
    if not flows.size:
        return
    h = _hydraulics(s.model)
    taken = tube_inertance(h) * np.abs(np.diff(flows, axis=0)) / np.diff(s.time)[:, None]
    limit = INERT * float(np.abs(s.z @ s.model.drive.C.T).max())
    time, unit, value = s.worst(taken)
    if value > limit:
        said = (
            f"(34) has no inertance, but to change the flow as at t = {time:.3g} s, unit "
            f"{unit + 1}, takes {value / 1e6:.3g} MPa: add the effect tube_inertance"
        )
        where, name = f"unit {unit + 1}", TubeInertance.name
        yield MotionWarning("inertance", time, where, value, limit, "Pa", name, said)


def _pressures(s: _Samples) -> Iterator[MotionWarning]:
    names = s.model.layout.z.names
    columns = [i for i, name in enumerate(names) if name.startswith(("P_a", "P_c"))]
    pressures = s.z[:, columns]
    if not pressures.size or s.has(Cavitation):
        return
    time, column, value = s.worst(-pressures)
    lowest, name = -value, names[columns[column]]
    fell = f"{name} fell to {lowest / 1e3:.4g} kPa at t = {time:.3g} s"
    if lowest < VAPOUR:
        said = f"{fell}, below the vapour pressure of water: add the effect cavitation"
        effect = Cavitation.name
        yield MotionWarning("vapour", time, name, lowest, VAPOUR, "Pa", effect, said)
    elif lowest < SUCTION:
        said = f"{fell}, below the atmosphere: the drive pulls, which needs tight seals"
        yield MotionWarning("suction", time, name, lowest, SUCTION, "Pa", None, said)


def _stroke(s: _Samples) -> Iterator[MotionWarning]:
    model = s.model
    acts_back = "chamber_coupling" in model.drive_nonlinear
    if s.has(EndStops) or not len(model.drive.X) or (acts_back and s.q is None):
        return
    q = np.zeros((len(s.time), model.strains)) if s.q is None else np.asarray(s.q, dtype=float)
    places = np.asarray(model.piston_places.map(len(s.time))(s.z.T, q.T)).T
    stroke = model.scene.manipulator.limits.stroke_max
    for limit, beyond in ((0.0, -places), (stroke, places - stroke)):
        time, unit, value = s.worst(beyond)
        if value > SLACK:
            place = limit + (value if limit else -value)
            said = (
                f"piston {unit + 1} went to {1e3 * place:.3g} mm at t = {time:.3g} s, its travel "
                f"is 0 to {1e3 * stroke:.4g} mm: add the effect end_stops"
            )
            where, name = f"unit {unit + 1}", EndStops.name
            yield MotionWarning("stroke", time, where, place, limit, "m", name, said)


def _strains(s: _Samples) -> Iterator[MotionWarning]:
    names = s.model.layout.q.names
    columns = [i for i, name in enumerate(names) if name.startswith("epsilon")]
    if s.q is None or not columns:
        return
    stretches = np.asarray(s.q, dtype=float)[:, columns]
    time, column, value = s.worst(stretches)
    if value > STRETCHED:
        name = names[columns[column]]
        said = (
            f"{name} rose to {value:.3g} at t = {time:.3g} s: the wall's law is for small strains, "
            "and at 1 a segment is twice as long as at rest"
        )
        yield MotionWarning("strain", time, name, value, STRETCHED, "", None, said)
    time, column, value = s.worst(-stretches)
    if -value < SQUEEZED:
        name = names[columns[column]]
        said = (
            f"{name} fell to {-value:.3g} at t = {time:.3g} s: the wall's law is for small "
            "strains, and at -1 a segment has no length"
        )
        yield MotionWarning("strain", time, name, -value, SQUEEZED, "", None, said)
