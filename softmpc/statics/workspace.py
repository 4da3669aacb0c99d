"""How a workspace is found: samples, extremes, rims, radii, and all of it again from neighbours."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError
from softmpc.model.model import Model
from softmpc.statics.rest_limits import RestLimits, rest_limits
from softmpc.statics.workspace_edge import Edge, EdgeSearch
from softmpc.statics.workspace_frame import azimuths_for, flat_azimuth, frame_of
from softmpc.statics.workspace_limits import EXTENTS, QUANTITIES, Extreme
from softmpc.statics.workspace_rays import Place
from softmpc.statics.workspace_result import Workspace
from softmpc.statics.workspace_samples import Samples, SampleWork, box_samples, dimension_of
from softmpc.statics.workspace_shell import clenshaw_curtis
from softmpc.statics.workspace_work import SearchWork, extreme
from softmpc.sweeps import sweep

__all__ = ["find_workspace"]

AZIMUTHS, POLARS = 24, 13
SAMPLES = 2000
SAMPLE_SEED = 7
FEW = 40  # searches done sooner than processes start
Progress = Callable[[float, float], None]


def find_workspace(
    model: Model,
    *,
    section: int | None = None,
    held: Mapping[int, float] | None = None,
    azimuths: int = AZIMUTHS,
    polars: int = POLARS,
    samples: int = SAMPLES,
    executor: Any = None,
    progress: Progress | None = None,
    keep: str | os.PathLike[str] | None = None,
) -> Workspace:
    """Where the tip of a section (the last one) can be at rest within the limits of its scene.

    All units move but those `held` at a pressure (Pa; unit 1, 2, …). `azimuths` half-planes (even)
    have `polars` rays each (odd); `samples` postures are tried first, to start from. `executor`,
    `progress`: see `sweep`; the result depends on neither. `keep`: a folder for what is finished,
    to go on from. Raises `InputError` for a grid or a section that cannot be, and where no posture
    at all is stable and within the limits.
    """
    section = len(model.scene.manipulator.sections) if section is None else section
    _check(model, section, azimuths, polars, samples)
    finding = _Finding(
        model, section, dict(held or {}), azimuths, polars, samples, executor, progress, keep
    )
    return finding.workspace()


def _check(model: Model, section: int, azimuths: int, polars: int, samples: int) -> None:
    count = len(model.scene.manipulator.sections)
    if not 1 <= section <= count:
        raise InputError(f"section = {section}: this arm has the sections 1 to {count}")
    if azimuths < 4 or azimuths % 2:
        raise InputError(f"azimuths = {azimuths}: must be an even number from 4, such as 24")
    if polars < 5 or polars % 2 == 0:
        raise InputError(f"polars = {polars}: must be an odd number from 5, such as 13")
    if samples < 100:
        raise InputError(f"samples = {samples}: must be at least 100, such as {SAMPLES}")


@dataclass(eq=False)
class _Finding:
    """One workspace on its way; each step is a sweep."""

    model: Model
    section: int
    held: dict[int, float]
    many_azimuths: int
    many_polars: int
    many_samples: int
    executor: Any
    progress: Progress | None
    keep: str | os.PathLike[str] | None

    def workspace(self) -> Workspace:
        """All steps."""
        started = time.perf_counter()
        self.done = 0.0
        self.samples = self._sample()
        self.dimension = dimension_of(self.model, self.samples, self.limits, self.section)
        self.flat = flat_azimuth(self.samples.tips, self.model.scene.manipulator.length)
        self.frame = frame_of(self.samples.tips, self.flat)
        extremes = self._extremes()
        self.azimuths = azimuths_for(self.samples.tips, self.frame, self.many_azimuths)
        if self.flat is not None:
            self.azimuths = np.array([0.0, np.pi])
        self.nodes, _ = clenshaw_curtis(self.many_polars)
        has_shell = self.dimension == 3 or (self.dimension == 2 and self.flat is not None)
        edge = self._edge() if has_shell else Edge(np.full((len(self.azimuths), 2), np.nan))
        return Workspace(
            section=self.section, held=self.held, dimension=self.dimension, frame=self.frame,
            azimuths=self.azimuths, rims=edge.rims, nodes=self.nodes, outer=edge.outer,
            inner=edge.inner, extremes=extremes, samples=self.samples,
            wall_s=time.perf_counter() - started,
        )  # fmt: skip

    @cached_property
    def limits(self) -> RestLimits:
        """Bounds of the pressures, stuck units included."""
        return rest_limits(self.model, self.held)

    # --- steps ---------------------------------------------------------------------------------

    def _sweep(self, name: str, work: Any, cases: Sequence[Any], share: float) -> list[Any]:
        """A step; `share` is how much of the whole it is, about."""
        before = self.done

        def report(done: float, total: float) -> None:
            self.done = before + share * (done / total if total else 1.0)
            if self.progress:
                self.progress(round(100 * self.done), 100)

        kept = Path(self.keep) / f"{name}.jsonl" if self.keep else None
        few = len(cases) < FEW and not hasattr(self.executor, "submit")
        executor = 1 if few else self.executor
        return sweep(work, cases, executor=executor, keep=kept, progress=report)

    def _sample(self) -> Samples:
        pressures = box_samples(self.limits, self.many_samples, SAMPLE_SEED)
        work = SampleWork(self.model.scene, self.section)
        cases = np.array_split(pressures, max(len(pressures) // 100, 1))
        results = self._sweep("samples", work, [case.tolist() for case in cases], 0.08)
        samples = SampleWork.joined(results, self.model.scene)
        if not len(samples):
            raise InputError(
                f"none of {len(pressures)} postures that were tried is stable and within the "
                "limits of the scene: see `softmpc statics` for what one of them does"
            )
        return samples

    @cached_property
    def work(self) -> SearchWork:
        """The searches, from the samples."""
        held = tuple(sorted(self.held.items()))
        flat = self.flat is not None
        return SearchWork(self.model.scene, self.section, held, self.frame, flat, self.samples)

    def _extremes(self) -> tuple[Extreme, ...]:
        sections = range(1, len(self.model.scene.manipulator.sections) + 1)
        asked = [(axis, self.section) for axis in EXTENTS]
        asked += [(quantity, s) for s in sections for quantity in QUANTITIES]
        cases = [extreme(*one, sign) for one in asked for sign in (-1, 1)]
        results = self._sweep("extremes", self.work, cases, 0.06)
        return tuple(
            Extreme(
                case["quantity"], case["section"], "largest" if case["sense"] > 0 else "smallest",
                float("nan") if result["value"] is None else result["value"],
                Place.of(result["place"]),
            )
            for case, result in zip(cases, results, strict=True)
        )  # fmt: skip

    def _edge(self) -> Edge:
        search = EdgeSearch(
            run=lambda name, cases, share: self._sweep(name, self.work, cases, share),
            samples=self.samples, frame=self.frame, azimuths=self.azimuths, nodes=self.nodes,
            flat=self.flat is not None, length=self.model.scene.manipulator.length,
            limits=self.limits,
        )  # fmt: skip
        return search.edge()
