"""What inverse statics found for a target, and how good it is."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from softmpc.model.model import Model
from softmpc.statics.equilibrium import Equilibrium
from softmpc.statics.program import RestSolution
from softmpc.statics.rest_limits import torques_at_rest
from softmpc.statics.targets import Target

__all__ = [
    "NO_CONVERGENCE",
    "SOLVED",
    "UNREACHABLE",
    "InverseResult",
    "torque_band",
    "torques_within",
]

SOLVED, UNREACHABLE, NO_CONVERGENCE = "solved", "unreachable", "no convergence"


@dataclass(frozen=True, eq=False)
class InverseResult:
    """The posture that holds the targets, or the nearest one, SI.

    `status` is "solved"; "unreachable": this is the nearest posture found; or "no convergence":
    no start led to a solution, and this is a posture that some start had. `solution` is None then,
    and for an unreachable target near which the arm has unstable postures only.
    """

    status: str
    targets: tuple[Target, ...]
    posture: Equilibrium
    torques: np.ndarray | None  # N·m (m); None where pressures are the input
    torque_band: float  # N·m, within which Coulomb friction holds the same pressures; else 0
    distance: float  # m, largest of the targets with a place
    angle: float  # rad, largest of the targets with a direction or an orientation
    on_rest_branch: bool  # whether raising the pressures from the straight arm leads here
    active: tuple[str, ...]  # names of the limits that it is at
    cost: float  # of size one, see `RestCost`
    iterations: int  # of all starts
    starts: int
    seconds: float  # the first time with the making of the program
    solution: RestSolution | None = field(default=None, repr=False)

    @property
    def solved(self) -> bool:
        return self.status == SOLVED

    @property
    def q(self) -> np.ndarray:
        """Strains (n)."""
        return self.posture.q

    @property
    def pressures(self) -> np.ndarray:
        """Unit pressures (Pa, m), within the limits to the last bit."""
        return self.posture.pressures

    @property
    def tips(self) -> np.ndarray:
        """Section tips, base first (S×3, m)."""
        return self.posture.tips

    @property
    def stable(self) -> bool:
        return self.posture.stable

    @property
    def smallest_stiffness(self) -> float:
        """Smallest eigenvalue of the tangent stiffness in scaled strains, J."""
        return self.posture.smallest_stiffness


def torque_band(model: Model) -> float:
    """By how much a torque (N·m) may be off while Coulomb friction holds the pressure; 0 without.

    Friction f bears the pressure f/A_c, which takes this torque by the static gain.
    """
    if "friction" not in model.drive_nonlinear:
        return 0.0
    drive = model.scene.manipulator.hydraulics
    return float(drive.friction / drive.piston_area / model.drive.static_gain[0, 0])


def torques_within(model: Model, pressures: np.ndarray) -> np.ndarray | None:
    """Motor torques (N·m) that hold these pressures, within their limits to the last bit."""
    torques, limits = torques_at_rest(model, pressures), model.scene.manipulator.limits
    return None if torques is None else np.clip(torques, limits.torque_min, limits.torque_max)
