"""softmpc: optimal control and MPC of fluid-driven soft manipulators on CasADi.

`Scene` says what exists, `build` makes the CasADi model of it. Everything else takes a model.
The names below are loaded when first used, so `import softmpc` itself is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

# Public name -> the module it lives in. Twice on purpose: type checkers read the imports below.
_HOME = {
    "Manipulator": "model.parameters",
    "Section": "model.parameters",
    "Hydraulics": "model.parameters",
    "Limits": "model.parameters",
    "chen2022": "model.presets",
    "Scene": "model.scene",
    "load_scene": "model.scene_file",
    "save_scene": "model.scene_file",
    "ConstantStrainArc": "model.kinematics",
    "PaperArc": "model.kinematics",
    "VirtualPower": "model.formulations",
    "NewtonEuler": "model.formulations",
    "GaussMass": "model.mass",
    "LumpedMass": "model.mass",
    "Gravity": "model.effects",
    "Inertia": "model.effects",
    "Coriolis": "model.effects",
    "RotaryInertia": "model.effects",
    "EnvironmentDamping": "model.effects",
    "MaterialDamping": "model.effects",
    "TipLoad": "model.effects",
    "HydraulicDrive": "model.actuation",
    "StaticDrive": "model.actuation",
    "PressureDrive": "model.actuation",
    "Model": "model.model",
    "build": "model.model",
    "Equilibrium": "statics.equilibrium",
    "find_equilibrium": "statics.equilibrium",
    "pressures_from_torques": "statics.equilibrium",
    "SoftmpcError": "errors",
    "InputError": "errors",
    "BuildError": "errors",
}

if TYPE_CHECKING:
    from softmpc.errors import BuildError, InputError, SoftmpcError
    from softmpc.model.actuation import HydraulicDrive, PressureDrive, StaticDrive
    from softmpc.model.effects import (
        Coriolis,
        EnvironmentDamping,
        Gravity,
        Inertia,
        MaterialDamping,
        RotaryInertia,
        TipLoad,
    )
    from softmpc.model.formulations import NewtonEuler, VirtualPower
    from softmpc.model.kinematics import ConstantStrainArc, PaperArc
    from softmpc.model.mass import GaussMass, LumpedMass
    from softmpc.model.model import Model, build
    from softmpc.model.parameters import Hydraulics, Limits, Manipulator, Section
    from softmpc.model.presets import chen2022
    from softmpc.model.scene import Scene
    from softmpc.model.scene_file import load_scene, save_scene
    from softmpc.statics.equilibrium import (
        Equilibrium,
        find_equilibrium,
        pressures_from_torques,
    )

__all__ = [
    "BuildError",
    "ConstantStrainArc",
    "Coriolis",
    "EnvironmentDamping",
    "Equilibrium",
    "GaussMass",
    "Gravity",
    "HydraulicDrive",
    "Hydraulics",
    "Inertia",
    "InputError",
    "Limits",
    "LumpedMass",
    "Manipulator",
    "MaterialDamping",
    "Model",
    "NewtonEuler",
    "PaperArc",
    "PressureDrive",
    "RotaryInertia",
    "Scene",
    "Section",
    "SoftmpcError",
    "StaticDrive",
    "TipLoad",
    "VirtualPower",
    "build",
    "chen2022",
    "find_equilibrium",
    "load_scene",
    "pressures_from_torques",
    "save_scene",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'softmpc' has no attribute {name!r}")
    value = getattr(import_module(f"softmpc.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
