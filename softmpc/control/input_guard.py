"""The last guard of an input: whatever a solver says, it leaves finite and within its limits."""

from __future__ import annotations

import numpy as np

from softmpc.control.limits import TorqueLimit, TorqueRateLimit
from softmpc.control.ocp import Ocp
from softmpc.errors import InputError

__all__ = ["InputGuard"]

Array = np.ndarray


class InputGuard:
    """Bounds of the input and of its change in one step of the controller.

    They are the arm's own limits and the problem's hard ones, the tightest of each.
    """

    def __init__(self, ocp: Ocp) -> None:
        arm, k = ocp.model.scene.manipulator.limits, len(ocp.model.layout.u)
        torque = ocp.model.scene.actuation.input == "torque"
        own = (
            (arm.torque_min, arm.torque_max) if torque else (arm.pressure_min, arm.pressure_max),
        )
        self._widest = *_tightest(ocp, TorqueLimit, k, own), *_tightest(ocp, TorqueRateLimit, k)
        self.narrow()

    def narrow(
        self, low: Array | None = None, high: Array | None = None, fall: Array | None = None,
        rise: Array | None = None,
    ) -> None:  # fmt: skip
        """Narrower limits of the input and of its change in a step (k each, SI), never wider ones.

        What is None is as wide as it was made. Raises `InputError`, and changes nothing, where a
        lower limit is not below the upper one or a number is NaN.
        """
        found = []
        for side, (wide, given) in enumerate(
            zip(self._widest, (low, high, fall, rise), strict=True)
        ):
            value = wide if given is None else np.broadcast_to(np.asarray(given, float), wide.shape)
            found.append(np.minimum(wide, value) if side % 2 else np.maximum(wide, value))
        if not (np.all(found[0] < found[1]) and np.all(found[2] < found[3])):
            raise InputError("set_limits: each lower limit must be below the upper one, none NaN")
        self.low, self.high, self.fall, self.rise = found

    def inside(self, u: Array) -> Array:
        """The nearest input within the limits (k)."""
        return np.clip(u, self.low, self.high)

    def after(self, before: Array, u: Array) -> Array:
        """The nearest input within the limits that may follow `before` (k).

        Where the input before was further outside than one step can mend, the limit of the input
        goes before that of its change.
        """
        return self.inside(np.clip(u, before + self.fall, before + self.rise))

    def finite(self, u: Array, last: Array | None) -> Array:
        """u where it is finite; else the input given last, the nearest to none before any."""
        return np.where(np.isfinite(u), u, self.inside(np.zeros(len(u))) if last is None else last)


def _tightest(
    ocp: Ocp, kind: type, k: int, own: tuple[tuple[float, float], ...] = ()
) -> tuple[Array, Array]:
    """Bounds (k) of the hard limits of one kind and the arm's own; none are infinite."""
    found = [(limit.low, limit.high) for limit in ocp.limits if _is_hard(limit, kind)]
    pairs = [*own, *found]
    low = max((pair[0] for pair in pairs), default=-np.inf)
    high = min((pair[1] for pair in pairs), default=np.inf)
    return np.full(k, low), np.full(k, high)


def _is_hard(limit: object, kind: type) -> bool:
    return isinstance(limit, kind) and getattr(limit, "soft", None) is None
