"""How the paper's equations can be read, as scenes, and the runs that several rows share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from softmpc.errors import InputError
from softmpc.model.actuation import Actuation, FrictionDrive, HydraulicDrive, PressureDrive
from softmpc.model.effects import Coriolis, EnvironmentDamping, Gravity, Inertia, RotaryInertia
from softmpc.model.elasticity import PrintedElasticity, StrainElasticity
from softmpc.model.formulations import NewtonEuler
from softmpc.model.kinematics import PaperArc
from softmpc.model.model import Model, build
from softmpc.model.parameters import Hydraulics, Manipulator
from softmpc.model.scene import Scene
from softmpc.simulation.integrator import IntegrationError
from softmpc.simulation.result import Simulation
from softmpc.simulation.settings import SimulationSettings
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium, pressures_from_torques
from softmpc.statics.workspace import find_workspace
from softmpc.statics.workspace_result import Workspace
from softmpc.study.measure import motion_of
from softmpc.study.paper_motions import MOTIONS, SAMPLE_TIME, UNITS

__all__ = [
    "AS_PRINTED", "AS_READ", "FINE", "FINEST", "OURS", "PRINTED_EFFICIENCY", "READINGS",
    "PaperRuns", "screw_as_printed", "section_bends", "slowest_decay",
]  # fmt: skip

# Readings, in the order of the tables' columns.
AS_PRINTED, AS_READ, OURS = "as printed", "as read", "ours"
FINE, FINEST = "ours, 4 seg.", "ours, 8 seg."
READINGS = {
    AS_PRINTED: "the paper's formulation, damping (24) alone, with (17) in N·m as it is printed",
    AS_READ: "the same with (17) divided by the initial length, which makes it a force",
    OURS: "the default model: virtual power, an elastic law with an energy, one segment a section",
    FINE: "the default model with 4 segments a section",
    FINEST: "the default model with 8 segments a section",
}
SEGMENTS = {OURS: 1, FINE: 4, FINEST: 8}
PRINTED_EFFICIENCY = 0.9  # table 1: η
# The paper's terms: it has no viscosity of the wall, only the damping (24).
PAPER_EFFECTS = (Gravity(), Inertia(), Coriolis(), RotaryInertia(), EnvironmentDamping())


def screw_as_printed(hydraulics: Hydraulics) -> Hydraulics:
    """The drive with s = lead and η of table 1, as (33) is printed."""
    return replace(hydraulics, screw="lead", efficiency=PRINTED_EFFICIENCY)


@dataclass
class PaperRuns:
    """Models, rests and motions of one arm under each reading, each made once, when asked for.

    Raises `InputError` for an arm without the paper's two sections of three units.
    """

    arm: Manipulator
    _models: dict[Any, Model] = field(default_factory=dict)
    _workspaces: dict[str, Workspace] = field(default_factory=dict)
    _motions: dict[tuple[str, str], Simulation | str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if [section.units for section in self.arm.sections] != [3, 3]:
            raise InputError(
                f"the arm {self.arm.name!r} has sections of "
                f"{', '.join(str(s.units) for s in self.arm.sections)} units: the paper's motions "
                "need two sections of three units"
            )

    # --- models --------------------------------------------------------------------------------

    def model(self, reading: str) -> Model:
        """The whole arm, hanging, driven by torques."""
        return self._made(("whole", reading), lambda: self._scene(reading))

    def weightless(self, reading: str, sections: int) -> Model:
        """The first sections of the arm without effects, driven by pressures, for section 3.1."""

        def scene() -> Scene:
            arm = replace(self.arm, sections=self.arm.sections[:sections])
            whole = self._scene(reading)
            return whole.with_(manipulator=arm, effects=(), actuation=PressureDrive())

        return self._made(("weightless", reading, sections), scene)

    def _made(self, key: Any, scene: Any) -> Model:
        if key not in self._models:
            self._models[key] = build(scene())
        return self._models[key]

    def _scene(self, reading: str) -> Scene:
        drive: Actuation = FrictionDrive() if self.arm.hydraulics.friction else HydraulicDrive()
        if reading in SEGMENTS:
            return Scene(self.arm, segments=SEGMENTS[reading], actuation=drive)
        law = PrintedElasticity() if reading == AS_PRINTED else StrainElasticity()
        return Scene(
            self.arm,
            kinematics=PaperArc(),
            formulation=NewtonEuler(elasticity=law),
            effects=PAPER_EFFECTS,
            actuation=drive,
        )

    # --- runs ----------------------------------------------------------------------------------

    def rest(self, reading: str, torques: dict[int, float]) -> Equilibrium:
        """The hanging arm at rest under torques (N·m) on some units, by number."""
        model = self.model(reading)
        given = [torques.get(unit, 0.0) for unit in range(1, UNITS + 1)]
        return find_equilibrium(model, pressures_from_torques(model, given))

    def workspace(self, reading: str) -> Workspace:
        """Where the tip of one section without weight can be; only our shell has a fine grid."""
        if reading not in self._workspaces:
            model = self.weightless(reading, 1)
            self._workspaces[reading] = (
                find_workspace(model)
                if reading == OURS
                else find_workspace(model, azimuths=4, polars=5)
            )
        return self._workspaces[reading]

    def motion(self, figure: str, reading: str) -> Simulation | str:
        """The motion of a figure, or why there is none."""
        key = (figure, reading)
        if key not in self._motions:
            wanted = MOTIONS[figure]
            settings = SimulationSettings(wanted.profile, wanted.duration, SAMPLE_TIME)
            try:
                self._motions[key] = motion_of(self.model(reading), settings)
            except IntegrationError as error:
                self._motions[key] = str(error)
        return self._motions[key]

    def motions(self, figure: str, readings: Sequence[str]) -> dict[str, Simulation]:
        """Those of its motions that there are, by reading."""
        all_ = {reading: self.motion(figure, reading) for reading in readings}
        return {name: motion for name, motion in all_.items() if not isinstance(motion, str)}

    def failures(self, figure: str, readings: Sequence[str]) -> dict[str, str]:
        """Why there is no motion, by reading."""
        all_ = {reading: self.motion(figure, reading) for reading in readings}
        return {name: motion for name, motion in all_.items() if isinstance(motion, str)}


def section_bends(model: Model, rest: Equilibrium) -> tuple[float, ...]:
    """Bending angle (deg) of each section in the plane xz, positive towards +x."""
    scene = model.scene
    strains = rest.q.reshape(len(scene.manipulator.sections), scene.segments, len(scene.strains))
    lengths = np.array([s.length for s in scene.manipulator.sections]) / scene.segments
    angles = lengths[:, None] * (1 + strains[:, :, 0]) * strains[:, :, 2]
    return tuple((np.degrees(angles.sum(axis=1)) + 0.0).tolist())


def slowest_decay(model: Model, rest: Equilibrium) -> float:
    """Largest real part (1/s) of the eigenvalues of small motions of the arm about a rest.

    Positive where they grow, also at a rest that is stable for an arm without motion.
    """
    still = np.zeros(model.strains)
    by_q, by_dq, by_ddq, _ = (
        np.asarray(x) for x in model.residual_jacobian(rest.q, still, still, rest.pressures)
    )
    eye, zero = np.eye(model.strains), np.zeros((model.strains, model.strains))
    state = np.block([[zero, eye], [-by_q, -by_dq]])
    inertia = np.block([[eye, zero], [zero, by_ddq]])
    return float(np.linalg.eigvals(np.linalg.solve(inertia, state)).real.max())
