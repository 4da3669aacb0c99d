"""What an effect is: the base class of everything a scene adds to elasticity and drive.

An effect is a small frozen dataclass. Its parameters are fields made with `quantity`, `vector`,
`choice` or `parts` (softmpc/model/quantities.py), so unit, source, range and meaning are known:
`__post_init__` checks them, and scene files and their reference page need nothing more. An effect
is listed in `EFFECTS` of softmpc/model/effects.py.
"""

from __future__ import annotations

from abc import ABC
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from softmpc.model.quantities import check_quantities

if TYPE_CHECKING:
    from softmpc.model.bodies import Bodies
    from softmpc.model.force_laws import ForceLaw
    from softmpc.model.parameters import Manipulator, Section

__all__ = ["Effect", "Site"]


@dataclass(frozen=True)
class Site:
    """The segment that an effect acts on."""

    section: Section
    rest: float  # its rest length, m
    last: bool  # whether the arm ends with it
    names: frozenset[str]  # of all effects of the scene


class Effect(ABC):
    """Something a scene may contain or leave out."""

    name: ClassVar[str]
    by_default: ClassVar[bool] = False  # in scenes that do not speak of it
    needs: ClassVar[tuple[str, ...]] = ()  # names of effects it makes no sense without
    bare: ClassVar[str | None] = None  # the one parameter that scene files give without its name
    virtual_power_only: ClassVar[bool] = False  # refused by the Newton-Euler formulations
    surroundings: ClassVar[bool] = False  # where the arm is and what it holds: a scene's choice

    def __post_init__(self) -> None:
        check_quantities(self)

    def misfit(self, arm: Manipulator) -> str:
        """Why the effect does not fit this arm; empty where it does."""
        return ""

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        """Coefficients of `BodyLaw` for a body with that share of the section's mass."""
        return {}

    def laws(self, site: Site, share: float) -> tuple[ForceLaw, ...]:
        """Other forces on a body with that share of the section's mass."""
        return ()

    def own_bodies(self, site: Site) -> Bodies:
        """Bodies at places of its own: (place 0…1 along the segment, `BodyLaw`)."""
        return ()

    def on_strains(self, section: Section, rest: float) -> tuple[float, ...] | None:
        """Viscous coefficients of (ε, kx, ky, kz) of a segment of rest length `rest`."""
        return None
