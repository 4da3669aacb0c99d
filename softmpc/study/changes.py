"""Changes of a scene: what may be left out of it, added to it, or made coarser or finer.

A change is a function from scene to scene, so changes can follow one another. Where a scene does
not allow it, the function raises `SceneError` or `BuildError`, which says why.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from softmpc.errors import BuildError, InputError, SceneError
from softmpc.model.actuation import Actuation
from softmpc.model.effects import EFFECTS, Effect, Inertia, RotaryInertia
from softmpc.model.model import build
from softmpc.model.scene import Scene

__all__ = [
    "ADDED",
    "COARSER",
    "FINER",
    "LEFT_OUT",
    "OTHER",
    "Change",
    "adding",
    "driving",
    "without",
]

# Kinds of changes.
LEFT_OUT, COARSER, OTHER, FINER, ADDED = "left out", "coarser", "other", "finer", "added"


@dataclass(frozen=True)
class Change:
    """One change; of two in the same slot only one can be made."""

    name: str
    kind: str
    slot: str
    apply: Callable[[Scene], Scene]


def without(scene: Scene, left_out: Iterable[str]) -> Scene:
    """The scene without effects of these names and those that make no sense without them.

    A strain that loses its mass with them is left out as well, for it could not move.
    """
    names = set(left_out)
    smaller = _with_most(scene, [e for e in scene.effects if e.name not in names])
    model = build(smaller)
    massless = {name.rsplit("_", 2)[0] for name in model.massless}
    if model.order == 2 and massless and massless < set(scene.strains):
        return smaller.with_(strains=tuple(s for s in scene.strains if s not in massless))
    return smaller


def driving(scene: Scene, actuation: Actuation) -> Scene:
    """The scene with another drive, without the effects which that drive cannot have."""
    return _with_most(scene.with_(effects=(), actuation=actuation), list(scene.effects))


def adding(scene: Scene, kind: type[Effect]) -> Scene:
    """The scene with an effect of that class with its default parameters, and what that needs.

    Inertia brings rotary inertia where twist is a state, which has no mass without it.
    """
    try:
        added = kind()
    except (TypeError, InputError) as error:
        raise SceneError(f"effect {kind.name!r} has no default parameters: {error}") from None
    missing = {k.name: k for k in EFFECTS} | {e.name: type(e) for e in scene.effects}
    needed, effects = [*added.needs, *_companions(scene, added)], [*scene.effects, added]
    for name in needed:
        if name not in [e.name for e in effects] and name in missing:
            effects.append(missing[name]())
            needed += [*effects[-1].needs, *_companions(scene, effects[-1])]
    return built(scene.with_(effects=tuple(effects)))


def _companions(scene: Scene, added: Effect) -> tuple[str, ...]:
    twists = isinstance(added, Inertia) and "kappa_z" in scene.strains
    return (RotaryInertia.name,) if twists else ()


def built(scene: Scene) -> Scene:
    """The scene itself, if a model can be made of it."""
    build(scene)
    return scene


def _with_most(scene: Scene, effects: list[Effect]) -> Scene:
    """The scene with as many of the effects as go together; Coulomb friction goes last."""
    try:
        return built(scene.with_(effects=tuple(effects)))
    except (SceneError, BuildError):
        pass
    kept, waiting = built(_frictionless(scene.with_(effects=()))), list(effects)
    while True:
        for effect in waiting:
            try:
                kept = built(kept.with_(effects=(*kept.effects, effect)))
            except (SceneError, BuildError):
                continue
            break
        else:
            return kept
        waiting.remove(effect)


def _frictionless(scene: Scene) -> Scene:
    """The scene, and where its drive refuses Coulomb friction: without that."""
    try:
        return built(scene)
    except BuildError:
        arm = scene.manipulator
        if arm.hydraulics.friction == 0.0:
            raise
        smooth = replace(arm.hydraulics, friction=0.0)
        return scene.with_(manipulator=replace(arm, hydraulics=smooth))
