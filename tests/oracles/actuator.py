"""One actuator with all its effects, written anew in plain Python, with other states.

The piston's place is a state here, and so are the volumes stored in unit and cylinder: the
pressures are found from them, and the flow at which a pressure is lost along the tube, by root
finding. SciPy integrates it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log1p, pi, tanh

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Actuator:
    """The paper's actuator; None or zero where an effect is absent."""

    mass: float = 1.2
    damping: float = 200.0
    area: float = 0.0021
    advance: float = 0.004 / (2 * pi)
    efficiency: float = 0.535
    wall: float = (3.14e-4) ** 2 * 0.25 / (1.2e6 * 3.93e-4)  # m³/Pa
    volumes: tuple[float, float] = (7.85e-5, 7.35e-4)  # unit, cylinder
    bulk: float = 2.18e9
    bore: float = 0.004
    tube: float = 1.61
    viscosity: float = 1.01e-3
    density: float = 1000.0
    friction: float = 0.0
    friction_velocity: float = 1e-3
    inertance: bool = False
    blasius: float | None = None
    rotor: float = 0.0
    cavity: tuple[float, float] | None = None  # vapour pressure, band
    stops: tuple[float, float, float, float] | None = None  # stiffness, rounding, start, stroke
    back: tuple[float, float, float] | None = None  # efficiency, velocity, torque

    # --- volumes and pressures -----------------------------------------------------------------

    def stored(self, chamber: int, pressure: float) -> float:
        """Volume that went into the unit (0) or the cylinder (1) up to a pressure."""
        volume = self.volumes[chamber]
        elastic = volume / self.bulk + (self.wall if chamber == 0 else 0.0)
        if self.cavity is None:
            return elastic * pressure
        vapour, band = self.cavity
        below = (vapour - pressure) / band
        opened = below + log1p(exp(-below)) if below > 0 else log1p(exp(below))
        return elastic * pressure - volume * opened

    def pressure(self, chamber: int, stored: float) -> float:
        def missing(pressure: float) -> float:
            return self.stored(chamber, pressure) - stored

        return float(brentq(missing, -1e9, 1e9, xtol=1e-9, rtol=1e-15, maxiter=500))

    # --- the tube ------------------------------------------------------------------------------

    def loss(self, flow: float) -> float:
        """Darcy's law; its factor is joined from 64/Re and Blasius's law, which meet at Re_t."""
        bore = pi * self.bore**2 / 4
        speed = flow / bore
        laminar = 32 * self.viscosity * self.tube * speed / self.bore**2
        if self.blasius is None or flow == 0.0:
            return laminar
        reynolds = self.density * abs(speed) * self.bore / self.viscosity
        meet = (64 / self.blasius) ** (4 / 3)
        factor = 64 / reynolds * (1 + (reynolds / meet) ** 4) ** (3 / 16)
        return factor * self.tube / self.bore * self.density / 2 * speed * abs(speed)

    def flow(self, pressure: float) -> float:
        most = abs(pressure) * pi * self.bore**4 / (128 * self.viscosity * self.tube) + 1e-12
        return float(brentq(lambda q: self.loss(q) - pressure, -most, most, xtol=1e-18, rtol=1e-14))

    # --- the piston ----------------------------------------------------------------------------

    def stop(self, x: float) -> float:
        if self.stops is None:
            return 0.0
        stiffness, rounding, start, stroke = self.stops
        for depth, sign in ((-start - x, 1.0), (x - stroke + start, -1.0)):
            if depth > 0:
                return sign * stiffness * depth * depth**2 / (depth**2 + rounding**2)
        return 0.0

    def acceleration(self, x: float, v: float, p_c: float, torque: float) -> float:
        """Motor and screw as two bodies: torque in the screw T_s = T − J dω/dt, ω = v/s."""
        resists = self.damping * v + self.area * p_c - self.stop(x)
        resists += self.friction * tanh(v / self.friction_velocity)

        def of(efficiency: float) -> tuple[float, float]:
            # m a = e T_s/s − resists,  T_s = T − J a/s
            system = [[self.mass, -efficiency / self.advance], [self.rotor / self.advance, 1.0]]
            a, screw = np.linalg.solve(system, [-resists, torque])
            return float(a), float(screw)

        a, screw = of(self.efficiency)
        if self.back is None:
            return a
        backward, velocity, small = self.back
        y = min(max(-v * tanh(screw / small) / velocity, 0.0), 1.0)
        share = 6 * y**5 - 15 * y**4 + 10 * y**3
        return of((1 - share) * self.efficiency + share / backward)[0]

    # --- motion --------------------------------------------------------------------------------

    def rate(self, y: Array, torque: float) -> list[float]:
        """Of (x, v, volume in the unit, volume in the cylinder, flow)."""
        x, v, in_unit, in_cylinder, flow = y
        p_a, p_c = self.pressure(0, in_unit), self.pressure(1, in_cylinder)
        if not self.inertance:
            flow = self.flow(p_c - p_a)
        inertance = self.density * self.tube / (pi * self.bore**2 / 4)
        pushed = (p_c - p_a - self.loss(flow)) / inertance if self.inertance else 0.0
        into = self.area * v - flow
        return [v, self.acceleration(x, v, p_c, torque), flow, into, pushed]

    def state(self, v: float, p_a: float, p_c: float, flow: float = 0.0) -> Array:
        """The oracle's state of a state (ẋ, P_a, P_c, Q)."""
        stored = self.stored(0, p_a), self.stored(1, p_c)
        return np.array([sum(stored) / self.area, v, *stored, flow])

    def rates(self, v: float, p_a: float, p_c: float, flow: float, torque: float) -> list[float]:
        """Rates of (ẋ, P_a, P_c, Q) at such a state; pressures by differences of the volumes."""
        y = self.state(v, p_a, p_c, flow)
        _, dv, into_unit, into_cylinder, dq = self.rate(y, torque)
        give = []
        for chamber, pressure in enumerate((p_a, p_c)):
            h = 1.0 if self.cavity else 1e3
            shifts = [self.stored(chamber, pressure + k * h) for k in (-2, -1, 1, 2)]
            give.append(float(np.dot([1, -8, 8, -1], shifts)) / (12 * h))
        return [dv, into_unit / give[0], into_cylinder / give[1], dq]

    def run(self, torque: float, times: Array, start: Array | None = None) -> Array:
        """(ẋ, P_a, P_c, Q, x) over time after a step of torque."""
        y = np.zeros(5) if start is None else start
        scale = np.array([1e-3, 1e-2, 1e-6, 1e-9, 1e-4])
        if self.cavity:
            scale[3] = 1e-7
        done = solve_ivp(
            lambda t, y: self.rate(y, torque),
            (0, times[-1]),
            y,
            "Radau",
            times,
            rtol=1e-7,
            atol=1e-7 * scale,
        )
        assert done.success, done.message
        x, v, in_unit, in_cylinder, flow = done.y
        p_a = [self.pressure(0, s) for s in in_unit]
        p_c = [self.pressure(1, s) for s in in_cylinder]
        return np.array([v, p_a, p_c, flow, x])
