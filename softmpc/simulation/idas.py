"""The arm integrated by IDAS (variable-order BDF of SUNDIALS) on its residual.

Only the arm is integrated: the linear drive is solved in closed form (`drive_motion`) and enters as
pressures P(t). With scaled variables, and time as a fraction of the interval, IDAS sees

    dq/ds = T dq,  d(dq)/ds = T a,  0 = r(q, dq, a, P(T s))        with inertia (order 2)
    dq/ds = T v,                    0 = r(q, v, 0, P(T s))         damped, without inertia (order 1)

where a and v are algebraic; no mass matrix is inverted on the way. T is a parameter, so one
integrator serves every length of interval.
"""

from __future__ import annotations

import re
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from softmpc.errors import BuildError, InputError
from softmpc.model.model import Model
from softmpc.simulation.drive_motion import DriveMotion
from softmpc.simulation.integrator import IntegrationError, Interval

__all__ = ["Idas"]

MOST_STEPS = 100_000  # between two samples


class Idas:
    """IDAS for a model with inertia or, without it, with damping.

    `tolerance` is relative and absolute, of the strains and rates in units of `model.layout`.
    Raises `BuildError` where strains have neither mass nor damping.
    """

    def __init__(self, model: Model, tolerance: float = 1e-8) -> None:
        if not 1e-13 <= tolerance <= 1e-2:
            raise InputError(f"tolerance = {tolerance!r}: must be between 1e-13 and 0.01")
        if model.order == 2:
            model.require_mass("a simulation")
        else:
            _require_damping(model)
        self.model, self.tolerance = model, float(tolerance)
        self.drive = DriveMotion(model.drive, model.layout.z.scale)
        self._integrator = lru_cache(maxsize=8)(self._make)  # by the number of samples

    def advance(
        self, x: Any, u: Any, duration: float, samples: int = 1, u_end: Any = None
    ) -> np.ndarray:
        """States (samples×nx) after x = (q, dq, z); see `Integrator.advance`.

        Without inertia the dq given is not used.
        """
        given = Interval(self.model, x, u, duration, samples, u_end)
        law = self.drive.law(given.z, given.u0, given.u_slope)
        x0, a0 = self._start(given)
        p = np.concatenate([[duration], self.drive.pressure_coefficients(law)])
        try:
            solved = self._integrator(samples)(x0=x0, z0=a0, p=p)
        except RuntimeError as error:
            raise IntegrationError(_reason(error)) from None
        arm = self._arm_states(np.asarray(solved["xf"]).T, np.asarray(solved["zf"]).T)
        if not np.all(np.isfinite(arm)):
            raise IntegrationError("IDAS: the motion is no longer finite")
        return np.hstack([arm, self.drive.states(law, given.times)])

    # --- scaled variables ----------------------------------------------------------------------

    @cached_property
    def _scales(self) -> tuple[np.ndarray, np.ndarray]:
        """Scales of the differential and of the algebraic variables."""
        layout = self.model.layout
        if self.model.order == 2:
            return np.concatenate([layout.q.scale, layout.dq.scale]), layout.ddq.scale
        return layout.q.scale, layout.dq.scale

    def _start(self, given: Interval) -> tuple[np.ndarray, np.ndarray]:
        """Scaled variables at the start; the algebraic ones solve the residual exactly."""
        p = self.drive.pressures(given.z, given.u0)
        x_scale, a_scale = self._scales
        if self.model.order == 2:
            a = self.model.forward_dynamics(given.q, given.dq, p)
            x = np.concatenate([given.q, given.dq])
        else:
            a, x = _rates_without_inertia(self.model, given.q, p), given.q
        return x / x_scale, np.asarray(a).ravel() / a_scale

    def _arm_states(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """(q, dq) (samples×2n) of scaled variables."""
        x_scale, a_scale = self._scales
        if self.model.order == 2:
            return x * x_scale
        return np.hstack([x * x_scale, a * a_scale])

    # --- the integrator ------------------------------------------------------------------------

    @cached_property
    def _dae(self) -> dict[str, Any]:
        model, n = self.model, self.model.strains
        x_scale, a_scale = self._scales
        s, x, a = ca.MX.sym("s"), ca.MX.sym("x", len(x_scale)), ca.MX.sym("a", n)
        p = ca.MX.sym("p", 1 + self.drive.coefficients)
        duration, states, highest = p[0], x * x_scale, a * a_scale
        rates = ca.vertcat(states[n:], highest)  # of (q, dq), or of q alone
        pressure = self.drive.pressure(p[1:], duration * s)
        motion = [*ca.vertsplit(states, n), highest] if model.order == 2 else [states, highest, 0]
        balance = _residual_with_jacobian(model)(*motion, pressure) / model.layout.r.scale
        return {"t": s, "x": x, "z": a, "p": p, "ode": duration * rates / x_scale, "alg": balance}

    def _make(self, samples: int) -> ca.Function:
        options = {
            "abstol": self.tolerance,
            "reltol": self.tolerance,
            "suppress_algebraic": True,  # accelerations follow from the states: no error test
            "max_num_steps": MOST_STEPS,
            "disable_internal_warnings": True,  # the reason is in the exception
        }
        grid = np.arange(1, samples + 1) / samples
        return ca.integrator("arm", "idas", self._dae, 0.0, grid, options)


def _residual_with_jacobian(model: Model) -> ca.Function:
    """The residual with the model's own O(n) Jacobian in place of plain differentiation."""
    names = model.residual.name_in()
    symbols: list[Any] = [ca.MX.sym(name, *model.residual.size_in(name)) for name in names]
    jacobian = ca.Function(
        "jac_residual",
        [*symbols, ca.MX(model.strains, 1)],
        list(model.residual_jacobian(*symbols)),
        [*names, "out_r"],
        [f"jac_r_{name}" for name in names],
    )
    options: dict[str, Any] = {
        "custom_jacobian": jacobian,
        "jac_penalty": 0.0,
        "never_inline": True,
        "enable_forward": False,
        "enable_reverse": False,
    }
    return ca.Function("residual", symbols, [model.residual(*symbols)], names, ["r"], options)


def _damping(model: Model, q: np.ndarray) -> np.ndarray:
    """∂r/∂dq (n×n) at rest."""
    return np.asarray(model.residual_jacobian(q, 0, 0, 0)[1])


def _rates_without_inertia(model: Model, q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Rates dq (n) that solve r(q, dq, 0, p) = 0, linear in dq."""
    rest = np.asarray(model.residual(q, 0, 0, p)).ravel()
    return -np.linalg.solve(_damping(model, q), rest)


def _require_damping(model: Model) -> None:
    if model.order == 0:
        raise BuildError(
            "IDAS needs inertia or damping, this scene has neither: add an effect, or take "
            "softmpc.simulation.following.Following"
        )
    scale = model.layout.dq.scale
    D = _damping(model, np.zeros(model.strains)) * np.outer(scale, scale)
    if np.linalg.matrix_rank(D) < len(D):
        raise BuildError(
            "without inertia IDAS needs damping in every strain: add the effect "
            "'material_damping', or leave all damping out so that the arm follows at once"
        )


def _reason(error: RuntimeError) -> str:
    """IDAS's own word for a failure, out of CasADi's long message."""
    code = re.search(r"IDA_[A-Z_]+", str(error))
    word = code.group().removeprefix("IDA_").replace("_", " ").lower() if code else "failed"
    return f"IDAS: {word}"
