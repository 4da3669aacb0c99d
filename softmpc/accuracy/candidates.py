"""What a choice is made of: configurations that differ in what matters, from coarse to fine."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import inf, prod
from typing import Any

from softmpc.accuracy.configuration import Configuration, Task, changed
from softmpc.errors import SoftmpcError
from softmpc.model.drive_effects import DriveEffect
from softmpc.model.formulations import VirtualPower
from softmpc.model.model import build
from softmpc.model.scene import Scene
from softmpc.model.scene_file import ACTUATIONS, scene_from_dict

__all__ = [
    "AS_GIVEN",
    "Candidate",
    "Option",
    "Space",
    "coarser_drives",
    "coarser_strains",
    "combined",
    "discretisations",
    "left_out",
    "motion_space",
    "rest_space",
    "undominated",
    "valid",
]

FIRST, FINER = (1, 2, 3), (4, 6)  # segments a section; finer ones only where these do not do
MASSES = {"gauss-1": ("1 Gauss point", 0.65), "gauss-2": ("2 Gauss points", 1.0)}
GIVEN = inf  # share of a slot that is left as the scene has it
KEPT = ("environment_damping", "material_damping")  # without them an arm takes more steps, not less
STEPS = ((50, 1.0), (5, 0.8))  # the tolerance over the error of a step at the tip; share
STEP_RANGE = (1e-7, 1e-3)  # m


@dataclass(frozen=True)
class Option:
    """One choice in a slot.

    `share` is about how the time goes with it: it says which of two in a slot costs less, and which
    candidates are looked at first. What is chosen is decided by times that are measured.
    """

    slot: str
    share: float
    name: str
    changes: Mapping[str, Any]


@dataclass(frozen=True)
class Candidate:
    """Options, one a slot; a slot without one is as the scene has it."""

    options: tuple[Option, ...] = ()

    @property
    def name(self) -> str:
        return ", ".join(option.name for option in self.options if option.name) or "as given"

    @property
    def changes(self) -> dict[str, Any]:
        """Keys of the scene file with their values."""
        merged: dict[str, Any] = {}
        for option in self.options:
            merged |= option.changes
        return merged

    @property
    def configuration(self) -> Configuration:
        return Configuration("candidate", self.name, self.changes)

    def with_(self, *options: Option) -> Candidate:
        """The candidate with other choices in the slots of `options`."""
        slots = {option.slot for option in options}
        return Candidate((*(o for o in self.options if o.slot not in slots), *options))

    def costs_more(self, other: Candidate) -> bool:
        """Whether it has nothing coarser than the other one, and something finer."""
        own, theirs = self._shares(), other._shares()
        pairs = [(own.get(slot, GIVEN), theirs.get(slot, GIVEN)) for slot in {*own, *theirs}]
        return all(a >= b for a, b in pairs) and any(a > b for a, b in pairs)

    @property
    def weight(self) -> float:
        """About how much it costs beside the others; the scene as given is behind them all."""
        return prod(option.share for option in self.options) if self.options else GIVEN

    def _shares(self) -> dict[str, float]:
        return {option.slot: option.share for option in self.options}


AS_GIVEN = Candidate()


@dataclass(frozen=True)
class Space:
    """Where to look: one round after the other until one does, then what else may be coarser."""

    rounds: tuple[tuple[Candidate, ...], ...]
    extras: tuple[Option, ...] = ()


def undominated(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Those that may be the cheapest: no other one is coarser in something and finer in nothing."""
    known = list(candidates)
    return [one for one in known if not any(one.costs_more(other) for other in known)]


def rest_space(task: Task, tolerance_m: float) -> Space:
    """For the arm at rest: segments and mass, then strains that do not take part."""
    scene = task.scene
    rounds = combined([()], discretisations(scene))
    return Space(rounds, (*coarser_strains(scene),))


def motion_space(task: Task, tolerance_m: float) -> Space:
    """For motions: besides, the error of a step, coarser drives, and effects left out."""
    scene = task.scene
    fine, loose = (_integration(share, tolerance_m / times) for times, share in STEPS)
    extras = [*coarser_strains(scene), *left_out(scene), *coarser_drives(scene), loose]
    return Space(combined([(fine,)], discretisations(scene)), tuple(extras))


