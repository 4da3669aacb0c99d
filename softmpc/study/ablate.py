"""What each part of a scene changes and costs: the scene run without it, or with it coarser."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError, SceneError, SoftmpcError, errors_in
from softmpc.interrupts import InterruptLater
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.model.scene_file import read_document, scene_from_dict
from softmpc.simulation.integrator import IntegrationError
from softmpc.simulation.result import Simulation
from softmpc.simulation.settings import SimulationSettings, read_settings
from softmpc.study.changes import Change
from softmpc.study.measure import TIGHT, Cost, Errors, Runner, reason
from softmpc.study.variants import additions, variants

__all__ = ["Ablation", "Baseline", "Row", "ablate", "ablate_file", "read_study"]

Progress = Callable[[float, float], None]
STRAIGHT = 1e-6  # of the largest strain: a strain that stays below does not take part


@dataclass(frozen=True, eq=False)
class Row:
    """One change of the scene; without `errors` and `cost` where it could not be run."""

    change: Change
    status: str  # "finished", or why it could not be run
    errors: Errors | None = None
    cost: Cost | None = None
    beside_s: float = float("nan")  # time of the scene as given, measured by turns with this one

    @property
    def time_ratio(self) -> float:
        """Time over that of the scene as given."""
        return self.cost.wall_s / self.beside_s if self.cost else float("nan")

    def summary(self, reference: Cost) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        data: dict[str, Any] = {"change": self.change.name, "kind": self.change.kind}
        data |= {"slot": self.change.slot, "status": self.status}
        if self.errors is None or self.cost is None:
            return data
        return data | {
            "max_error_m": self.errors.largest[-1],
            "rms_error_m": self.errors.rms[-1],
            "max_errors_by_section_m": list(self.errors.largest),
            "rms_errors_by_section_m": list(self.errors.rms),
            **vars(self.cost),
            "beside_s": self.beside_s,
            "time_ratio": self.time_ratio,
            "instructions_ratio": self.cost.instructions / reference.instructions,
            "states_ratio": self.cost.states / reference.states,
        }


@dataclass(frozen=True, eq=False)
class Baseline:
    """The scene as given: its motion at a tight tolerance, and how exact that is."""

    model: Model
    runner: Runner
    motion: Simulation
    floor_m: float  # how much a ten times looser tolerance moves any section tip at most
    own_m: float  # how far the motion at the scene's own tolerance is from this one
    cost: Cost

    @classmethod
    def of(cls, scene: Scene, runner: Runner) -> Baseline:
        """Run the scene; raises what building and running it raises."""
        model = build(scene)
        try:
            motion = runner.tight(model)
        except IntegrationError as error:
            raise IntegrationError(
                f"nothing to compare, for the scene as given does not come to its end: {error}"
            ) from None
        looser = runner.tight(model, 10 * TIGHT)
        own = runner.own(model)
        wall_s, _ = runner.wall_s(model, model)
        floor = Errors.between(looser, motion).worst
        return cls(
            model, runner, motion, floor, Errors.between(own, motion).worst, Cost.of(model, wall_s)
        )

    def row(self, change: Change) -> Row:
        """Run one change; what cannot be built or run is a row with its reason."""
        try:
            scene = change.apply(self.model.scene)
            self._check_strains(scene)
            model = build(scene)
            self._check_start(model)
            errors = Errors.between(self.runner.tight(model), self.motion)
            wall_s, beside_s = self.runner.wall_s(model, self.model)
            return Row(change, "finished", errors, Cost.of(model, wall_s), beside_s)
        except (SoftmpcError, RuntimeError) as error:  # CasADi raises RuntimeError
            return Row(change, reason(error))

    def _check_start(self, model: Model) -> None:
        """Raise `SceneError` where the motion starts from a state that a model does not have."""
        given = not isinstance(self.runner.settings.start, str)
        if given and model.layout.x.names != self.model.layout.x.names:
            raise SceneError(
                "has other states than the one that the motion starts from; "
                'take start = "rest" to try it'
            )

    def _check_strains(self, scene: Scene) -> None:
        """Raise `SceneError` where a plane is left that the motion does not stay in."""
        gone = [s for s in self.model.scene.strains if s not in scene.strains]
        bends = [s for s in gone if s in ("kappa_x", "kappa_y")]
        strains = self.model.scene.strains
        by_kind = np.abs(self.motion.q.reshape(-1, len(strains))).max(axis=0)
        largest = dict(zip(strains, by_kind.tolist(), strict=True))
        most = max(largest.get("kappa_x", 0.0), largest.get("kappa_y", 0.0))
        for strain in bends:
            if largest[strain] > STRAIGHT * most:
                raise SceneError(
                    f"the motion is not planar: {strain} up to {largest[strain]:.3g} 1/m"
                )


@dataclass(frozen=True, eq=False)
class Ablation:
    """Rows of an ablation, as far as it came; `status` is "finished" or "interrupted"."""

    title: str
    status: str
    baseline: Baseline
    rows: tuple[Row, ...]

    def summary(self) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        base = self.baseline
        return {
            "title": self.title,
            "status": self.status,
            "duration_s": base.motion.duration_s,
            "method": base.runner.settings.method,
            "tip_tolerance_m": TIGHT,
            "numerical_floor_m": base.floor_m,
            "own_numerical_error_m": base.own_m,
            "repeats": base.runner.repeats,
            "as_given": vars(base.cost),
            "rows": [row.summary(base.cost) for row in self.rows],
        }

    def columns(self) -> dict[str, np.ndarray]:
        """The table, a column an array; what could not be run has None for numbers."""
        flat = [_flat(row.summary(self.baseline.cost)) for row in self.rows]
        names = dict.fromkeys(name for row in flat for name in row)
        return {name: np.array([row.get(name) for row in flat], object) for name in names}


def ablate(
    scene: Scene,
    settings: SimulationSettings,
    *,
    add: bool = False,
    repeats: int = 3,
    title: str = "",
    progress: Progress | None = None,
) -> Ablation:
    """Run every variant of the scene, with `add` also the effects it does not have.

    Times are medians of `repeats` runs. `progress(rows done, rows)`. Raises what building and
    running the scene as given raises; Ctrl-C before that is done is a `KeyboardInterrupt`, later
    it keeps the rows that are done.
    """
    if repeats < 1:
        raise InputError(f"repeats = {repeats!r}: must be at least 1")
    baseline = Baseline.of(scene, Runner(settings, repeats))
    changes = variants(scene) + (additions(scene) if add else [])
    rows: list[Row] = []
    status = "finished"
    try:
        with InterruptLater() as interrupt:  # Ctrl-C is no reason why a row could not be run
            for change in changes:
                rows.append(baseline.row(change))
                if progress:
                    progress(len(rows), len(changes))
                if interrupt.asked:
                    raise KeyboardInterrupt
    except KeyboardInterrupt:
        status = "interrupted"
    return Ablation(title, status, baseline, tuple(rows))


def ablate_file(
    path: str | os.PathLike[str], *, duration: float | None = None, **options: Any
) -> Ablation:
    """`ablate` of a scene file with the motion of its table [simulate]."""
    title, scene, settings = read_study(path, duration)
    return ablate(scene, settings, title=title, **options)


def read_study(
    path: str | os.PathLike[str], duration: float | None = None
) -> tuple[str, Scene, SimulationSettings]:
    """Title, scene and settings of a scene file, which must have a table [simulate]."""
    path = Path(path)
    document = read_document(path)
    with errors_in(path):
        if "simulate" not in document:
            raise SceneError("has no table [simulate]: a study needs a motion to run")
        scene = scene_from_dict(document)
        settings = read_settings(document, build(scene), path.parent)
    if duration is not None:
        settings = replace(settings, duration=duration)
    return document.get("title") or path.stem, scene, settings


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    """A list by section becomes one entry a section."""
    flat: dict[str, Any] = {}
    for name, value in row.items():
        if isinstance(value, list):
            flat |= {f"{name.replace('_by_section', '')}_{i}": v for i, v in enumerate(value, 1)}
        else:
            flat[name] = value
    return flat
