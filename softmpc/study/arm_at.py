"""An arm at one set of parameters: its rests and motions, each found once.

An arm that differs little from a known one borrows from it what takes long to make: postures to
start from, tangent stiffnesses, and the Jacobian of the residual for the integrator's Newton
iterations. What they converge to is the arm's own; only the way there is shorter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from softmpc.errors import SoftmpcError
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.integrator import IntegrationError, Integrator
from softmpc.simulation.methods import integrator_for
from softmpc.simulation.run import start_state, states_at
from softmpc.statics.equilibrium import find_equilibrium

__all__ = ["ArmAt", "Motion"]

BORROWED = ("residual_jacobian", "drive_jacobian", "massless")
ROUNDS = 15  # of Newton iterations with a borrowed stiffness
SMALL, GOOD = 1e-13, 1e-10  # scaled residual: not better, and good enough
TIP_TOLERANCE = 1e-8  # m a step: its noise must not show in differences of motions
Without = tuple[str, ...]


@dataclass(frozen=True)
class Motion:
    """Section tips (K×S×3, m) and unit pressures (K×m, Pa) at times (K, s) under a profile."""

    time: np.ndarray
    tips: np.ndarray
    p: np.ndarray
    profile: InputProfile


class ArmAt:
    """The arm of a scene; `near` is one like it whose numbers differ little."""

    def __init__(self, scene: Scene, near: ArmAt | None = None) -> None:
        self.scene, self.near = scene, near
        self._models: dict[Without, Model] = {}
        self._rests: dict[Any, np.ndarray] = {}
        self._inverses: dict[Any, np.ndarray] = {}
        self._followed: set[Any] = set()  # rests that were found from the near arm's
        self._motions: dict[Any, Motion] = {}
        self._integrators: dict[Model, Integrator] = {}
        self._twins: dict[Without, Model] = {}

    def model(self, without: Without = ()) -> Model:
        """The model, some effects (by name) left out."""
        if without not in self._models:
            kept = tuple(e for e in self.scene.effects if e.name not in without)
            self._models[without] = build(self.scene.with_(effects=kept))
        return self._models[without]

    # --- at rest -------------------------------------------------------------------------------

    def rest(self, pressures: np.ndarray, without: Without = ()) -> np.ndarray:
        """Strains (n) at rest at unit pressures (Pa); raises `SoftmpcError` where there is none."""
        key = (pressures.tobytes(), without)
        if key not in self._rests:
            self._rests[key] = self._find_rest(pressures, without)
        return self._rests[key]

    def _find_rest(self, pressures: np.ndarray, without: Without) -> np.ndarray:
        model = self.model(without)
        if self.near is not None:
            q = self._from_near(self.near, model, pressures, without)
            if q is not None:
                self._followed.add((pressures.tobytes(), without))
                return q
        found = find_equilibrium(model, pressures)
        if not found.converged:
            raise SoftmpcError(f"no rest at {(pressures / 1e6).tolist()} MPa: {found.status}")
        return found.q

    @staticmethod
    def _from_near(
        near: ArmAt, model: Model, pressures: np.ndarray, without: Without
    ) -> np.ndarray | None:
        """Newton iterations with the stiffness of the other arm, from its posture."""
        q, inverse = near.rest(pressures, without), near.inverse(pressures, without)
        rows, before = model.layout.r.scale, np.inf
        moving = "residual" in model.__dict__  # it is there already, and the same at rest
        for _ in range(ROUNDS):
            balance = model.residual(q, 0, 0, pressures) if moving else model.balance(q, pressures)
            r = np.asarray(balance).ravel()
            size = np.abs(r / rows).max()
            if size < SMALL or (size < GOOD and size > before / 2):
                return q
            if not size < before:
                return None
            q, before = q - inverse @ r, size
        return None

    def inverse(self, pressures: np.ndarray, without: Without) -> np.ndarray:
        """Inverse of the tangent stiffness at rest (n×n), or the near arm's where that did."""
        key = (pressures.tobytes(), without)
        q = self.rest(pressures, without)
        if self.near is not None and key in self._followed:
            return self.near.inverse(pressures, without)
        if key not in self._inverses:
            K = np.asarray(self.model(without).stiffness(q, pressures)[0])
            self._inverses[key] = np.linalg.inv(K)
        return self._inverses[key]

    def tips(self, q: np.ndarray, without: Without = ()) -> np.ndarray:
        """Section tips (S×3, m)."""
        return np.asarray(self.model(without).frames(q)[0]).T

    # --- in motion -----------------------------------------------------------------------------

    def motion(
        self, key: Any, profile: InputProfile, times: np.ndarray, start: str, without: Without = ()
    ) -> Motion:
        """The motion from `start` at these times; the same `key`, the same motion.

        Raises `SoftmpcError` where it does not come to its end.
        """
        if key not in self._motions:
            self._motions[key] = self._move(profile, times, start, without)
        return self._motions[key]

    def _move(
        self, profile: InputProfile, times: np.ndarray, start: str, without: Without
    ) -> Motion:
        model = self.model(without)
        if self.near is not None:
            try:
                return self._run(self._borrowing(model, without), profile, times, start, without)
            except SoftmpcError:
                pass  # by itself, then
        return self._run(model, profile, times, start, without)

    def _borrowing(self, model: Model, without: Without) -> Model:
        """The same model with functions of the near arm's for the Newton iterations alone."""
        if without in self._twins:
            return self._twins[without]
        _ = model.residual  # wanted anyway, and its rest then needs no function of its own
        twin = Model(model.scene, model.chain, model.drive)
        twin.__dict__.update({k: v for k, v in model.__dict__.items() if k not in BORROWED})
        lender = self.near.lender(without) if self.near else model
        twin.__dict__.update({name: getattr(lender, name) for name in BORROWED})
        self._twins[without] = twin
        return twin

    def lender(self, without: Without) -> Model:
        """The model whose functions others borrow: the first of a row of near arms."""
        return self.near.lender(without) if self.near else self.model(without)

    def _run(
        self,
        model: Model,
        profile: InputProfile,
        times: np.ndarray,
        start: str,
        without: Without,
    ) -> Motion:
        x = self._start(model, profile, start, without)
        if model not in self._integrators:
            self._integrators[model] = integrator_for(model, tip_tolerance=TIP_TOLERANCE)
        integrator = self._integrators[model]
        status, reached, states = states_at(integrator, profile, x, times)
        if status == "interrupted":
            raise KeyboardInterrupt
        if status != "finished" or len(reached) < len(times):
            raise IntegrationError(status)
        n, drive = model.strains, model.drive
        q, z = states[:, :n], states[:, 2 * n :]
        tips = np.asarray(model.frames.map(len(times))(q.T)[0]).T.reshape(len(times), -1, 3)
        p = z @ drive.C.T + profile(times) @ drive.D.T
        return Motion(times, tips, p, profile)

    def _start(
        self, model: Model, profile: InputProfile, start: str, without: Without
    ) -> np.ndarray:
        if start != "rest":
            return start_state(model, profile, start)
        u = profile.before(0.0)
        z = model.drive_rest(u)
        q = self.rest(np.asarray(model.drive.C @ z + model.drive.D @ u).ravel(), without)
        return np.concatenate([q, np.zeros(model.strains), model.drive_rest(u, q)])
