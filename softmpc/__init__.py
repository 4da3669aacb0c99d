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
    "find_equilibrium": "statics.equilibrium",
    "pressures_from_torques": "statics.equilibrium",
    "InverseStatics": "statics.inverse",
    "find_workspace": "statics.workspace",
    "simulate": "simulation.run",
    "simulate_file": "simulation.run",
    "compare": "simulation.compare",
    "tracking_problem": "control.ocp",
    "Mpc": "control.mpc",
    "track": "control.tracking",
    "track_file": "control.tracking",
    "SoftmpcError": "errors",
    "InputError": "errors",
    "BuildError": "errors",
}

if TYPE_CHECKING:
    from softmpc.control.mpc import Mpc
    from softmpc.control.ocp import tracking_problem
    from softmpc.control.tracking import track, track_file
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
    from softmpc.simulation.compare import compare
    from softmpc.simulation.run import simulate, simulate_file
    from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques
    from softmpc.statics.inverse import InverseStatics
    from softmpc.statics.workspace import find_workspace

__all__ = [
    "BuildError",
    "ConstantStrainArc",
    "Coriolis",
    "EnvironmentDamping",
    "GaussMass",
    "Gravity",
    "HydraulicDrive",
    "Hydraulics",
    "Inertia",
    "InputError",
    "InverseStatics",
    "Limits",
    "LumpedMass",
    "Manipulator",
    "MaterialDamping",
    "Model",
    "Mpc",
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
    "compare",
    "find_equilibrium",
    "find_workspace",
    "load_scene",
    "pressures_from_torques",
    "save_scene",
    "simulate",
    "simulate_file",
    "track",
    "track_file",
    "tracking_problem",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'softmpc' has no attribute {name!r}")
    value = getattr(import_module(f"softmpc.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
