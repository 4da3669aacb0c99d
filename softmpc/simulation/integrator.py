"""What every integrator offers: `advance` over an interval in which the input is linear in time."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from softmpc.errors import InputError, SoftmpcError
from softmpc.model.model import Model

__all__ = ["IntegrationError", "Integrator", "Interval", "relative_tolerance"]


class IntegrationError(SoftmpcError):
    """An integrator could not reach the end of its interval."""


class Integrator(Protocol):
    """Moves the state x = (q, dq, z) of a model forward in time."""

    model: Model

    def advance(
        self, x: Any, u: Any, duration: float, samples: int = 1, u_end: Any = None
    ) -> np.ndarray:
        """States (samples×nx) at equal steps after x (nx), the last one at `duration` (s).

        The input (k) is u throughout, or goes linearly from u to `u_end`. Raises
        `IntegrationError` when the end is not reached and `InputError` for wrong arguments.
        """
        ...

    def prepare(self) -> None:
        """Make the functions now, not with the first step."""
        ...


class Interval:
    """The checked arguments of `advance`: q, dq (n), z (h), u0 and u_slope (k), times (samples)."""

    def __init__(
        self, model: Model, x: Any, u: Any, duration: float, samples: int, u_end: Any
    ) -> None:
        n, layout = model.strains, model.layout
        if not (np.isfinite(duration) and duration > 0 and samples >= 1):
            raise InputError(
                f"duration = {duration!r} s, samples = {samples!r}: must be above 0 and at least 1"
            )
        state = _vector("x", x, len(layout.x))
        self.q, self.dq, self.z = np.split(state, [n, 2 * n])
        self.u0 = _vector("u", u, len(layout.u))
        end = self.u0 if u_end is None else _vector("u_end", u_end, len(layout.u))
        self.u_slope = (end - self.u0) / duration
        self.duration, self.times = duration, duration * np.arange(1, samples + 1) / samples


def relative_tolerance(value: float) -> float:
    """A tolerance of SUNDIALS; raises `InputError` outside what its methods can keep."""
    if not 1e-13 <= value <= 1e-2:
        raise InputError(f"tolerance = {value!r}: must be between 1e-13 and 0.01")
    return float(value)


def _vector(name: str, value: Any, size: int) -> np.ndarray:
    array = np.asarray(value, dtype=float).ravel()
    if len(array) != size:
        raise InputError(f"{name} has {len(array)} values: must be {size}")
    if not np.all(np.isfinite(array)):
        raise InputError(f"{name} = {array.tolist()}: all must be finite numbers")
    return array
