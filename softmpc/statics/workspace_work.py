"""The work of the sweeps that find a workspace: one search a case, of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.statics.workspace_limits import ExtremeSearch
from softmpc.statics.workspace_rays import Place, RaySearch
from softmpc.statics.workspace_samples import Samples, Start

__all__ = ["SearchWork", "along", "extreme", "nearest", "rim"]

NEAR = 60  # samples nearest to a ray, of which starts are taken
BEST = 2  # starts that already are far along the ray
SPREAD = {1: 2, -1: 4}  # and starts unlike these: inner edges have many local optima
RIM_STARTS = 6
AROUND = 0.5  # rad, how far in azimuth a start of a rim may be

Case = dict[str, Any]


def along(direction: np.ndarray, sense: int, starts: Sequence[Any] = ()) -> Case:
    """The place farthest from the base (`sense` -1: nearest) along a unit vector.

    Without `starts` (places as JSON) they are taken from the samples.
    """
    return {
        "what": "along", "direction": direction.tolist(), "sense": sense, "starts": list(starts)
    }  # fmt: skip


def rim(azimuth: float, sense: int, starts: Sequence[Any] = ()) -> Case:
    """The place of largest (`sense` -1: smallest) polar angle at an azimuth."""
    return {"what": "rim", "azimuth": float(azimuth), "sense": sense, "starts": list(starts)}


def nearest() -> Case:
    """The place nearest to the base."""
    return {"what": "nearest"}


def extreme(quantity: str, section: int, sense: int) -> Case:
    """The place where a quantity of a section is largest (`sense` -1: smallest)."""
    return {"what": "extreme", "quantity": quantity, "section": section, "sense": sense}


@dataclass(frozen=True)
class SearchWork:
    """Searches of one place on an arm, from samples of it; a result is a place as JSON."""

    scene: Scene
    section: int
    held: tuple[tuple[int, float], ...]
    frame: np.ndarray
    flat: bool
    samples: Samples

    @cached_property
    def _rays(self) -> RaySearch:
        model: Model = build(self.scene)
        return RaySearch(model, self.section, dict(self.held), self.frame, self.flat)

    @cached_property
    def _extremes(self) -> ExtremeSearch:
        return ExtremeSearch(self._rays)

    @cached_property
    def _angles(self) -> np.ndarray:
        """Azimuth and polar angle of the samples (2×K)."""
        x, y, z = (self.samples.tips @ self.frame).T
        return np.array([np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)])

    def __call__(self, case: Case) -> Any:
        found = getattr(self, f"_{case['what']}")(case)
        return found.plain() if isinstance(found, Place) else found

    def _along(self, case: Case) -> Place | None:
        direction, sense = np.array(case["direction"]), case["sense"]
        starts = _given(case) or self.samples.starts(self._near(direction, sense))
        return self._rays.along(direction, sense, starts)

    def _rim(self, case: Case) -> Place | None:
        azimuth, sense = case["azimuth"], case["sense"]
        if case["starts"]:
            return self._rays.rim(azimuth, sense, _given(case))
        away = np.abs(np.angle(np.exp(1j * (self._angles[0] - azimuth))))
        near = np.argsort(away)[: max(NEAR, int(np.sum(away < AROUND)))]
        worth = sense * self._angles[1][near] - away[near] / 2
        return self._rays.rim(
            azimuth, sense, self.samples.starts(near[np.argsort(-worth)[:RIM_STARTS]])
        )

    def _nearest(self, case: Case) -> Place | None:
        return self._rays.nearest(self.samples.starts(np.argsort(self.samples.radii)[:RIM_STARTS]))

    def _extreme(self, case: Case) -> dict[str, Any]:
        asked = (case["quantity"], case["section"], case["sense"])
        place, value = self._extremes.find(*asked, self.samples)
        return {"place": place and place.plain(), "value": value}

    def _near(self, direction: np.ndarray, sense: int) -> np.ndarray:
        """Samples to start a ray from: far along it, and some of the others that differ most."""
        samples = self.samples
        cosine = samples.tips @ direction / np.maximum(samples.radii, 1e-12)
        angle = np.arccos(np.clip(cosine, -1, 1))
        near = np.argsort(angle)[:NEAR]
        worth = sense * samples.radii[near] / self._rays.length - angle[near]
        order = near[np.argsort(-worth)]
        return _unlike(samples.pressures, order, BEST, SPREAD[sense])


def _given(case: Case) -> list[Start]:
    places = (Place.of(plain) for plain in case["starts"])
    return [Start(place.q, place.pressures, place.tip) for place in places if place]


def _unlike(pressures: np.ndarray, order: np.ndarray, first: int, more: int) -> np.ndarray:
    """The first of `order`, then those whose pressures are farthest from all chosen ones."""
    chosen = list(order[:first])
    left = order[first:]
    if not len(left):
        return np.array(chosen)
    away = np.full(len(left), np.inf)
    for one in chosen:
        away = np.minimum(away, np.linalg.norm(pressures[left] - pressures[one], axis=1))
    for _ in range(min(more, len(left))):
        far = int(np.argmax(away))
        chosen.append(left[far])
        away = np.minimum(away, np.linalg.norm(pressures[left] - pressures[left[far]], axis=1))
    return np.array(chosen)
