"""What the pressures in the units of a section do to each of its segments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca

from softmpc.model.elasticity import unit_stretch

if TYPE_CHECKING:
    from softmpc.model.parameters import Section

__all__ = ["chamber_volumes", "driving_force", "driving_moment"]


def driving_force(section: Section, pressures: Any) -> Any:
    """Force along the axis of a segment (N), positive where it stretches.

    Implements Eq. (20): A_d Σ_j P_j. `pressures`: one a unit, in Pa. Source: section 2.2.3.
    """
    return section.unit_area * ca.sum1(pressures)


def driving_moment(section: Section, pressures: Any) -> Any:
    """Moment on a segment (3, N·m).

    Implements Eq. (21): Σ_j r_j × [0, 0, A_d P_j]. Source: section 2.2.3.
    """
    area = section.unit_area
    mx: Any = sum(area * y * pressures[j] for j, (_, y) in enumerate(section.unit_positions))
    my: Any = sum(-area * x * pressures[j] for j, (x, _) in enumerate(section.unit_positions))
    return ca.vertcat(mx, my, 0.0)


def chamber_volumes(section: Section, rest: float, epsilon: Any, kappa: Any) -> list[Any]:
    """Volume of each unit of a segment of rest length `rest` (m³): A_d times its length.

    Its gradient times the pressure is the generalised force of (20) and (21): pressure work and
    the drive's work on the strains agree.
    """
    length = rest * (1 + epsilon)
    return [
        section.unit_area * length * unit_stretch(kappa, position)
        for position in section.unit_positions
    ]
