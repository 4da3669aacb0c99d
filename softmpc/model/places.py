"""Where the arm is: places and orientations in the base frame, as expressions of a state."""

from __future__ import annotations

from typing import Any

import casadi as ca

from softmpc.model.chain import Chain, Link, State

__all__ = ["Poses", "centerline", "points_along", "poses", "section_ends"]

Poses = list[tuple[Any, Any, Link]]  # place and orientation of each segment's base, tip last
STEPS = 10  # points a segment on the centre line
PLACES_ALONE = 3  # the highest Stumpff function that a place needs


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


def points_along(chain: Chain, state: State, count: int) -> list[Any]:
    """`count` places on the centre line of each section, section after section.

    Evenly spaced in the section's rest length, the last at its end.
    """
    found, segments = poses(chain, state), chain.scene.segments
    points = []
    for first in range(0, len(chain.segments), segments):
        for step in range(1, count + 1):
            over, rest = divmod(step * segments, count)
            place, rotation, link = found[first + over]
            if rest:  # else it is where a segment begins
                point = chain.point(link.segment, state, rest / count, PLACES_ALONE)
                place = place + rotation @ point.p.terms[0]
            points.append(place)
    return points
