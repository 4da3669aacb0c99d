"""The arm and its drive as an explicit ODE under CVODES (variable-order BDF of SUNDIALS).

For reference: it shares only the model's functions with the other integrators. It solves M ddq = …
at every evaluation and sees the drive's fast states, so it is slower than the residual forms.
"""

from __future__ import annotations

import re
from functools import cached_property, lru_cache
from typing import Any

import casadi as ca
import numpy as np

from softmpc.errors import BuildError
from softmpc.model.model import Model
from softmpc.simulation.integrator import IntegrationError, Interval, relative_tolerance

__all__ = ["Cvodes"]

MOST_STEPS = 1_000_000  # between two samples


class Cvodes:
    """CVODES for a model with inertia; see `Integrator` for `advance`.

    `tolerance` is relative and absolute, of the states in units of `model.layout`. Raises
    `BuildError` for a model without an invertible M.
    """

    def __init__(self, model: Model, tolerance: float = 1e-8) -> None:
        self.model, self.tolerance = model, relative_tolerance(tolerance)
        if model.order != 2:
            raise BuildError("CVODES needs the effect 'inertia': take method = 'radau' or 'idas'")
        model.require_mass("CVODES")
        self._integrator = lru_cache(maxsize=8)(self._make)  # by the number of samples

    def advance(
        self, x: Any, u: Any, duration: float, samples: int = 1, u_end: Any = None
    ) -> np.ndarray:
        """States (samples×nx) after x = (q, dq, z); see `Integrator.advance`."""
        given = Interval(self.model, x, u, duration, samples, u_end)
        scale = self.model.layout.x.scale
        x0 = np.concatenate([given.q, given.dq, given.z]) / scale
        p = np.concatenate([[duration], given.u0, given.u_slope])
        try:
            found = np.asarray(self._integrator(samples)(x0=x0, p=p)["xf"]).T * scale
        except RuntimeError as error:
            code = re.search(r"CV_[A-Z_]+", str(error))
            word = code.group().removeprefix("CV_").replace("_", " ").lower() if code else "failed"
            raise IntegrationError(f"CVODES: {word}") from None
        if not np.all(np.isfinite(found)):
            raise IntegrationError("CVODES: the motion is no longer finite")
        return found

    def prepare(self) -> None:
        """Make the functions now, not with the first step."""
        _ = self._ode

    @cached_property
    def _ode(self) -> dict[str, Any]:
        scale, k = self.model.layout.x.scale, len(self.model.layout.u)
        s, x, p = ca.MX.sym("s"), ca.MX.sym("x", len(scale)), ca.MX.sym("p", 1 + 2 * k)
        duration, u0, slope = p[0], p[1 : 1 + k], p[1 + k :]
        rate = self.model.x_dot(x * scale, u0 + slope * (duration * s))
        return {"t": s, "x": x, "p": p, "ode": duration * rate / scale}

    def _make(self, samples: int) -> ca.Function:
        options = {
            "abstol": self.tolerance,
            "reltol": self.tolerance,
            "max_num_steps": MOST_STEPS,
            "disable_internal_warnings": True,  # the reason is in the exception
        }
        grid = np.arange(1, samples + 1) / samples
        return ca.integrator("arm", "cvodes", self._ode, 0.0, grid, options)
