"""Where the arm is: places and orientations in the base frame, as expressions of a state."""

from __future__ import annotations

from typing import Any

import casadi as ca

from softmpc.model.chain import Chain, Link, State

__all__ = ["Poses", "centerline", "poses", "section_ends"]

Poses = list[tuple[Any, Any, Link]]  # place and orientation of each segment's base, tip last
STEPS = 10  # points a segment on the centre line


def poses(chain: Chain, state: State) -> Poses:
    """Place and orientation of each segment's base, and of the tip with the last link again."""
    place, rotation = ca.SX(3, 1), ca.SX.eye(3)
    found: Poses = []
    for link in chain.forward(state):
        found.append((place, rotation, link))
        place = place + rotation @ link.tip.p.terms[0]
        rotation = rotation @ link.tip.rotation
    found.append((place, rotation, found[-1][2]))
    return found


def section_ends(chain: Chain, state: State) -> tuple[list[Any], list[Any]]:
    """Places and orientations of the ends of the sections, base first."""
    ends = poses(chain, state)[chain.scene.segments :: chain.scene.segments]
    return [place for place, _, _ in ends], [rotation for _, rotation, _ in ends]


def centerline(chain: Chain, state: State) -> Any:
    """Points along the arm from base to tip (3×(10 a segment + 1))."""
    points = [ca.SX.zeros(3)]
    for place, rotation, link in poses(chain, state)[:-1]:
        for step in range(1, STEPS + 1):
            point = chain.point(link.segment, state, step / STEPS)
            points.append(place + rotation @ point.p.terms[0])
    return ca.horzcat(*points)
