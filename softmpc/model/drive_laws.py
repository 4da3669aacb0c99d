"""One actuator where (36) is not enough: nonlinear laws, and the arm that acts back.

    m dẋ/dt   = e (T − J dẋ/dt /s)/s − d_v ẋ − A_c P_c − f tanh(ẋ/v_f) + stop(x)
    c_a dP_a/dt = Q − dV/dt
    c_c dP_c/dt = A_c ẋ − Q
    I dQ/dt   = P_c − P_a − loss(Q)

with e the screw's efficiency, c the compliances, V the arm's own volume (two-way coupling). What a
scene does not have is None and leaves no instruction. All arguments are CasADi expressions.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any

import casadi as ca

from softmpc.model.drive_effects import (
    BackDriving,
    Cavitation,
    ChamberCoupling,
    EndStops,
    RotorInertia,
    TubeInertance,
    TurbulentLoss,
    find,
)
from softmpc.model.hydraulics import (
    cylinder_compliance,
    screw_advance,
    tube_conductance,
    tube_inertance,
    unit_compliance,
    water_compliance,
)

if TYPE_CHECKING:
    from softmpc.model.effect import Effect
    from softmpc.model.parameters import Hydraulics, Manipulator, Section

__all__ = ["UnitLaw", "reynolds_per_flow", "transition_reynolds"]


def reynolds_per_flow(hydraulics: Hydraulics) -> float:
    """Reynolds number in the tube over flow, 4 ρ/(π d μ), s/m³."""
    d = hydraulics.tube_diameter
    return 4 * hydraulics.water_density / (pi * d * hydraulics.water_viscosity)


def transition_reynolds(loss: TurbulentLoss) -> float:
    """Where 64/Re meets coefficient·Re^(−1/4): 1187 for Blasius's 0.3164."""
    return float((64 / loss.coefficient) ** (4 / 3))


def sigmoid(x: Any) -> Any:
    """1/(1 + exp(−x)), without overflow."""
    return 0.5 * (1 + ca.tanh(0.5 * x))


def softplus(x: Any) -> Any:
    """log(1 + exp(x)), without overflow: the integral of `sigmoid`."""
    return ca.fmax(x, 0) + ca.log1p(ca.exp(-ca.fabs(x)))


