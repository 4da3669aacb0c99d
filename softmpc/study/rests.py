"""Where a motion came to rest, and where the same arm comes to rest by another model."""

from __future__ import annotations

import numpy as np

from softmpc.errors import SoftmpcError
from softmpc.model.model import Model
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import start_state
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium, refine_equilibrium
from softmpc.study.lengths import length_text
from softmpc.study.windows import mapped_state

__all__ = ["end_rest", "farthest", "rest_again", "stays_unstable"]

NEAR = 0.05  # of the way the tips went: as near to its rest as this a motion has come to it
SMALL = 1e-4  # m, the same for an arm that did not move


def end_rest(model: Model, motion: Simulation) -> Equilibrium:
    """The stable rest where a motion ended; raises `SoftmpcError` where it ended elsewhere.

    Sought from the last posture, not from the straight arm, which may lie on the other side of
    an obstacle.
    """
    if not motion.finished:
        raise SoftmpcError("the motion did not come to its end")
    rest = _near(model, motion)
    if not rest.converged:
        raise SoftmpcError(f"no rest found where the motion ended: {rest.status}")
    way = max(farthest(tips, motion.tips[0]) for tips in motion.tips)
    gap = farthest(rest.tips, motion.tips[-1])
    if gap > max(NEAR * way, SMALL):
        raise SoftmpcError(
            f"the motion did not end at rest: its tips are {length_text(gap)} from that"
        )
    if not rest.stable:
        raise SoftmpcError("the rest where the motion ended is not stable")
    return rest


def stays_unstable(model: Model, motion: Simulation) -> bool:
    """Whether the arm stays at a rest that the least disturbance would leave."""
    if max(farthest(tips, motion.tips[0]) for tips in motion.tips) > SMALL:
        return False
    rest = _near(model, motion)
    at_rest = rest.converged and farthest(rest.tips, motion.tips[-1]) <= SMALL
    return at_rest and not rest.stable


def rest_again(model: Model, rest: Equilibrium, other: Model, u: np.ndarray) -> Equilibrium:
    """The rest of `other` under inputs u (k) that is the one of `model`; raises `SoftmpcError`.

    Sought from that posture and from the straight arm: near an obstacle the posture may touch it
    elsewhere by the other model, and slip to its far side. The nearest one counts.
    """
    x = np.concatenate([rest.q, np.zeros(model.strains), model.drive_rest(u, rest.q)])
    straight = start_state(other, InputProfile.constant(u.tolist()), "straight")
    p = _pressures(other, u)
    guess = mapped_state(x, model, other, straight)[: other.strains]
    found = [refine_equilibrium(other, p, guess), find_equilibrium(other, p)]
    stable = [each for each in found if each.stable]
    if not stable:
        why = "not stable" if any(each.converged for each in found) else found[0].status
        raise SoftmpcError(f"no rest at the end: {why}")
    return min(stable, key=lambda each: farthest(each.tips, rest.tips))


def farthest(one: np.ndarray, other: np.ndarray) -> float:
    """Largest distance (m) of section tips (S×3)."""
    return float(np.linalg.norm(one - other, axis=1).max())


def _near(model: Model, motion: Simulation) -> Equilibrium:
    return refine_equilibrium(model, _pressures(model, motion.u[-1]), motion.q[-1])


def _pressures(model: Model, u: np.ndarray) -> np.ndarray:
    """Unit pressures (Pa) of the drive at rest."""
    return np.asarray(model.drive.C @ model.drive_rest(u) + model.drive.D @ u).ravel()
