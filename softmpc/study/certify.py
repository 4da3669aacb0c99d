"""The accuracy note of a result: a finer model and the effects left out, run on parts of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softmpc.errors import InputError, SceneError, SoftmpcError
from softmpc.model.effects import EFFECTS, Effect
from softmpc.model.elasticity import PrintedElasticity
from softmpc.model.formulations import VirtualPower
from softmpc.model.mass import GaussMass
from softmpc.model.model import Model, build
from softmpc.model.scene import MAX_SEGMENTS, Scene
from softmpc.simulation.compare import TipPath, compare
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import start_state
from softmpc.simulation.settings import SimulationSettings
from softmpc.statics.equilibrium import Equilibrium
from softmpc.study.changes import adding
from softmpc.study.lengths import length_text
from softmpc.study.measure import PATIENCE, TIGHT, motion_of
from softmpc.study.rests import end_rest, farthest, rest_again, stays_unstable
from softmpc.study.windows import Window, choose_windows, divided, later, mapped_state

__all__ = ["Certificate", "Finding", "certify", "finer_scene"]

Progress = Callable[[float, float], None]
WINDOW = 1.0  # s
SEEN = 10.0  # times the numerical error: an effect below does not show
ENOUGH = 2 * PATIENCE  # s after which no other effect is begun
UNSTABLE = (
    "the arm stays at an unstable rest, which the least disturbance would leave and every model "
    "keeps: that they agree means nothing"
)


@dataclass(frozen=True)
class Finding:
    """How far section tips are from those of the motion; None where that could not be run."""

    name: str
    windows_m: tuple[float | None, ...]  # largest of all sections, by window
    end_m: float | None  # both at rest under the inputs at the end, where the motion came to rest
    reasons: tuple[str, ...] = ()  # what could not be run, and why

    @property
    def worst_m(self) -> float | None:
        """The largest of all, None where nothing could be run."""
        values = [value for value in (*self.windows_m, self.end_m) if value is not None]
        return max(values, default=None)


@dataclass(frozen=True)
class Certificate:
    """What a result leaves open: its numerical error, its model error, effects left out."""

    windows: tuple[Window, ...]
    numerical: Finding
    model: Finding  # the finer scene
    left_out: tuple[Finding, ...]  # those that could be run, the largest first
    skipped: dict[str, str]  # the others, with the reason
    notes: tuple[str, ...] = ()  # what the numbers do not cover

    @property
    def text(self) -> str:
        """One line for people."""
        if not self.windows and self.notes:
            return f"unknown: {self.notes[0]}"
        floor = SEEN * max(self.numerical.worst_m or 0.0, TIGHT)
        seen = [f for f in self.left_out if f.worst_m is not None and f.worst_m > floor]
        names = ", ".join(f"{f.name.replace('_', ' ')} {_length(f)}" for f in seen)
        error = f"model error {_length(self.model)}, numerical {_length(self.numerical)}"
        none = "nothing that shows" if self.left_out else "nothing could be run"
        return f"{error}; left out: {names or none}"

    def summary(self) -> dict[str, Any]:
        """What a program wants to know, ready for JSON."""
        return {
            "text": self.text,
            "windows_s": [[w.start, w.end] for w in self.windows],
            "numerical_error_m": self.numerical.worst_m,
            "model_error_m": self.model.worst_m,
            "left_out_m": {f.name: f.worst_m for f in self.left_out},
            "skipped": self.skipped,
            "notes": list(self.notes),
            "findings": [
                {**vars(f), "worst_m": f.worst_m}
                for f in (self.numerical, self.model, *self.left_out)
            ],
        }


def certify(
    model: Model,
    motion: Simulation,
    settings: SimulationSettings,
    *,
    window: float = WINDOW,
    windows: int = 1,
    progress: Progress | None = None,
) -> Certificate:
    """Run windows of a motion again: tighter, with a finer model, with each effect left out.

    `settings` are those the motion was made with. Each window (s) begins at the motion's own state,
    so what builds up before it is not seen; a motion no longer than a window is run whole, from the
    start of each model. Of a motion that stopped, the last window is the one before the stop. Where
    the motion came to rest, the postures at rest are compared as well. A run that takes longer than
    a minute is given up, and after two minutes no other effect is begun. Nothing is run where the
    arm stays at an unstable rest: `notes` say so, and what else the numbers do not cover.
    """
    if not window > 0 or windows < 1:
        raise InputError(
            f"window = {window!r} s, windows = {windows!r}: must be above 0, at least 1"
        )
    if len(motion.time) < 2 and not motion.finished:
        return _nothing(model.scene, f"there is no motion to run again: {motion.status}")
    if len(motion.time) < 2:
        raise InputError("a motion of one sample has nothing to certify")
    if stays_unstable(model, motion):
        return _nothing(model.scene, UNSTABLE)
    began = time.perf_counter()
    chosen = choose_windows(motion, window, windows, to_the_end=not motion.finished)
    again = _Again(model, motion, settings, chosen)
    scenes = {"numerical error": model.scene, "model error": finer_scene(model.scene)}
    added, skipped = _richer(model.scene)
    findings = []
    for number, (name, scene) in enumerate((scenes | added).items(), 1):
        if name in added and time.perf_counter() - began > ENOUGH:
            skipped[name] = f"not begun: all before it took more than {ENOUGH:g} s"
        else:
            findings.append(again.finding(name, scene))
        if progress:
            progress(number, len(scenes | added))
    ran = [f for f in findings[2:] if any(value is not None for value in f.windows_m)]
    skipped |= {f.name: "; ".join(f.reasons) for f in findings[2:] if f not in ran}
    ran.sort(key=lambda f: -(f.worst_m or 0.0))
    notes = tuple(_notes(motion)) + again.notes
    return Certificate(tuple(chosen), findings[0], findings[1], tuple(ran), skipped, notes)


def _richer(scene: Scene) -> tuple[dict[str, Scene], dict[str, str]]:
    """The scene with each effect it leaves out, and those that are not asked, with the reason."""
    scenes: dict[str, Scene] = {}
    skipped: dict[str, str] = {}
    for kind in _left_out(scene):
        before = [k.name for k in _left_out(scene) if k.name in kind.needs and not k.surroundings]
        if kind.surroundings:
            skipped[kind.name] = "says where the arm is or what it holds, which a scene decides"
        elif before:
            skipped[kind.name] = f"needs {before[0]}, which the scene leaves out: add that first"
        else:
            try:
                scenes[kind.name] = adding(scene, kind)
            except SoftmpcError as error:
                skipped[kind.name] = str(error)
    return scenes, skipped


def _left_out(scene: Scene) -> list[type[Effect]]:
    return [kind for kind in EFFECTS if scene.effect(kind) is None]


def _nothing(scene: Scene, why: str) -> Certificate:
    """The note where running models again would tell nothing."""
    numerical, finer = (
        Finding(f"{name} error", (), None, (why,)) for name in ("numerical", "model")
    )
    skipped = {kind.name: "nothing was run" for kind in _left_out(scene)}
    return Certificate((), numerical, finer, (), skipped, (why,))


def _notes(motion: Simulation) -> Iterator[str]:
    if not motion.finished:
        yield f"only what came before is covered: {motion.status}"
    if any(warning.kind == "unstable_start" for warning in motion.warnings):
        yield "the start is an unstable rest: how the arm leaves it is beyond these numbers"


def finer_scene(scene: Scene) -> Scene:
    """Twice the segments and one more Gauss point, by virtual power whatever the scene uses."""
    if 2 * scene.segments > MAX_SEGMENTS:
        raise SceneError(
            f"{scene.segments} segments a section: a finer model would have twice as many, "
            f"and {MAX_SEGMENTS} are the most"
        )
    own = scene.formulation
    mass = GaussMass(min(3, len(own.mass.quadrature()) + 1))
    if isinstance(own, VirtualPower) and not isinstance(own.elasticity, PrintedElasticity):
        return scene.with_(segments=2 * scene.segments, formulation=replace(own, mass=mass))
    return scene.with_(segments=2 * scene.segments, formulation=VirtualPower(mass))


class _Again:
    """Parts of one motion run with other scenes."""

    def __init__(
        self,
        model: Model,
        motion: Simulation,
        settings: SimulationSettings,
        windows: list[Window],
    ) -> None:
        self.model, self.motion, self.settings, self.windows = model, motion, settings, windows
        self.rest: Equilibrium | None = None
        self.notes: tuple[str, ...] = ()
        try:
            self.rest = end_rest(model, motion)
        except SoftmpcError as error:
            self.notes = (f"postures at rest are not compared: {error}",)

    def finding(self, name: str, scene: Scene) -> Finding:
        """Run the windows and the end posture; what fails is a reason."""
        reasons: list[str] = []

        def attempt(run: Callable[[], float]) -> float | None:
            try:
                return run()
            except (SoftmpcError, RuntimeError) as error:  # CasADi raises RuntimeError
                reasons.append(" ".join(str(error).split()))
                return None

        model = build(scene)
        windows = tuple(attempt(lambda w=w: self._window(model, w)) for w in self.windows)  # type: ignore[misc]
        rest = self.rest
        end = None if rest is None else attempt(lambda: self._end(model, rest))
        return Finding(name, windows, end, tuple(reasons))

    def _window(self, model: Model, window: Window) -> float:
        """Largest distance (m) of section tips in a window."""
        tips = self.motion.tips[window.first : window.last + 1]
        time = self.motion.time[window.first : window.last + 1] - window.start
        span, each = window.end - window.start, self.settings.sample_time
        profile = later(self.settings.profile, window.start)
        start: str | np.ndarray = self.settings.start
        if not (window.whole and isinstance(start, str)):
            rest = start_state(model, InputProfile.constant(profile(0.0).tolist()), "straight")
            start = mapped_state(self.motion.x[window.first], self.model, model, rest)
        again = motion_of(
            model,
            self.settings,
            profile=divided(profile, each, span),
            duration=span,
            start=start,
            method="radau",
            tolerance=None,
            step=None,
            tip_tolerance=TIGHT,
        )
        return float(compare(TipPath(time, tips), again).errors.max())

    def _end(self, model: Model, rest: Equilibrium) -> float:
        """Largest distance (m) of section tips at rest under the inputs at the end."""
        return farthest(rest_again(self.model, rest, model, self.motion.u[-1]).tips, rest.tips)


def _length(finding: Finding) -> str:
    return "unknown" if finding.worst_m is None else length_text(finding.worst_m)
