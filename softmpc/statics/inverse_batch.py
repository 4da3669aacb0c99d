"""Inverse statics of many targets on any executor."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np

from softmpc.model.model import build
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import Equilibrium
from softmpc.statics.inverse import InverseStatics, Targets
from softmpc.statics.inverse_result import InverseResult
from softmpc.statics.rest_costs import RestCost
from softmpc.statics.targets import Target, as_targets
from softmpc.sweeps import sweep

__all__ = ["solve_many"]

ARRAYS = ("q", "pressures", "tips", "rotations")


def solve_many(
    inverse: InverseStatics,
    cases: Sequence[Targets],
    *,
    executor: Executor | int | None = None,
    path: bool = False,
    compare: int = 1,
    keep: str | os.PathLike[str] | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> list[InverseResult]:
    """The results of `inverse.solve` for each case, in their order, without their `solution`.

    With `path` each starts from the one before it; a path is cut into pieces for the workers.
    `executor`, `keep` and `progress` are those of `softmpc.sweeps.sweep`.
    """
    sections = len(inverse.model.scene.manipulator.sections)
    wanted = [as_targets(targets, sections) for targets in cases]
    held = tuple(sorted(inverse.program.limits.held.items()))
    work = _Solve(
        inverse.model.scene, inverse.cost, held, inverse.angle_length, inverse.starts, path, compare
    )
    found = sweep(work, wanted, executor=executor, keep=keep, progress=progress)
    return [_result(record, targets) for record, targets in zip(found, wanted, strict=True)]


@dataclass(frozen=True)
class _Solve:
    """What a worker does."""

    scene: Scene
    cost: RestCost
    held: tuple[tuple[int, float], ...]
    angle_length: float
    starts: int
    path: bool
    compare: int

    @cached_property
    def inverse(self) -> InverseStatics:
        return InverseStatics(
            build(self.scene), self.cost, dict(self.held), self.angle_length, self.starts
        )

    def begin(self) -> Callable[[tuple[Target, ...]], dict[str, Any]]:
        last: InverseResult | None = None

        def solve(targets: tuple[Target, ...]) -> dict[str, Any]:
            nonlocal last
            found = self.inverse.solve(targets, last, self.compare)
            last = found if self.path and found.solved else last
            return _record(found)

        return solve


def _record(result: InverseResult) -> dict[str, Any]:
    """A result as plain data."""
    left_out = ("targets", "posture", "solution")
    data = {f.name: getattr(result, f.name) for f in fields(result) if f.name not in left_out}
    posture = {f.name: getattr(result.posture, f.name) for f in fields(Equilibrium)}
    return {**data, "posture": posture}


def _result(record: dict[str, Any], targets: tuple[Target, ...]) -> InverseResult:
    posture = {k: np.array(v) if k in ARRAYS else v for k, v in record["posture"].items()}
    torques = record["torques"]
    given = {
        **record,
        "posture": Equilibrium(**posture),
        "torques": None if torques is None else np.array(torques),
        "active": tuple(record["active"]),
    }
    return InverseResult(targets=targets, **given)
