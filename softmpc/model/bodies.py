"""The bodies of a segment, and the laws that the scene's effects put on them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from softmpc.model.effect import Effect, Site
    from softmpc.model.force_laws import ForceLaw

__all__ = ["Bodies", "BodyLaw", "bodies_of"]


@dataclass(frozen=True)
class BodyLaw:
    """Coefficients of the forces on one body, None where no effect brings one, and other laws."""

    mass: float | None = None  # kg, inertia
    heavy: float | None = None  # kg, weight
    drag: float | None = None  # N·s/m
    disc: float | None = None  # kg·m², moment of inertia about a diameter of the thin disc
    spin_drag: float | None = None  # N·m·s/rad
    laws: tuple[ForceLaw, ...] = ()

    @property
    def turns(self) -> bool:
        """Whether the body's rotation matters."""
        return self.disc is not None or self.spin_drag is not None


Bodies = tuple[tuple[float, BodyLaw], ...]  # place 0…1 along the segment, and what acts there
COEFFICIENTS = tuple(item.name for item in fields(BodyLaw) if item.name != "laws")


def bodies_of(
    effects: tuple[Effect, ...], site: Site, quadrature: Iterable[tuple[float, float]]
) -> Bodies:
    """The bodies of a segment: those of the quadrature, then those of effects, one a place.

    `quadrature` has (place, share of the section's mass). What several effects bring adds up.
    """
    brought: dict[float, dict[str, Any]] = {}
    for place, share in quadrature:
        brought[place] = {}
        for effect in effects:
            laws = effect.laws(site, share)
            _add(brought, place, {**effect.on_body(site.section, share), "laws": laws})
    for effect in effects:
        for place, law in effect.own_bodies(site):
            _add(brought, place, vars(law))
    return tuple((place, _law(values)) for place, values in brought.items())


def _add(brought: dict[float, dict[str, Any]], place: float, values: dict[str, Any]) -> None:
    known = brought.setdefault(place, {})
    for name, value in values.items():
        if value is not None:
            known[name] = known[name] + value if name in known else value


def _law(values: dict[str, Any]) -> BodyLaw:
    coefficients = {name: values[name] for name in COEFFICIENTS if values.get(name)}
    return BodyLaw(**coefficients, laws=values.get("laws", ()))
