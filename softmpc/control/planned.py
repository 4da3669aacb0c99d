"""A planned motion as a reference: tip, torque and state over time, read from its file.

The torque is constant between the plan's nodes. Before the plan it is what held the start, after
it what holds the end; the tip stays where the plan ends.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from softmpc.control.paths import Reference, TimeLaw, TipPath
from softmpc.errors import InputError, SceneError
from softmpc.files import reading_npz
from softmpc.model.model import Model

__all__ = ["PlannedMotion", "PlannedPath", "motion_of", "planned_reference", "read_planned"]

PLAN_SCHEMAS = (1,)
SAME_TIME = 1e-9  # s
ARRAYS = {  # of a plan.npz, with their shapes: K intervals, M samples, S sections
    "t": ("K+1",), "u": ("K", "k"), "x": ("K+1", "nx"), "u_before": ("k",), "u_after": ("k",),
    "samples_t": ("M",), "samples_tips": ("M", "S", 3), "samples_x": ("M", "nx"),
    "samples_p": ("M", "m"),
}  # fmt: skip

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class PlannedMotion:
    """A motion of K intervals with constant input, and M samples of its simulation; SI."""

    t: Array  # nodes from 0 on (K+1), s
    u: Array  # inputs (K×k), row i acts from t[i] to t[i+1]
    x: Array  # states at the nodes (K+1×nx)
    u_before: Array  # that held the start (k)
    u_after: Array  # that holds the end, or the last one (k)
    samples_t: Array  # (M), s
    samples_tips: Array  # section tips (M×S×3), m
    samples_x: Array  # states (M×nx)
    samples_p: Array  # unit pressures (M×m), Pa

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name, shape in ARRAYS.items():
            given = np.asarray(getattr(self, name), float)
            object.__setattr__(self, name, given)
            _check_shape(name, given.shape, shape, sizes)
            if not np.all(np.isfinite(given)):
                raise SceneError(f"{name} has {np.sum(~np.isfinite(given))} values not finite")
        for name in ("t", "samples_t"):
            times = getattr(self, name)
            if len(times) < 2 or abs(times[0]) > SAME_TIME or not np.all(np.diff(times) > 0):
                raise SceneError(f"{name}: must be two or more times that begin at 0 and increase")
        if abs(self.t[-1] - self.samples_t[-1]) > SAME_TIME:
            raise SceneError(
                f"samples_t ends at {self.samples_t[-1]:g} s and t at {self.t[-1]:g} s: must be one"
            )

    def check_fits(self, model: Model) -> None:
        """Raise `SceneError` where it is a plan of another arm than the model's."""
        layout, sections = model.layout, len(model.scene.manipulator.sections)
        for what, has, needs in (
            ("inputs", self.u.shape[1], len(layout.u)),
            ("sections", self.samples_tips.shape[1], sections),
            ("states", self.x.shape[1], len(layout.x)),
            ("unit pressures", self.samples_p.shape[1], len(layout.p)),
        ):
            if has != needs:
                raise SceneError(
                    f"the plan has {has} {what} and the arm of this scene {needs}: give the scene "
                    "that the plan was made with; scenes of their own for plant and controller are "
                    "keys of [track.plant] and [track.controller]"
                )

    @property
    def duration(self) -> float:
        """Until the end of the plan, s."""
        return float(self.t[-1])

    def tip(self, t: Array) -> Array:
        """Places of the tip (N×3) at times (N)."""
        return np.asarray(self._tip(np.clip(t, 0.0, self.samples_t[-1])))

    def mean_input(self, starts: Array, ends: Array) -> Array:
        """Mean inputs (N×k) over times from `starts` to `ends` (N)."""
        starts, ends = np.asarray(starts, float), np.asarray(ends, float)
        return (self._impulse(ends) - self._impulse(starts)) / (ends - starts)[:, None]

    def pressures(self, t: Array) -> Array:
        """Unit pressures (N×m) at times (N)."""
        return columns_at(t, self.samples_t, self.samples_p)

    @cached_property
    def _tip(self) -> Any:
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.samples_t, self.samples_tips[:, -1])

    def _impulse(self, t: Array) -> Array:
        """Integral of the inputs from 0 on (N×k), negative before."""
        done = np.vstack([0 * self.u[:1], np.cumsum(np.diff(self.t)[:, None] * self.u, axis=0)])
        before, after = np.minimum(t, 0.0), np.maximum(t - self.duration, 0.0)
        within = columns_at(t, self.t, done)
        return within + np.outer(before, self.u_before) + np.outer(after, self.u_after)


def columns_at(t: Array, times: Array, values: Array) -> Array:
    """Each column of the values (M×…) on lines between their times (M), at times (N)."""
    return np.stack([np.interp(t, times, column) for column in values.T], axis=1)


def _check_shape(
    name: str, given: tuple[int, ...], wanted: tuple[str | int, ...], sizes: dict[str, int]
) -> None:
    """Raise where a shape is another one, by sizes that earlier arrays have set."""
    shown = "×".join(map(str, wanted))
    if len(given) != len(wanted):
        raise SceneError(f"{name} has shape {given}: must be {shown}")
    for size, letter in zip(given, wanted, strict=True):
        if letter == "K+1":
            size, letter = size - 1, "K"
        expected = letter if isinstance(letter, int) else sizes.setdefault(letter, size)
        if size != expected:
            known = ", ".join(f"{a} = {b}" for a, b in sizes.items())
            raise SceneError(f"{name} has shape {given}: must be {shown}, with {known}")


def read_planned(path: str | os.PathLike[str]) -> PlannedMotion:
    """A plan.npz; raises `SceneError` for a file that is missing, broken or contradicts itself."""
    if not Path(path).is_file():
        raise SceneError(f"plan {path}: no such file; `softmpc plan SCENE --out FOLDER` makes one")
    try:
        with reading_npz(path, "plan", PLAN_SCHEMAS) as (_, arrays):
            return PlannedMotion(**{name: arrays[name] for name in ARRAYS})
    except SceneError as error:
        raise SceneError(f"plan {path}: {error}") from None
    except InputError as error:
        raise SceneError(str(error)) from None


@dataclass(frozen=True)
class PlannedPath(TipPath):
    """The tip of a planned motion; a phase of 1 is its end, where it stays."""

    name: ClassVar[str] = "plan"
    motion: PlannedMotion

    def position(self, phase: Array) -> Array:
        return self.motion.tip(np.asarray(phase) * self.motion.duration)


def planned_reference(motion: PlannedMotion, hold: float) -> Reference:
    """The planned tip as a reference, held for some more seconds at the end."""
    law = TimeLaw(motion.duration, 1.0 + hold / motion.duration, smooth_start=0.0)
    return Reference(PlannedPath(motion), law)


def motion_of(reference: Reference) -> PlannedMotion | None:
    """The planned motion that a reference is of, if any."""
    return reference.path.motion if isinstance(reference.path, PlannedPath) else None