def combined(
    starts: Sequence[tuple[Option, ...]], rounds: Sequence[Sequence[tuple[Option, ...]]]
) -> tuple[tuple[Candidate, ...], ...]:
    """Rounds of candidates: each start with each choice; the scene as given is the first of all."""
    found = [
        tuple(Candidate((*choice, *start)) for choice, start in product(choices, starts))
        for choices in rounds
    ]
    return ((AS_GIVEN, *found[0]), *found[1:])


def discretisations(
    scene: Scene, prefix: str = "", rounds: Sequence[Sequence[int]] = (FIRST, FINER)
) -> list[list[tuple[Option, ...]]]:
    """Segments and mass, by virtual power, in rounds; `prefix` goes before the keys."""
    found = []
    for number, counts in enumerate(rounds):
        known = sorted({*counts} | ({scene.segments} if number == 0 else set()))
        found.append([_discretised(scene, n, mass, prefix) for n in known for mass in MASSES])
    return found


def _discretised(scene: Scene, count: int, mass: str, prefix: str) -> tuple[Option, ...]:
    spelt = "1 segment" if count == 1 else f"{count} segments"
    segments = Option("segments", count, spelt, {f"{prefix}model.segments": count})
    changes: dict[str, Any] = {f"{prefix}model.mass": mass}
    if not isinstance(scene.formulation, VirtualPower):
        changes |= {f"{prefix}model.formulation": VirtualPower.name}
    name, share = MASSES[mass]
    return segments, Option("mass", share, name, changes)


def _integration(share: float, error_m: float) -> Option:
    low, high = STEP_RANGE
    size = float(f"{min(max(error_m, low), high):.1g}")
    name = f"steps within {1e3 * size:g} mm"
    changes = {"method": "radau", "tip_tolerance": size, "tolerance": None, "step": None}
    return Option("integration", share, name, {f"simulate.{k}": v for k, v in changes.items()})


def coarser_strains(scene: Scene, prefix: str = "") -> Iterator[Option]:
    """Fewer strains: without twist, or bending in one plane."""
    sets = {
        "bending about y alone": (0.3, ("kappa_x", "kappa_z")),
        "bending about x alone": (0.3, ("kappa_y", "kappa_z")),
        "no twist": (0.7, ("kappa_z",)),
    }
    for name, (share, gone) in sets.items():
        left = [strain for strain in scene.strains if strain not in gone]
        if left and len(left) < len(scene.strains):
            changes: dict[str, Any] = {f"{prefix}model.strains": left}
            if "rotary_inertia" in [effect.name for effect in scene.effects]:
                changes[f"{prefix}effects.rotary_inertia"] = True  # one Gauss point needs it
            yield Option("strains", share, name, changes)


def left_out(scene: Scene, prefix: str = "") -> Iterator[Option]:
    """Effects that may be left out; where the arm is and what it holds is for the scene to say."""
    for effect in scene.effects:
        if effect.surroundings or effect.name in (*KEPT, "rotary_inertia"):
            continue
        gone = [effect.name, *(e.name for e in scene.effects if effect.name in e.needs)]
        changes = {f"{prefix}effects.{name}": False for name in gone}
        if effect.name == "inertia":
            changes[f"{prefix}effects.rotary_inertia"] = False
        share = 0.5 if effect.name == "inertia" or isinstance(effect, DriveEffect) else 0.95
        yield Option(f"effect {effect.name}", share, f"without {effect.name}", changes)


def coarser_drives(scene: Scene, prefix: str = "") -> Iterator[Option]:
    """Drives with the same input and fewer states."""
    own = scene.actuation
    same = [drive for drive in ACTUATIONS.values() if drive.input == own.input]
    fewer = [drive for drive in same if len(drive.states) < len(own.states)]
    drive_effects = [e.name for e in scene.effects if isinstance(e, DriveEffect)]
    for drive in sorted(fewer, key=lambda drive: len(drive.states)):
        changes: dict[str, Any] = {f"{prefix}actuation.kind": drive.name}
        changes |= {f"{prefix}effects.{name}": False for name in drive_effects}
        if scene.manipulator.hydraulics.friction:
            changes[f"{prefix}hydraulics.friction"] = 0.0
        yield Option("drive", 0.98 if drive.states else 0.96, f"{drive.name} drive", changes)


def valid(task: Task, options: Iterable[Option]) -> list[Option]:
    """Those options that alone make a scene which can be built."""
    found = []
    for option in options:
        try:
            build(scene_from_dict(changed(task.document, option.changes)))
        except SoftmpcError:
            continue
        found.append(option)
    return found
