"""The two arcs against matrix exponentials, and their rates against differences."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from arms import Array, differences, numbers
from numpy.testing import assert_allclose
from scipy.linalg import expm

from softmpc.errors import InputError
from softmpc.model.jets import Jet
from softmpc.model.kinematics import Arc, ConstantStrainArc, PaperArc
from softmpc.model.parameters import Section
from softmpc.model.shape import shape_parameters
from softmpc.model.stumpff import slopes, stumpff, stumpff_jets

ARCS = (ConstantStrainArc(), PaperArc())
by_arc = pytest.mark.parametrize("arc", ARCS, ids=lambda arc: arc.name)
BENDS = {
    "straight": (0.0, 0.0, 0.0),
    "1e-300": (1e-300, -2e-300, 1e-300),
    "1e-12": (1e-12, 3e-12, -2e-12),
    "1e-4": (1e-4, -2e-4, 1e-4),
    "twist only": (0.0, 0.0, 2.0),
    "plane": (0.0, 1.2, 0.0),
    "generic": (-0.7, 0.4, 0.9),
    "near pi": (np.pi * 0.6, np.pi * 0.8 - 1e-9, 0.3),
    "pi": (np.pi, 0.0, 0.0),
    "near 2 pi": (0.0, 2 * np.pi + 1e-9, -0.5),
    "2 pi": (0.0, -2 * np.pi, 0.0),
    "beyond": (6.0, 7.0, 4.0),
}
by_bend = pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS.keys())
RATE = np.array((0.3, -1.1, 0.7))


@cache
def evaluator(arc: Arc) -> ca.Function:
    """(w, dw, f) -> everything the arc offers, p for length one."""
    w, dw, f = (ca.SX.sym(name, 3) for name in ("w", "dw", "f"))
    c = stumpff(arc.argument(w), 5)
    outputs = {
        "p": arc.shape(w, c),
        "columns": ca.horzcat(*arc.shape_columns(w, c, slopes(c))),
        "pull_p": arc.pull_position(w, c, slopes(c), f),
        "omega": arc.turn(w, dw, c),
        "pull_r": arc.pull_rotation(w, c, f),
        "R": arc.rotation(w, c),
        "t": arc.tangent(w, c),
    }
    dense = [ca.densify(x) for x in outputs.values()]
    return ca.Function("arc", [w, dw, f], dense, ["w", "dw", "f"], [*outputs])


def at(arc: Arc, w: Array, dw: Array = RATE, f: Array = RATE) -> dict[str, Array]:
    return {name: numbers(x) for name, x in evaluator(arc)(w=w, dw=dw, f=f).items()}


def skew(v: Array) -> Array:
    return np.array(((0, -v[2], v[1]), (v[2], 0, -v[0]), (-v[1], v[0], 0)))


def turned(w: Array) -> Array:
    return np.asarray(expm(skew(w)))


def reference(arc: Arc, w: Array) -> tuple[Array, Array]:
    """Pose by exponentials of se(3): one for the helix, bend and twist after for the paper."""
    bend = w if isinstance(arc, ConstantStrainArc) else np.array((w[0], w[1], 0.0))
    generator = np.zeros((4, 4))
    generator[:3, :3], generator[2, 3] = skew(bend), 1.0
    pose = expm(generator)
    after = turned(w - bend)
    return pose[:3, 3], pose[:3, :3] @ after


@by_arc
@by_bend
def test_pose_is_the_matrix_exponential(arc: Arc, bend: tuple[float, ...]) -> None:
    w = np.array(bend)
    found, (p, R) = at(arc, w), reference(arc, w)
    assert_allclose(found["p"], p, atol=2e-14)
    assert_allclose(found["R"], R, atol=2e-14)
    assert_allclose(found["t"], R[:, 2], atol=2e-14)
    assert_allclose(found["R"] @ found["R"].T, np.eye(3), atol=5e-15)


@pytest.mark.parametrize("bend", [(0.3, 0.2, -0.8), (0.0, 3.0, 1.0), (-2.0, -4.0, 0.5)])
def test_paper_arc_is_eq_3(bend: tuple[float, ...]) -> None:
    """R = Rz(φ) Ry(θ) Rz(τ - φ) and p, with the angles of Eq. (2)."""
    shape = shape_parameters(1.0, (0.0, *bend))
    c, s = np.cos, np.sin

    def about_z(a: float) -> Array:
        return np.array(((c(a), -s(a), 0), (s(a), c(a), 0), (0, 0, 1)))

    t, f = shape.theta, shape.phi
    about_y = np.array(((c(t), 0, s(t)), (0, 1, 0), (-s(t), 0, c(t))))
    found = at(PaperArc(), np.array(bend))
    assert_allclose(found["R"], about_z(f) @ about_y @ about_z(shape.tau - f), atol=1e-14)
    p = np.array((c(f) * (1 - c(t)), s(f) * (1 - c(t)), s(t))) / t
    assert_allclose(found["p"], p, atol=1e-14)


@by_arc
@by_bend
def test_angular_velocity_is_exact(arc: Arc, bend: tuple[float, ...]) -> None:
    """skew(ω) = Ṙ Rᵀ, not ẇ: (5)-(6) hold only while the axis stands still."""
    w = np.array(bend)
    step = np.array([0.006])
    rate = differences(lambda t: reference(arc, w + t[0] * RATE)[1], np.zeros(1), step)
    spin = rate[..., 0] @ at(arc, w)["R"].T
    assert_allclose(skew(at(arc, w)["omega"]), spin, atol=2e-13)


def test_rate_of_the_rotation_vector_is_not_the_angular_velocity() -> None:
    for arc in ARCS:
        found = at(arc, np.array((1.0, 0.5, 0.2)))
        assert np.abs(found["omega"] - RATE).max() > 0.1


@by_arc
@by_bend
def test_columns_and_pulls(arc: Arc, bend: tuple[float, ...]) -> None:
    """Columns equal differences, and both pulls are transposes: virtual power is conserved."""
    w, f = np.array(bend), np.array((0.4, -0.9, 1.3))
    found = at(arc, w, RATE, f)
    slope = differences(lambda x: reference(arc, x)[0], w, np.full(3, 0.006))
    assert_allclose(found["columns"], slope, atol=2e-13)
    assert_allclose(found["pull_p"], found["columns"].T @ f, atol=1e-14)
    turns = np.stack([at(arc, w, e)["omega"] for e in np.eye(3)], axis=1)
    assert_allclose(found["pull_r"], turns.T @ f, atol=2e-14)
    assert_allclose(found["omega"], turns @ RATE, atol=2e-14)


@pytest.mark.parametrize("bend", [(0.0, 0.0), (1e-9, 0.0), (0.8, -0.5), (0.0, 2 * np.pi), (4, 6)])
def test_arcs_agree_without_twist(bend: tuple[float, float]) -> None:
    """Pose, bending columns and ω for a planar rate; the twist columns differ, as they must."""
    w, rate = np.array((*bend, 0.0)), np.array((0.6, -1.1, 0.0))
    one, other = (at(arc, w, rate) for arc in ARCS)
    for name in ("p", "R", "t", "omega"):
        assert_allclose(one[name], other[name], atol=1e-14)
    assert_allclose(one["columns"][:, :2], other["columns"][:, :2], atol=1e-14)


@by_arc
def test_jets_of_the_position(arc: Arc) -> None:
    """The geometry on jets gives the velocity and acceleration of automatic differentiation."""
    t = ca.SX.sym("t")
    for start in BENDS.values():
        w = ca.DM(start) + t * ca.DM(RATE) + t**2 / 2 * ca.DM((0.5, 0.2, -0.4))
        terms = [w, ca.jacobian(w, t), ca.jacobian(ca.jacobian(w, t), t)]
        jet = Jet(*terms)
        s = arc.argument(jet)
        p = arc.shape(jet, stumpff_jets(stumpff(s.terms[0], 7), s))
        plain = arc.shape(w, stumpff(arc.argument(w), 3))
        for term in p.terms:
            found, wanted = (numbers(ca.Function("at", [t], [x])(0)) for x in (term, plain))
            assert_allclose(found, wanted, atol=1e-12)
            plain = ca.jacobian(plain, t)


# ------------------------------------------------------------------------ shape parameters (2)


@pytest.mark.parametrize("arc", ARCS, ids=lambda arc: arc.name)
def test_shape_parameters_describe_the_arc(arc: Arc) -> None:
    strains = np.array((0.2, -3.0, 4.0, 0.0))
    shape = shape_parameters(Section(), strains)
    assert shape.length == pytest.approx(0.3)
    assert shape.theta == pytest.approx(1.5)
    assert shape.phi == pytest.approx(np.arctan2(3.0, 4.0))
    assert shape.tau == 0.0
    p = at(arc, shape.length * strains[1:])["p"] * shape.length
    radius = shape.length / shape.theta
    out, up = radius * (1 - np.cos(shape.theta)), radius * np.sin(shape.theta)
    assert_allclose(p, (out * np.cos(shape.phi), out * np.sin(shape.phi), up), atol=1e-15)


def test_shape_parameters_of_the_straight_arm() -> None:
    assert shape_parameters(0.25, (0.1, 0.0, 0.0, 2.0)) == pytest.approx((0.275, 0.0, 0.0, 0.55))
    assert shape_parameters(0.25, (0.0, 0.0, -1.0, 0.0)).phi == pytest.approx(np.pi)


@pytest.mark.parametrize("strains", [(0.0, 1.0, 0.0), (-1.0, 0, 0, 0), (0.0, np.nan, 0, 0)])
def test_shape_parameters_refuse(strains: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match=r"must be four finite numbers .* ε above -1"):
        shape_parameters(0.25, strains)
