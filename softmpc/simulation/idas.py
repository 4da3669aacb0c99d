"""The arm integrated by IDAS (variable-order BDF of SUNDIALS) on its residual.

A linear drive is solved in closed form (`drive_motion`) and enters as pressures P(t); any other
(`System.joint`) is integrated with the arm. With scaled variables, and time as a fraction of the
interval, IDAS sees

    dq/ds = T dq,  d(dq)/ds = T a,  0 = r(q, dq, a, P(T s))        with inertia (order 2)
    dq/ds = T v,                    0 = r(q, v, 0, P(T s))         damped, without inertia (order 1)

and dz/ds = T f(z, u, q, dq) for a drive that is integrated. a and v are algebraic; no mass matrix
is inverted on the way. T is a parameter, so one integrator serves every length of interval.
"""

from __future__ import annotations

import re
import threading
from contextlib import AbstractContextManager, nullcontext, redirect_stderr
from functools import cached_property, lru_cache
from io import StringIO
from typing import Any

import casadi as ca
import numpy as np

from softmpc.model.model import Model
from softmpc.simulation.integrator import IntegrationError, Interval, relative_tolerance
from softmpc.simulation.system import System

__all__ = ["Idas"]

MOST_STEPS = 100_000  # between two samples
# Of the interval: to where IDAS looks ahead as it makes the start consistent. As far as the end of
# the interval its line search does not always get there, near as the start is, and from no other
# place always either: where it does not, the next one is tried.
FIRST_TIMES = (0.01, 1e-4, 1.0)


class Idas:
    """IDAS for a model with inertia or, without it, with damping.

    `tolerance` is relative and absolute, of the strains and rates in units of `model.layout`.
    Raises `BuildError` where strains have neither mass nor damping.
    """

    def __init__(self, model: Model, tolerance: float = 1e-8) -> None:
        self.model, self.tolerance = model, relative_tolerance(tolerance)
        self.system = System(model)
        self._integrator = lru_cache(maxsize=8)(self._make)  # by its arguments

    def advance(
        self, x: Any, u: Any, duration: float, samples: int = 1, u_end: Any = None
    ) -> np.ndarray:
        """States (samples×nx) after x = (q, dq, z); see `Integrator.advance`.

        Without inertia the dq given is not used.
        """
        given = Interval(self.model, x, u, duration, samples, u_end)
        system, drive = self.system, self.system.drive
        w, coefficients = system.input_law(given)
        y = system.start(given.q, given.dq, given.z, w)
        arm = [given.q, given.dq] if system.order == 2 else [given.q]
        x0 = np.concatenate([*arm, given.z[: system.k]]) / self._scales[0]
        p = np.concatenate([[duration], coefficients])
        solved = self._solve(samples, x0=x0, z0=y[: system.n] / self._scales[1], p=p)
        states = self._states(np.asarray(solved["xf"]).T, np.asarray(solved["zf"]).T)
        if drive is not None:
            states = np.hstack([states, drive.states(system.law(given), given.times)])
        if not np.all(np.isfinite(states)):
            raise IntegrationError("IDAS: the motion is no longer finite")
        return states

    def _solve(self, samples: int, **given: np.ndarray) -> dict[str, Any]:
        """The outputs of the integrator; what SUNDIALS prints is in the exception."""
        reason = ""
        for first_time in FIRST_TIMES:
            try:
                with _quiet():
                    return self._integrator(samples, first_time)(**given)
            except RuntimeError as error:
                reason = _reason(error)
                if "linesearch" not in reason:
                    break
        raise IntegrationError(reason)

    def prepare(self) -> None:
        """Make the functions now, not with the first step."""
        _ = self._dae

    # --- scaled variables ----------------------------------------------------------------------

    @cached_property
    def _scales(self) -> tuple[np.ndarray, np.ndarray]:
        """Scales of the differential and of the algebraic variables."""
        layout, drive = self.model.layout, self.model.layout.z.scale[: self.system.k]
        if self.system.order == 2:
            return np.concatenate([layout.q.scale, layout.dq.scale, drive]), layout.ddq.scale
        return np.concatenate([layout.q.scale, drive]), layout.dq.scale

    def _states(self, x: np.ndarray, a: np.ndarray) -> np.ndarray:
        """(q, dq), and z where it is integrated (samples×…), of scaled variables."""
        x_scale, a_scale = self._scales
        if self.system.order == 2:
            return x * x_scale
        q, z = np.split(x * x_scale, [self.system.n], axis=1)
        return np.hstack([q, a * a_scale, z])

    # --- the integrator ------------------------------------------------------------------------

    @cached_property
    def _dae(self) -> dict[str, Any]:
        model, system, n = self.model, self.system, self.system.n
        x_scale, a_scale = self._scales
        s, x, a = ca.MX.sym("s"), ca.MX.sym("x", len(x_scale)), ca.MX.sym("a", n)
        p = ca.MX.sym("p", 1 + system.coefficients)
        states, highest = x * x_scale, a * a_scale
        arm, z = states[: len(x_scale) - system.k], states[len(x_scale) - system.k :]
        rates = ca.vertcat(arm[n:], highest)  # of (q, dq), or of q alone
        w = system.input(p[1:], p[0] * s)
        pressure = model.pressures(z, w) if system.joint else w
        motion = [*ca.vertsplit(arm, n), highest] if system.order == 2 else [arm, highest, 0]
        if system.joint:
            rates = ca.vertcat(rates, model.drive_rate(z, w, *motion[:2]))
        balance = _residual_with_jacobian(model)(*motion, pressure) / model.layout.r.scale
        return {"t": s, "x": x, "z": a, "p": p, "ode": p[0] * rates / x_scale, "alg": balance}

    def _make(self, samples: int, first_time: float) -> ca.Function:
        options = {
            "abstol": self.tolerance,
            "reltol": self.tolerance,
            "first_time": first_time,
            "suppress_algebraic": True,  # accelerations follow from the states: no error test
            "max_num_steps": MOST_STEPS,
            "disable_internal_warnings": True,  # the reason is in the exception
        }
        grid = np.arange(1, samples + 1) / samples
        return ca.integrator("arm", "idas", self._dae, 0.0, grid, options)


def _quiet() -> AbstractContextManager[Any]:
    """Without messages on stderr; it is one for all threads, so only the main one turns it away."""
    main = threading.current_thread() is threading.main_thread()
    return redirect_stderr(StringIO()) if main else nullcontext()


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


def _reason(error: RuntimeError) -> str:
    """IDAS's own word for a failure, out of CasADi's long message."""
    code = re.search(r"IDA_[A-Z_]+", str(error))
    word = code.group().removeprefix("IDA_").replace("_", " ").lower() if code else "failed"
    return f"IDAS: {word}"
