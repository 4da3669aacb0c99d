"""Newton-Euler with the full wrench transmitted, against sums over the arm in the base frame."""

from __future__ import annotations

import numpy as np
import pytest
from arms import MIXED, PAPER, Array, States, literal_section, model_of
from numpy.testing import assert_allclose
from oracles.paper_literal import LiteralArm

from softmpc.model.effects import (
    Coriolis,
    EnvironmentDamping,
    Gravity,
    Inertia,
    RotaryInertia,
    TipLoad,
)
from softmpc.model.formulations import FullNewtonEuler
from softmpc.model.kinematics import PaperArc
from softmpc.model.parameters import Manipulator

GRAVITY, FORCE, MOMENT = (1.0, -2.0, 9.0), (1.0, 2.0, -3.0), (0.1, -0.2, 0.05)
EFFECTS = (
    Gravity(GRAVITY),
    Inertia(),
    Coriolis(),
    RotaryInertia(),
    EnvironmentDamping(),
    TipLoad(FORCE, MOMENT),
)


def literal(manipulator: Manipulator, segments: int) -> LiteralArm:
    sections = [literal_section(s) for s in manipulator.sections]
    return LiteralArm(sections, segments, GRAVITY, FORCE, MOMENT)


def carried(arm: LiteralArm, q: Array, dq: Array, ddq: Array, j: int) -> tuple[Array, Array]:
    """Force and moment about the base's origin that segment j alone needs, in the base frame."""
    force, moment = np.zeros(3), np.zeros(3)
    for f, m in (arm.inertial_wrench(q, dq, ddq, j), arm.damping_wrench(q, dq, j)):
        force, moment = force + f, moment + m
    weight, (load, couple) = arm.weight(q, j), arm.tip_load(q, j)
    force = force - weight - load
    moment = moment - np.cross(arm.local_position(q, j), weight + load) - couple
    turn, start = arm.base_rotation(q, j - 1), arm.base_position(q, j - 1)
    return turn @ force, turn @ moment + np.cross(start, turn @ force)


def balance(arm: LiteralArm, q: Array, dq: Array, ddq: Array, p: Array) -> Array:
    """Rows of every segment: what all beyond its base need, less elasticity, plus drive."""
    parts = [carried(arm, q, dq, ddq, j) for j in range(1, arm.count + 1)]
    rows = []
    for i in range(1, arm.count + 1):
        force = sum(f for f, _ in parts[i - 1 :])
        moment = sum(m for _, m in parts[i - 1 :]) - np.cross(arm.base_position(q, i - 1), force)
        back = arm.base_rotation(q, i - 1).T
        force = back @ force + arm.elastic_force(q, i) - arm.driving_force(p, i)
        moment = back @ moment + arm.elastic_moment(q, i) - arm.driving_moment(p, i)
        rows += [force[2], *moment]
    return np.array(rows)


@pytest.mark.sampled
@pytest.mark.parametrize(("manipulator", "segments"), [(PAPER, 1), (PAPER, 3), (MIXED, 2)])
def test_against_sums_in_the_base_frame(manipulator: Manipulator, segments: int) -> None:
    model = model_of(
        manipulator,
        segments=segments,
        kinematics=PaperArc(),
        formulation=FullNewtonEuler(),
        effects=EFFECTS,
    )
    arm, states = literal(manipulator, segments), States(model, 5)
    for _ in range(5):
        q, dq, ddq, p = states.motion()
        q = q + 0.4 * model.layout.q.scale * np.sign(q)  # the oracle divides by the bending angle
        expected = balance(arm, q, dq, ddq, p)
        found = np.asarray(model.residual(q, dq, ddq, p)).ravel()
        assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_one_segment_is_the_printed_one() -> None:
    """With nothing beyond it, a segment has nothing handed back, in either way."""
    from softmpc.model.formulations import NewtonEuler

    single = Manipulator(name="one", sections=PAPER.sections[:1])
    full = model_of(single, formulation=FullNewtonEuler(), effects=EFFECTS)
    printed = model_of(single, formulation=NewtonEuler(), effects=EFFECTS)
    at = States(full, 1).motion()
    assert_allclose(np.asarray(full.residual(*at)), np.asarray(printed.residual(*at)), rtol=1e-12)
