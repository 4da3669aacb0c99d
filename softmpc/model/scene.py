"""A scene says what exists: the arm, its discretisation, one object a slot, and its effects."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import Any, TypeVar

from softmpc.errors import SceneError, unknown_name
from softmpc.model.actuation import Actuation, HydraulicDrive
from softmpc.model.effects import (
    EFFECTS,
    Coriolis,
    Effect,
    EnvironmentDamping,
    Gravity,
    Inertia,
    MaterialDamping,
    RotaryInertia,
)
from softmpc.model.elasticity import PrintedElasticity
from softmpc.model.formulations import Formulation, NewtonEuler, VirtualPower
from softmpc.model.kinematics import Arc, ConstantStrainArc
from softmpc.model.parameters import Manipulator

__all__ = ["MAX_SEGMENTS", "SCHEMA_VERSION", "STRAINS", "Scene", "default_effects"]

SCHEMA_VERSION = 1
STRAINS = ("epsilon", "kappa_x", "kappa_y", "kappa_z")
MAX_SEGMENTS = 64

E = TypeVar("E", bound=Effect)


def default_effects(strains: Iterable[str] = STRAINS) -> tuple[Effect, ...]:
    """Return the effects of a scene that names none; twist needs rotary inertia to have mass."""
    rotary = (RotaryInertia(),) if "kappa_z" in strains else ()
    always = EnvironmentDamping(), MaterialDamping()
    return (Gravity(), Inertia(), Coriolis(), *rotary, *always)


@dataclass(frozen=True)
class Scene:
    """What exists; `build` makes only that.

    ``segments`` is per section, ``strains`` are the states of each segment. ``effects`` left out
    are `default_effects`. Strains and effects are stored in one order, however they are given.
    """

    manipulator: Manipulator
    segments: int = 1
    kinematics: Arc = field(default_factory=ConstantStrainArc)
    formulation: Formulation = field(default_factory=VirtualPower)
    strains: tuple[str, ...] = STRAINS
    effects: tuple[Effect, ...] = None  # type: ignore[assignment]  # set in __post_init__
    actuation: Actuation = field(default_factory=HydraulicDrive)

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", _whole_segments(self.segments))
        _check_slots(self)
        object.__setattr__(self, "strains", _ordered_strains(self.strains))
        effects = default_effects(self.strains) if self.effects is None else self.effects
        object.__setattr__(self, "effects", _ordered_effects(effects))
        _check_consistency(self)

    def effect(self, kind: type[E]) -> E | None:
        """Return the effect of that class, or None when it is absent."""
        return next((effect for effect in self.effects if isinstance(effect, kind)), None)

    def with_(self, **changes: Any) -> "Scene":
        """Return a copy with some fields changed; effects stay as they are unless given."""
        return replace(self, **changes)


def _whole_segments(segments: Any) -> int:
    whole = isinstance(segments, Integral) and not isinstance(segments, bool)
    if not whole or not 1 <= segments <= MAX_SEGMENTS:
        raise SceneError(
            f"Scene.segments = {segments!r}: must be a whole number from 1 to {MAX_SEGMENTS}"
        )
    return int(segments)


def _check_slots(scene: Scene) -> None:
    slots: dict[str, type] = {
        "manipulator": Manipulator,
        "kinematics": Arc,
        "formulation": Formulation,
        "actuation": Actuation,
    }
    for name, kind in slots.items():
        value = getattr(scene, name)
        if not isinstance(value, kind):
            hint = f"; write {value.__name__}()" if isinstance(value, type) else ""
            raise SceneError(f"Scene.{name} = {value!r}: must be one {kind.__name__} object{hint}")


def _ordered_strains(strains: Any) -> tuple[str, ...]:
    """Return the strains in the order of `STRAINS`."""
    if isinstance(strains, str) or not isinstance(strains, Iterable):
        raise SceneError(f"Scene.strains = {strains!r}: must be some of {', '.join(STRAINS)}")
    given = list(strains)
    for strain in given:
        if strain not in STRAINS:
            raise SceneError(unknown_name("strain", strain, STRAINS))
        if given.count(strain) > 1:
            raise SceneError(f"strain {strain!r} is given twice; leave one out")
    if not given:
        raise SceneError(f"Scene.strains is empty: must be at least one of {', '.join(STRAINS)}")
    return tuple(strain for strain in STRAINS if strain in given)


def _ordered_effects(effects: Any) -> tuple[Effect, ...]:
    """Return the effects in the order of `EFFECTS`, those of other people after them."""
    if not isinstance(effects, Iterable):
        raise SceneError(f"Scene.effects = {effects!r}: must be a tuple of effects")
    given = list(effects)
    for effect in given:
        if not isinstance(effect, Effect):
            hint = f"; write {effect.__name__}()" if isinstance(effect, type) else ""
            raise SceneError(f"Scene.effects has {effect!r}: must be Effect objects{hint}")
    names = [effect.name for effect in given]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"effect {name!r} is given twice; leave one out")
    order = [kind.name for kind in EFFECTS]
    return tuple(
        sorted(given, key=lambda e: order.index(e.name) if e.name in order else len(order))
    )


def _check_consistency(scene: Scene) -> None:
    scene.actuation.check(scene.effects)
    names = {effect.name for effect in scene.effects}
    for effect in scene.effects:
        if misfit := effect.misfit(scene.manipulator):
            raise SceneError(misfit)
        for needed in (name for name in effect.needs if name not in names):
            raise SceneError(
                f"effect {effect.name!r} needs the effect {needed!r}: add it, "
                f"or leave {effect.name!r} out as well"
            )
        if effect.virtual_power_only and isinstance(scene.formulation, NewtonEuler):
            raise SceneError(
                f"effect {effect.name!r} is not in the formulation {scene.formulation.name!r}: "
                "use 'virtual-power', or leave the effect out"
            )
    if isinstance(scene.formulation, NewtonEuler) and scene.strains != STRAINS:
        raise SceneError(
            f"formulation {scene.formulation.name!r} needs all four strains, "
            f"not only {', '.join(scene.strains)}: use 'virtual-power' for a selection"
        )
    if isinstance(scene.formulation.elasticity, PrintedElasticity) and scene.segments != 1:
        raise SceneError(
            f"elasticity 'printed' depends on the number of segments and is allowed for 1 only, "
            f"not {scene.segments}: use 'strain' or 'energy'"
        )
