"""The reference rod of a scene, or why there is none."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from softmpc.accuracy.rod import TOLERANCE, RodSolution, solve_rod
from softmpc.accuracy.rod_modes import NODES, rod_frequencies
from softmpc.accuracy.rod_parts import Array, RodSection
from softmpc.errors import SceneError
from softmpc.model.drive_effects import DriveEffect
from softmpc.model.effects import (
    AddedMass,
    Buoyancy,
    Coriolis,
    EnvironmentDamping,
    FluidDrag,
    Gravity,
    Inertia,
    MaterialDamping,
    Payload,
    RotaryInertia,
    TipLoad,
)
from softmpc.model.elasticity import EnergyElasticity, StrainElasticity
from softmpc.model.parameters import Section
from softmpc.model.scene import STRAINS, Scene

__all__ = ["SceneRod", "rod_of_scene", "rod_section", "unknown_to_rod"]

KNOWN = (
    Gravity, Inertia, Coriolis, RotaryInertia, EnvironmentDamping, MaterialDamping, TipLoad,
    Buoyancy, FluidDrag, AddedMass, Payload, DriveEffect,
)  # fmt: skip
SHARED = ("length", "young_modulus", "shear_modulus", "bending_radius", "unit_offset", "unit_area",
          "wall_area", "mass", "unit_angles")  # fmt: skip


@dataclass(frozen=True, eq=False)
class SceneRod:
    """A rod with its loads: what a scene becomes with ever more segments.

    `tip_force` (N) has the weight of the payload, whose mass (kg) and radius (m) are beside it.
    """

    sections: tuple[RodSection, ...]
    gravity: Array
    tip_force: Array
    tip_moment: Array
    tip_mass: float
    tip_radius: float

    def rest(self, pressures: Iterable[float], tolerance: float = TOLERANCE) -> RodSolution:
        """The posture at unit pressures (Pa); raises `RodError` where there is none."""
        loads = (self.gravity, self.tip_force, self.tip_moment)
        return solve_rod(self.sections, pressures, *loads, tolerance=tolerance)

    def frequencies(self, found: RodSolution, count: int = 4, nodes: int = NODES) -> Array:
        """The lowest frequencies (rad/s) about a posture; raises `RodError` if it is not stable."""
        tip = (self.tip_mass, self.tip_radius)
        return rod_frequencies(self.sections, found, count, *tip, nodes)


def rod_section(section: Section) -> RodSection:
    """A section of a manipulator as one of the rod, without rotary inertia and without fluid."""
    return RodSection(**{name: getattr(section, name) for name in SHARED})


def unknown_to_rod(scene: Scene) -> str:
    """What the scene has at rest that the rod does not know; empty where it knows all."""
    law = scene.formulation.elasticity
    if not isinstance(law, EnergyElasticity | StrainElasticity):
        return f"the elasticity {law.name!r} depends on the number of segments"
    if missing := [name for name in STRAINS if name not in scene.strains]:
        return f"the scene leaves out the strain {', '.join(missing)}"
    others = [effect.name for effect in scene.effects if not isinstance(effect, KNOWN)]
    return f"the scene has the effect {', '.join(others)}" if others else ""


def rod_of_scene(scene: Scene) -> SceneRod:
    """The rod of a scene; raises `SceneError` where `unknown_to_rod` has a reason."""
    if why := unknown_to_rod(scene):
        raise SceneError(f"the reference rod does not know this: {why}")
    gravity = scene.effect(Gravity)
    down = np.array(gravity.vector if gravity else (0.0, 0.0, 0.0))
    load, payload = scene.effect(TipLoad) or TipLoad(), scene.effect(Payload)
    mass = payload.mass if payload else 0.0
    turning = payload is not None and scene.effect(RotaryInertia) is not None
    return SceneRod(
        sections=tuple(_in_scene(section, scene) for section in scene.manipulator.sections),
        gravity=down,
        tip_force=np.array(load.force) + mass * down,
        tip_moment=np.array(load.moment),
        tip_mass=mass,
        tip_radius=payload.radius if payload and turning else 0.0,
    )


def _in_scene(section: Section, scene: Scene) -> RodSection:
    """A section with what the scene's effects bring."""
    buoyancy, water = scene.effect(Buoyancy), scene.effect(AddedMass)
    walls = section.units * (section.wall_area + section.unit_area) * section.length
    disc = np.pi * section.disc_radius**2 * section.length
    return replace(
        rod_section(section),
        disc_radius=section.disc_radius if scene.effect(RotaryInertia) else 0.0,
        displaced=buoyancy.density * walls if buoyancy else 0.0,
        added=water.density * water.coefficient * disc if water else 0.0,
        coupled=isinstance(scene.formulation.elasticity, EnergyElasticity),
    )
