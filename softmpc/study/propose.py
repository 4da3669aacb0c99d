"""The cheapest scene that stays within a tolerance, found and proved by running it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from softmpc.errors import InputError, SoftmpcError
from softmpc.files import replacing
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.model.scene_file import OTHER_TABLES, scene_from_dict, scene_to_dict, write_document
from softmpc.study.ablate import Ablation, Baseline, Row
from softmpc.study.changes import ADDED, FINER, Change
from softmpc.study.measure import Cost, Errors

__all__ = ["Proposal", "propose", "write_proposal"]

WORTH = 0.98  # what saves less than 2 % of time or instructions, and no state, saves nothing
NOISE = 1.05  # two medians of equal times differ by less
Progress = Callable[[float, float], None]


@dataclass(frozen=True, eq=False)
class Proposal:
    """A cheaper scene, and what running it gave; `tried` has the worst error of each combination.

    Errors are those of the scene run by its own method and tolerance, so the error of the
    integration is in them.
    """

    scene: Scene
    tolerance_m: float
    changes: tuple[str, ...]
    undone: tuple[str, ...]  # within the tolerance, but they saved nothing beside the others
    tried: dict[str, float | None]  # change -> m, None where the combination could not run
    errors: Errors
    cost: Cost
    beside_s: float  # time of the scene as given, measured by turns with this one

    @property
    def within(self) -> bool:
        """Whether every section tip stayed within the tolerance."""
        return self.errors.worst <= self.tolerance_m

    @property
    def speed_factor(self) -> float:
        """How many times faster than the scene as given."""
        return self.beside_s / self.cost.wall_s

    def summary(self) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        return {
            "tolerance_m": self.tolerance_m,
            "within": self.within,
            "changes": list(self.changes),
            "undone": list(self.undone),
            "tried_m": self.tried,
            "max_errors_by_section_m": list(self.errors.largest),
            "rms_errors_by_section_m": list(self.errors.rms),
            **vars(self.cost),
            "beside_s": self.beside_s,
            "speed_factor": self.speed_factor,
        }


def propose(ablation: Ablation, tolerance_m: float, progress: Progress | None = None) -> Proposal:
    """The cheapest scene within `tolerance_m` (m) at every section tip over the whole motion.

    Changes that stay within it alone are combined in the order of what they save, each kept where
    the combination, run, stays within. Then those are undone that save nothing beside the others.
    The scene as given comes back where nothing helps; `within` is false where it is not itself
    integrated within the tolerance. Raises `KeyboardInterrupt` when interrupted.
    """
    if not tolerance_m > 0:
        raise InputError(f"tolerance = {tolerance_m!r} m: must be above 0")
    search = _Search(ablation.baseline, tolerance_m)
    base = ablation.baseline.cost
    candidates = sorted(_candidates(ablation, tolerance_m), key=lambda row: _order(row, base))
    for number, row in enumerate(candidates, 1):
        search.take(row.change)
        if progress:
            progress(number, len(candidates) + 1)
    undone = search.back_off()
    return _proved(ablation.baseline, search, undone, tolerance_m)


def write_proposal(
    proposal: Proposal, document: Mapping[str, Any], folder: Path, out: Path
) -> Path:
    """Write proposed.toml to `out`, with the title and the motion of the original `document`.

    A table of inputs, looked for in the `folder` of the original, is copied beside it.
    """
    tables = {key: document[key] for key in OTHER_TABLES if key in document}
    title = f"{document.get('title', 'scene')}, within {proposal.tolerance_m:g} m"
    inputs = tables.get("simulate", {}).get("table")
    if inputs is not None and (folder / inputs).resolve() != (out / inputs).resolve():
        name = Path(inputs).name
        with replacing(out / name) as beside:
            beside.write_bytes((folder / inputs).read_bytes())
        tables["simulate"] = tables["simulate"] | {"table": name}
    target = out / "proposed.toml"
    write_document({"title": title, **scene_to_dict(proposal.scene), **tables}, target)
    return target


def _candidates(ablation: Ablation, tolerance_m: float) -> list[Row]:
    """Rows that save something and stay within the tolerance."""
    base = ablation.baseline.cost
    return [
        row
        for row in ablation.rows
        if row.cost
        and row.errors
        and row.change.kind not in (FINER, ADDED)
        and row.errors.worst <= tolerance_m
        and _saves(row.cost, base, row.time_ratio)
    ]


def _order(row: Row, base: Cost) -> float:
    """What a row leaves of time and instructions; the smallest is tried first."""
    return row.time_ratio * row.cost.instructions / base.instructions if row.cost else 1.0


def _saves(cost: Cost, before: Cost, time_ratio: float) -> bool:
    """Whether a model saves time, instructions or states, and is larger or slower in none."""
    instructions = cost.instructions / before.instructions
    if instructions > 1 or cost.states > before.states or time_ratio > NOISE:
        return False
    return time_ratio <= WORTH or instructions <= WORTH or cost.states < before.states


class _Search:
    """Changes kept so far, and the model they make."""

    def __init__(self, baseline: Baseline, tolerance_m: float) -> None:
        self.baseline, self.tolerance_m = baseline, tolerance_m
        self.kept: list[Change] = []
        self.model = baseline.model
        self.tried: dict[str, float | None] = {}

    def take(self, change: Change) -> None:
        """Keep one more change if the combination stays within the tolerance."""
        if change.slot in [kept.slot for kept in self.kept]:
            return
        self.tried[change.name] = self._try([*self.kept, change])

    def back_off(self) -> tuple[str, ...]:
        """Undo changes that save nothing beside the others, the smallest savings first."""
        undone = []
        for change in reversed(self.kept.copy()):
            before, kept = self.model, self.kept
            fewer = [other for other in kept if other is not change]
            error = self._try(fewer)
            if error is None or error > self.tolerance_m:
                continue
            own, beside = self.baseline.runner.wall_s(before, self.model)
            if _saves(Cost.of(before, own), Cost.of(self.model, beside), own / beside):
                self.model, self.kept = before, kept
            else:
                undone.append(change.name)
        return tuple(undone)

    def _try(self, changes: list[Change]) -> float | None:
        """Worst error (m) of a combination, which is kept if that is within the tolerance."""
        try:
            scene = self.baseline.model.scene
            for change in changes:
                scene = change.apply(scene)
            model = build(scene)
            error = self._errors(model).worst
        except (SoftmpcError, RuntimeError):  # CasADi raises RuntimeError
            return None
        if error <= self.tolerance_m:
            self.kept, self.model = changes, model
        return error

    def _errors(self, model: Model) -> Errors:
        return Errors.between(self.baseline.runner.own(model), self.baseline.motion)


def _proved(
    baseline: Baseline, search: _Search, undone: tuple[str, ...], tolerance_m: float
) -> Proposal:
    """Build the scene anew from what its file will say, and run it."""
    scene = scene_from_dict(scene_to_dict(search.model.scene))
    model = build(scene)
    errors = Errors.between(baseline.runner.own(model), baseline.motion)
    wall_s, beside_s = baseline.runner.wall_s(model, baseline.model)
    changes = tuple(change.name for change in search.kept)
    cost = Cost.of(model, wall_s)
    return Proposal(scene, tolerance_m, changes, undone, search.tried, errors, cost, beside_s)
