"""What rests are measured against: a rod, or a fine model where the rod does not know the scene."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.accuracy.configuration import Task
from softmpc.accuracy.model_axes import segment_counts
from softmpc.accuracy.rod_of_scene import SceneRod, rod_of_scene, unknown_to_rod
from softmpc.errors import InputError, SoftmpcError, unknown_name
from softmpc.model.chain import Chain
from softmpc.model.effects import Inertia
from softmpc.model.formulations import VirtualPower
from softmpc.model.kinematics import ConstantStrainArc
from softmpc.model.mass import GaussMass
from softmpc.model.model import Model, build
from softmpc.model.scene import MAX_SEGMENTS, Scene
from softmpc.simulation.settings import read_settings
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium
from softmpc.statics.rest_limits import beyond_limits, rest_limits
from softmpc.study.rests import farthest

__all__ = ["FREQUENCIES", "POSTURE", "frequencies", "names", "posture_names", "reference"]

FREQUENCIES = 4  # the lowest ones
QUICK, FULL = 4, 8  # postures
SEED, ATTEMPTS = 2022, 10
POSTURE, END = "posture", "end of [simulate]"
AT_ZERO, AT_BENT = "frequencies without pressure", "frequencies at posture 1"
FINER = 2  # times the segments of the finest candidate
MOST_WITH_LAWS = 8  # segments, with forces whose derivatives CasADi makes for the whole arm
COARSE_TOLERANCE, COARSE_NODES = 1e-8, 16  # of the rod, for its doubt
ROD = "an extensible Kirchhoff rod without segments, solved as a boundary-value problem"
Numbers = dict[str, Any]


def posture_names(task: Task) -> list[str]:
    """The references that are postures."""
    found = [f"{POSTURE} {k}" for k in range(1, (QUICK if task.quick else FULL) + 1)]
    return [*found, END] if "simulate" in task.document else found


def names(task: Task) -> list[str]:
    """All references of a task."""
    moving = task.scene.effect(Inertia) is not None
    return posture_names(task) + ([AT_ZERO, AT_BENT] if moving else [])


def reference(task: Task, name: str) -> Numbers:
    """A reference by its name.

    A posture has `pressures` (Pa), `tips` of the sections (S×3, m), those of the scene as given and
    `doubt_m`; frequencies have `pressures`, `frequencies` (rad/s) and their relative
    `frequency_doubt`. What could not be had has no such entries, and `about` says why.
    """
    if name not in names(task):
        raise InputError(unknown_name("reference", name, names(task)))
    given = build(task.scene)
    standard = _standard(task, given.scene)
    if name == AT_ZERO:
        return _frequencies(standard, np.zeros(given.scene.manipulator.units))
    if name == END:
        return _posture(given, standard, [_end_pressures(task, given)], "under its last inputs")
    index = 1 if name == AT_BENT else int(name.removeprefix(POSTURE))
    drawn = [_drawn(given, index, attempt) for attempt in range(ATTEMPTS)]
    found = _posture(given, standard, drawn, "at random pressures within the scene's limits")
    if name != AT_BENT or "tips" not in found:
        return found
    return _frequencies(standard, np.array(found["pressures"]))


def frequencies(model: Model, q: Any, p: Any, count: int = FREQUENCIES) -> np.ndarray:
    """The lowest undamped natural frequencies (rad/s, complex) of a model about a rest.

    Numbers are complex where motions grow or shrink though nothing damps them: M and ∂N/∂q of the
    Newton-Euler formulations are not symmetric. Rising by absolute value.
    """
    K, M = np.asarray(model.stiffness(q, p)[0]), np.asarray(model.M(q))
    squares = np.linalg.eigvals(np.linalg.solve(K, M)).astype(complex)  # 1/ω²
    squares = squares[np.argsort(-np.abs(squares), kind="stable")][:count]
    return np.asarray(1 / np.sqrt(squares))


# --- what stands for the truth -----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Standard:
    """Tips (S×3, m) and frequencies (rad/s) at pressures, each with its doubt; raises."""

    about: str
    posture: Callable[[np.ndarray], tuple[np.ndarray, float]]
    frequencies: Callable[[np.ndarray], tuple[np.ndarray, float]]


def _standard(task: Task, scene: Scene) -> _Standard:
    why = unknown_to_rod(scene)
    return _of_model(task, scene, why) if why else _of_rod(rod_of_scene(scene))


def _of_rod(rod: SceneRod) -> _Standard:
    def posture(p: np.ndarray) -> tuple[np.ndarray, float]:
        found = rod.rest(p)
        rod.frequencies(found)  # raises where it is not stable
        again = rod.rest(p, COARSE_TOLERANCE)
        return found.section_tips, farthest(found.section_tips, again.section_tips)

    def modes(p: np.ndarray) -> tuple[np.ndarray, float]:
        found = rod.rest(p)
        return _compared(*(rod.frequencies(found, FREQUENCIES, *n) for n in ((), (COARSE_NODES,))))

    return _Standard(ROD, posture, modes)


def _of_model(task: Task, scene: Scene, why: str) -> _Standard:
    """Two models extrapolated to no segment length at all, as second order has it.

    The doubt is how far that is from the finer one.
    """
    most = min(MAX_SEGMENTS, FINER * segment_counts(task)[-1])
    if Chain(scene).beyond() is not None:
        most = min(most, MOST_WITH_LAWS)
    law = scene.formulation.elasticity
    fine = replace(
        scene, formulation=VirtualPower(GaussMass(3), law), kinematics=ConstantStrainArc()
    )
    models = [build(fine.with_(segments=n)) for n in (most, most // 2)]

    def posture(p: np.ndarray) -> tuple[np.ndarray, float]:
        fine, coarse = (_rest(model, p).tips for model in models)
        limit = fine + (fine - coarse) / 3
        return limit, farthest(limit, fine)

    def modes(p: np.ndarray) -> tuple[np.ndarray, float]:
        fine, coarse = (frequencies(model, _rest(model, p).q, p).real for model in models)
        return _compared(fine + (fine - coarse) / 3, fine)

    about = (
        f"models with {most // 2} and {most} segments a section and 3 Gauss points, extrapolated; "
        f"not independent of the others, because the rod does not know this: {why}"
    )
    return _Standard(about, posture, modes)


def _compared(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, float]:
    return one, float(np.abs(other / one - 1).max())


# --- references --------------------------------------------------------------------------------


def _rest(model: Model, p: np.ndarray) -> Equilibrium:
    """The rest; raises `SoftmpcError` where there is none that is stable."""
    found = find_equilibrium(model, p)
    if not found.stable:
        why = "is not stable" if found.converged else f"is not found: {found.status}"
        raise SoftmpcError(f"its rest {why}")
    return found


def _posture(given: Model, standard: _Standard, drawn: list[np.ndarray], what: str) -> Numbers:
    """The first of some pressures that all have a stable rest for."""
    refused: list[str] = []
    for p in drawn:
        try:
            own = _rest(given, p)
            if said := beyond_limits(given, own.q, p):
                raise SoftmpcError("; ".join(said))
            tips, doubt = standard.posture(p)
        except SoftmpcError as error:
            refused.append(str(error))
            continue
        numbers = {"pressures": p.tolist(), "tips": tips.tolist(), "given": own.tips.tolist()}
        return {**numbers, "doubt_m": doubt, "about": _about(standard, what, refused)}
    return {"about": f"left out: {'; '.join(dict.fromkeys(refused))}"}


def _about(standard: _Standard, what: str, refused: list[str]) -> str:
    if not refused:
        return f"{standard.about}; {what}"
    reasons = "; ".join(dict.fromkeys(refused))
    return f"{standard.about}; {what}, the {len(refused) + 1}th drawn, for before: {reasons}"


def _frequencies(standard: _Standard, p: np.ndarray) -> Numbers:
    try:
        found, doubt = standard.frequencies(p)
    except SoftmpcError as error:
        return {"about": f"left out: {error}"}
    numbers = {"pressures": p.tolist(), "frequencies": found.tolist(), "frequency_doubt": doubt}
    return {**numbers, "about": f"{standard.about}; its {len(found)} lowest frequencies"}


def _drawn(given: Model, index: int, attempt: int) -> np.ndarray:
    """Pressures (Pa) within the limits, the same whenever they are asked for."""
    limits = rest_limits(given)
    random = np.random.default_rng([SEED, index, attempt])
    return random.uniform(limits.low, limits.high)


def _end_pressures(task: Task, given: Model) -> np.ndarray:
    """Pressures (Pa) that the last inputs of the scene's motion hold at rest."""
    settings = read_settings(dict(task.document), given, Path(task.folder))
    u = np.asarray(settings.profile(np.array([settings.duration])))[0]
    return np.asarray(given.drive.C @ given.drive_rest(u) + given.drive.D @ u).ravel()
