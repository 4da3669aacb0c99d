"""The integration methods by name, and which numbers each of them takes."""

from __future__ import annotations

from dataclasses import dataclass

from softmpc.errors import InputError, unknown_name
from softmpc.model.model import Model
from softmpc.simulation.cvodes import Cvodes
from softmpc.simulation.following import Following
from softmpc.simulation.idas import Idas
from softmpc.simulation.integrator import Integrator
from softmpc.simulation.runge_kutta import GaussLegendre, RadauIIA

__all__ = ["METHODS", "Method", "integrator_for"]

# Name -> the numbers it takes: a tolerance in metres at the tip, a relative one, a step in s.
METHODS: dict[str, tuple[str, ...]] = {
    "radau": ("tip_tolerance", "step"),
    "radau-2": ("tip_tolerance", "step"),
    "gauss": ("step",),
    "gauss-2": ("step",),
    "idas": ("tolerance",),
    "cvodes": ("tolerance",),
}
TIP_TOLERANCE = 1e-6  # m
TOLERANCE = 1e-8
MEANING = {"tip_tolerance": "m, at the tip", "tolerance": "relative", "step": "s"}


@dataclass(frozen=True)
class Method:
    """A method and its numbers; those that are None keep their defaults.

    Raises `InputError` for an unknown name and for numbers the method does not take.
    """

    name: str = "radau"
    tip_tolerance: float | None = None  # m
    tolerance: float | None = None  # of the scaled states
    step: float | None = None  # s

    def __post_init__(self) -> None:
        if self.name not in METHODS:
            raise InputError(unknown_name("method", self.name, METHODS))
        takes = METHODS[self.name]
        for number in MEANING:
            value = getattr(self, number)
            if value is not None and number not in takes:
                wanted = " or ".join(f"{key} ({MEANING[key]})" for key in takes)
                raise InputError(f"{number} = {value!r}: method {self.name!r} takes {wanted}")
        if takes == ("step",) and self.step is None:
            raise InputError(f"method {self.name!r} keeps its step: give step in s, such as 0.005")
        if self.step is not None and self.tip_tolerance is not None:
            raise InputError("step and tip_tolerance are both given: leave out one of them")

    def integrator(self, model: Model) -> Integrator:
        """The integrator; statics where the model has neither mass nor damping."""
        if model.order == 0:
            return Following(model)
        if self.name == "idas":
            return Idas(model, TOLERANCE if self.tolerance is None else self.tolerance)
        if self.name == "cvodes":
            return Cvodes(model, TOLERANCE if self.tolerance is None else self.tolerance)
        stages = 2 if self.name.endswith("-2") else 3
        if self.name.startswith("gauss"):
            assert self.step is not None  # checked above
            return GaussLegendre(model, self.step, stages)
        tolerance = TIP_TOLERANCE if self.tip_tolerance is None else self.tip_tolerance
        return RadauIIA(model, tolerance, stages, self.step)


def integrator_for(
    model: Model,
    method: str = "radau",
    *,
    tip_tolerance: float | None = None,
    tolerance: float | None = None,
    step: float | None = None,
) -> Integrator:
    """The integrator of that name for a model; see `METHODS` and `Method`."""
    return Method(method, tip_tolerance, tolerance, step).integrator(model)