class UnitLaw:
    """The laws of one actuator of a section; `friction` where the piston has Coulomb friction."""

    def __init__(
        self, arm: Manipulator, section: Section, effects: tuple[Effect, ...], friction: bool
    ) -> None:
        self.section, self.hydraulics, self.friction = section, arm.hydraulics, friction
        self.stroke = arm.limits.stroke_max
        self.inertance = find(effects, TubeInertance)
        self.turbulence = find(effects, TurbulentLoss)
        self.rotor = find(effects, RotorInertia)
        self.cavitation = find(effects, Cavitation)
        self.stops = find(effects, EndStops)
        self.back = find(effects, BackDriving)
        self.coupled = find(effects, ChamberCoupling) is not None

    def rate(self, z: list[Any], torque: Any, swelling: Any, swollen: Any) -> list[Any]:
        """dz/dt of z = (ẋ, P_a, P_c) or (ẋ, P_a, P_c, Q).

        `swollen` is how much larger than at the straight arm the arm makes the unit's volume (m³),
        and `swelling` its rate (m³/s); neither is read without coupling.
        """
        h, (speed, p_a, p_c) = self.hydraulics, z[:3]
        flow = z[3] if self.inertance else self.flow(p_c - p_a)
        enters = flow - swelling if self.coupled else flow
        place = self.place(p_a, p_c, swollen) if self.stops else None
        rates = [
            self.acceleration(speed, p_c, torque, place),
            enters / self._give(p_a, self._unit_compliance, h.chamber_volume),
            (h.piston_area * speed - flow)
            / self._give(p_c, cylinder_compliance(h), h.cylinder_volume),
        ]
        if self.inertance:
            rates.append((p_c - p_a - self.loss(flow)) / tube_inertance(h))
        return rates

    # --- the tube ------------------------------------------------------------------------------

    @property
    def _turning_flow(self) -> float:
        """Flow at the Reynolds number where the laminar and the turbulent law meet, m³/s."""
        assert self.turbulence is not None
        return transition_reynolds(self.turbulence) / reynolds_per_flow(self.hydraulics)

    def loss(self, flow: Any) -> Any:
        """Pressure lost along the tube at a flow, Pa."""
        laminar = flow / tube_conductance(self.hydraulics)
        if self.turbulence is None:
            return laminar
        return laminar * (1 + (flow / self._turning_flow) ** 4) ** (3 / 16)

    def flow(self, pressure: Any) -> Any:
        """Flow at which the whole pressure difference is lost along the tube, m³/s.

        With turbulence: P^(4/7) for large P, joined to the laminar law for small, and one Newton
        step on `loss`, which leaves an error below 3e-4 of the flow everywhere.
        """
        laminar = tube_conductance(self.hydraulics) * pressure
        if self.turbulence is None:
            return laminar
        wanted = laminar / self._turning_flow
        near = wanted * (1 + wanted**4) ** (-3 / 28)
        inner = 1 + near**4
        slope = inner ** (3 / 16) * (1 + 0.75 * near**4 / inner)
        return self._turning_flow * (near - (near * inner ** (3 / 16) - wanted) / slope)

    # --- the chambers --------------------------------------------------------------------------

    @property
    def _unit_compliance(self) -> float:
        if self.coupled:
            return water_compliance(self.hydraulics)
        return unit_compliance(self.section, self.hydraulics)

    def _give(self, pressure: Any, compliance: float, volume: float) -> Any:
        """Compliance of a chamber (m³/Pa): its own, and that of the cavity in it."""
        if self.cavitation is None:
            return compliance
        band = self.cavitation.band
        open_ = sigmoid((self.cavitation.vapour_pressure - pressure) / band)
        return compliance + volume / band * open_

    def _stored(self, pressure: Any, compliance: float, volume: float) -> Any:
        """Volume a chamber has taken up since zero pressure, m³: the integral of `_give`."""
        if self.cavitation is None:
            return compliance * pressure
        below = (self.cavitation.vapour_pressure - pressure) / self.cavitation.band
        return compliance * pressure - volume * softplus(below)

    def place(self, p_a: Any, p_c: Any, swollen: Any) -> Any:
        """Place of the piston (m): what it has pushed out is somewhere."""
        h = self.hydraulics
        volume = self._stored(p_a, self._unit_compliance, h.chamber_volume)
        volume += self._stored(p_c, cylinder_compliance(h), h.cylinder_volume)
        return (volume + swollen if self.coupled else volume) / h.piston_area

    # --- the piston ----------------------------------------------------------------------------

    def acceleration(self, speed: Any, p_c: Any, torque: Any, place: Any) -> Any:
        """Acceleration of the piston, m/s²; `place` (m) is read where there are end stops."""
        h, advance = self.hydraulics, screw_advance(self.hydraulics)
        resists = h.piston_damping * speed + h.piston_area * p_c
        if self.friction:
            resists += h.friction * ca.tanh(speed / h.friction_velocity)
        if self.stops:
            resists -= self.stop_force(place)
        efficiency = self._efficiency(speed, torque, resists)
        mass = h.piston_mass + self._rotor_mass * efficiency
        return (efficiency / advance * torque - resists) / mass

    @property
    def _rotor_mass(self) -> float:
        """J/s², kg."""
        return self.rotor.inertia / screw_advance(self.hydraulics) ** 2 if self.rotor else 0.0

    def _efficiency(self, speed: Any, torque: Any, resists: Any) -> Any:
        """Force of the screw times its advance a radian, over the torque in it.

        That torque is T − J dω/dt; solved for dẋ/dt its sign is that of m T + J/s·(all that
        resists), whatever the efficiency.
        """
        h, forward = self.hydraulics, self.hydraulics.efficiency
        if self.back is None:
            return forward
        inside = torque
        if self.rotor:
            added = self._rotor_mass
            inside = h.piston_mass * torque + added * screw_advance(h) * resists
            inside = inside / (h.piston_mass + forward * added)
        backward = -speed * ca.tanh(inside / self.back.torque) / self.back.velocity
        y = ca.fmin(ca.fmax(backward, 0), 1)
        share = y**3 * (10 + y * (6 * y - 15))  # from 0 to 1, slope and curvature 0 at both ends
        return forward + (1 / self.back.efficiency - forward) * share

    def stop_force(self, place: Any) -> Any:
        """Force of the end stops on the piston, N: none between them, stiffness beyond."""
        assert self.stops is not None
        start = self.stops.start
        low, high = ca.fmax(-start - place, 0), ca.fmax(place - (self.stroke - start), 0)
        return self.stops.stiffness * (self._rounded(low) - self._rounded(high))

    def rest_pressure(self, unstopped: float, swollen: float) -> float:
        """Pressure at rest with end stops (Pa), where `unstopped` is the pressure without."""
        from scipy.optimize import brentq  # slow to import, and rarely needed

        pressure = ca.SX.sym("P")
        pushed = self.stop_force(self.place(pressure, pressure, swollen))
        missing = unstopped + pushed / self.hydraulics.piston_area - pressure
        law = ca.Function("missing", [pressure], [missing])
        first = float(law(unstopped))  # of the sign of the stop's force, and falling with pressure
        if first == 0.0:
            return unstopped
        return float(brentq(lambda p: float(law(p)), unstopped, unstopped + first, xtol=1e-6))

    def _rounded(self, depth: Any) -> Any:
        assert self.stops is not None
        return depth**3 / (depth**2 + self.stops.rounding**2)
