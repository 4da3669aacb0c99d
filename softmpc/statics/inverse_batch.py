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
from softmpc.statics.program import RestSolution
from softmpc.statics.rest_costs import RestCost
from softmpc.statics.targets import Target, as_targets
from softmpc.sweeps import sweep

__all__ = ["solve_many"]


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
    """The results of `inverse.solve` for each case, in their order.

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
    parts: dict[str, Any] = {f.name: getattr(result, f.name) for f in fields(result)}
    del parts["targets"]
    for name in ("posture", "solution"):
        part = parts[name]
        parts[name] = part and {f.name: getattr(part, f.name) for f in fields(part)}
    return parts


def _result(record: dict[str, Any], targets: tuple[Target, ...]) -> InverseResult:
    torques = record["torques"]
    parts = {
        **record,
        "torques": None if torques is None else np.array(torques),
        "active": tuple(record["active"]),
        "posture": Equilibrium(**_arrays(record["posture"])),
        "solution": _solution(record["solution"]),
    }
    return InverseResult(targets=targets, **parts)


def _solution(record: dict[str, Any] | None) -> RestSolution | None:
    if record is None:
        return None
    x, lam_x, lam_g = (np.array(part) for part in record.pop("point"))
    return RestSolution(**_arrays(record), point=(x, lam_x, lam_g))


def _arrays(record: dict[str, Any]) -> dict[str, Any]:
    return {k: np.array(v, float) if isinstance(v, list) else v for k, v in record.items()}
