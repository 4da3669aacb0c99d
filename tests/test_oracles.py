"""The oracles against each other, against published numbers and against an energy minimum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from oracles.closed_forms import (
    cantilever_axial_frequencies,
    cantilever_bending_frequencies,
    column_buckling_own_weight,
    column_buckling_tip_load,
    constant_strain_arc,
    drive_arc,
    elastica_own_weight,
    elastica_tip_load,
    hanging_chain_frequencies,
    rotation_matrix,
)
from scipy.linalg import expm
from scipy.optimize import minimize

from softmpc.accuracy.rod import RodError, RodSection, solve_rod

MPA = 1e6
NO_GRAVITY = (0.0, 0.0, 0.0)

BASE = RodSection(
    length=0.25,
    young_modulus=1.2e6,
    shear_modulus=0.4e6,
    bending_radius=0.029,
    unit_offset=0.0173,
    unit_area=3.14e-4,
    wall_area=3.93e-4,
    mass=0.55,
    unit_angles=tuple(np.deg2rad((0.0, 120.0, 240.0))),
)
DISTAL = replace(BASE, unit_angles=tuple(np.deg2rad((180.0, 300.0, 60.0))))
SMALL = RodSection(
    length=0.15,
    young_modulus=1.5e6,
    shear_modulus=0.45e6,
    bending_radius=0.021,
    unit_offset=0.012,
    unit_area=2.0e-4,
    wall_area=3.0e-4,
    mass=0.2,
    unit_angles=tuple(np.deg2rad((10.0, 100.0, 190.0, 280.0))),
)
# L = EI = 1 and practically inextensible; one unit on the axis, so its pressure only pulls.
UNIT = RodSection(
    length=1.0,
    young_modulus=1.0,
    shear_modulus=1.0 / 3.0,
    bending_radius=(4.0 / np.pi) ** 0.25,
    unit_offset=0.0,
    unit_area=1.0,
    wall_area=1e12,
    mass=1.0,
    unit_angles=(0.0,),
)


@dataclass(frozen=True)
class Case:
    """Arm and load: pressures (Pa), gravity (m/s^2), dead tip force (N)."""

    sections: tuple[RodSection, ...]
    pressures: tuple[float, ...]
    gravity: tuple[float, float, float]
    tip_force: tuple[float, float, float]


# Numbers of EQUATIONS.md section 3 -----------------------------------------------------------


def test_rod_reproduces_the_published_reference() -> None:
    pressures = np.array((0.6, 0.0, 0.0, 0.0, 0.3, 0.3)) * MPA
    found = solve_rod((BASE, DISTAL), pressures)
    np.testing.assert_allclose(found.section_tips[0], (-0.111726, 0.0, 0.252278), atol=6e-7)
    np.testing.assert_allclose(found.tip, (-0.368840, 0.0, 0.361828), atol=6e-7)
    assert found.residual < 1e-9


def test_stiffness_of_a_section() -> None:
    bending = 1.2e6 * np.pi * 0.029**4 / 4
    np.testing.assert_allclose(BASE.stiffness, (bending, bending, 2.0 / 3.0 * bending))
    assert BASE.axial_stiffness == pytest.approx(3 * 1.2e6 * 3.93e-4)


# Closed forms against printed values ---------------------------------------------------------


@pytest.mark.parametrize(
    ("alpha", "shortening", "deflection"),
    [
        (0.25, 0.004118, 0.082746),
        (1.0, 0.056433, 0.301721),
        (5.0, 0.387628, 0.713792),
        (10.0, 0.554996, 0.810609),
    ],
)
def test_elastica_tip_load_table(alpha: float, shortening: float, deflection: float) -> None:
    tip = elastica_tip_load(alpha)
    assert 1.0 - tip.x == pytest.approx(shortening, abs=6e-7)
    assert tip.y == pytest.approx(deflection, abs=6e-7)


def test_elastica_small_loads_follow_beam_theory() -> None:
    tip = elastica_tip_load(1e-3)
    assert tip.y == pytest.approx(1e-3 / 3.0, rel=1e-6)
    assert 1.0 - tip.x == pytest.approx(1e-6 / 15.0, rel=1e-5)
    assert tip.angle == pytest.approx(1e-3 / 2.0, rel=1e-6)


@pytest.mark.parametrize(
    ("gamma", "deflection"), [(1.0, 0.123471), (5.0, 0.495905), (10.0, 0.7002)]
)
def test_elastica_own_weight_table(gamma: float, deflection: float) -> None:
    assert elastica_own_weight(gamma).y == pytest.approx(deflection, abs=6e-7)


def test_frequencies_and_buckling_loads() -> None:
    np.testing.assert_allclose(cantilever_bending_frequencies(2), (3.51602, 22.0345), rtol=2e-6)
    np.testing.assert_allclose(cantilever_axial_frequencies(2), (np.pi / 2, 3 * np.pi / 2))
    assert hanging_chain_frequencies(1)[0] == pytest.approx(1.20241, abs=5e-6)
    assert column_buckling_own_weight() == pytest.approx(7.837, abs=5e-4)
    assert column_buckling_tip_load() == pytest.approx(np.pi**2 / 4)


@pytest.mark.parametrize(
    "curvature", [(0.0, 0.0, 0.0), (1e-7, 0.0, 2e-7), (3.0, -4.0, 2.0), (0.0, 8.0, 0.0)]
)
def test_arc_equals_the_matrix_exponential(curvature: tuple[float, float, float]) -> None:
    length = 0.3
    x, y, z = curvature
    twist = np.array(
        [[0.0, -z, y, 0.0], [z, 0.0, -x, 0.0], [-y, x, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]]
    )
    pose = expm(length * twist)
    arc = constant_strain_arc(length, curvature)
    np.testing.assert_allclose(arc.rotation, pose[:3, :3], atol=1e-13)
    np.testing.assert_allclose(arc.position, pose[:3, 3], atol=1e-13)


# Rod against closed forms --------------------------------------------------------------------


@pytest.mark.parametrize("alpha", [0.25, 1.0, 5.0, 10.0])
def test_rod_equals_the_elastica(alpha: float) -> None:
    direction = np.array((0.6, 0.8, 0.0))
    found = solve_rod((UNIT,), (0.0,), NO_GRAVITY, tip_force=alpha * direction)
    tip = elastica_tip_load(alpha)
    np.testing.assert_allclose(found.tip, (*(tip.y * direction[:2]), tip.x), atol=1e-8)
    turn = rotation_matrix(tip.angle * np.cross((0.0, 0.0, 1.0), direction))
    np.testing.assert_allclose(found.tip_rotation, turn, atol=1e-8)


@pytest.mark.parametrize("gamma", [1.0, 5.0, 10.0])
def test_rod_equals_the_heavy_elastica(gamma: float) -> None:
    halves = (replace(UNIT, length=0.4, mass=0.4), replace(UNIT, length=0.6, mass=0.6))
    found = solve_rod(halves, (0.0, 0.0), gravity=(0.0, gamma, 0.0))
    tip = elastica_own_weight(gamma)
    np.testing.assert_allclose(found.tip, (0.0, tip.y, tip.x), atol=1e-7)


def test_full_circle_under_a_tip_moment() -> None:
    found = solve_rod((UNIT,), (0.0,), NO_GRAVITY, tip_moment=(0.0, 2.0 * np.pi, 0.0))
    np.testing.assert_allclose(found.tip, (0.0, 0.0, 0.0), atol=1e-7)
    np.testing.assert_allclose(found.tip_rotation, np.eye(3), atol=1e-7)


@pytest.mark.parametrize("moment", [(0.0, 2.0, 0.0), (-1.2, 0.9, 0.0), (0.0, 0.0, 1.5)])
def test_rod_under_a_tip_moment_is_an_arc(moment: tuple[float, float, float]) -> None:
    found = solve_rod((BASE,), (0.0,) * 3, NO_GRAVITY, tip_moment=moment)
    arc = drive_arc(BASE.length, 0.0, moment, BASE.axial_stiffness, BASE.stiffness)
    np.testing.assert_allclose(found.tip, arc.position, atol=1e-9)
    np.testing.assert_allclose(found.tip_rotation, arc.rotation, atol=1e-9)


def test_weightless_rod_under_pressure_is_a_chain_of_arcs() -> None:
    thrusts = 3.14e-4 * np.array((0.9e6, 0.2e6, 0.1e6))
    found = solve_rod((BASE, DISTAL), (0.9e6, 0.2e6, 0.1e6) * 2, NO_GRAVITY)
    position, rotation = np.zeros(3), np.eye(3)
    for section, tip in zip((BASE, DISTAL), found.section_tips, strict=True):
        units = np.array([(np.sin(a), -np.cos(a), 0.0) for a in section.unit_angles])
        moment = 0.0173 * thrusts @ units
        arc = drive_arc(0.25, thrusts.sum(), moment, 3 * 1.2e6 * 3.93e-4, section.stiffness)
        position, rotation = position + rotation @ arc.position, rotation @ arc.rotation
        np.testing.assert_allclose(tip, position, atol=1e-9)
    np.testing.assert_allclose(found.tip_rotation, rotation, atol=1e-9)


def test_hanging_rod_stretches_under_its_weight() -> None:
    found = solve_rod((BASE, BASE), (0.1e6,) * 6, tip_force=(0.0, 0.0, 2.0))
    weight = 0.55 * 9.81
    thrust = 3 * 3.14e-4 * 0.1e6
    pull = 2 * (thrust + 2.0) + (1.5 + 0.5) * weight
    expected = 0.5 + 0.25 * pull / BASE.axial_stiffness
    np.testing.assert_allclose(found.tip, (0.0, 0.0, expected), atol=1e-10)


@pytest.mark.parametrize("own_weight", [False, True])
def test_upright_rod_loses_uniqueness_at_the_buckling_load(own_weight: bool) -> None:
    critical = column_buckling_own_weight() if own_weight else column_buckling_tip_load()

    def response(load: float) -> float:
        down = (0.0, 0.0, -load)
        if own_weight:
            return bending_response(down, NO_GRAVITY)
        return bending_response(NO_GRAVITY, down)

    assert response(0.5 * critical) > 0.1
    assert abs(response(critical)) < 1e-3


def bending_response(
    gravity: tuple[float, float, float], force: tuple[float, float, float]
) -> float:
    found = solve_rod((UNIT,), (0.0,), gravity, tip_force=force)
    return float(found.moment_jacobian[0, 0])


def test_bathe_45_degree_bend() -> None:
    """Out-of-plane tip force 600 on a curved cantilever; tip displacement of its authors.

    Bathe and Bolourchi 1979: radius 100, square section 1 x 1, E = 1e7, G = E/2 (J = 1/6). One
    unit with a huge offset pushes with 1 N and gives the bend its curvature. Published values
    scatter by a few tenths (shear, torsion constant, coarse meshes).
    """
    bend = RodSection(
        length=25.0 * np.pi,
        young_modulus=1e7,
        shear_modulus=0.5e7,
        bending_radius=(1.0 / (3.0 * np.pi)) ** 0.25,
        unit_offset=1e7 / 12.0 / 100.0,
        unit_area=1.0,
        wall_area=1.0,
        mass=0.0,
        unit_angles=(np.pi,),
    )
    found = solve_rod((bend,), (1.0,), NO_GRAVITY, tip_force=(0.0, 600.0, 0.0))
    start = constant_strain_arc(bend.length, (0.0, 0.01, 0.0)).position
    np.testing.assert_allclose(found.tip - start, (-13.4, 53.4, -23.5), atol=0.25)


# Rod against a minimum of the energy ---------------------------------------------------------

Complex = NDArray[np.complex128]
CASES = {
    "hanging, out of plane": Case(
        (BASE, DISTAL), (0.6e6, 0.2e6, 0.0, 0.1e6, 0.5e6, 0.0), (0.0, 0.0, 9.81), NO_GRAVITY
    ),
    "three sizes, loaded": Case(
        (BASE, SMALL),
        (0.3e6, 0.0, 0.2e6, 0.1e6, 0.3e6, 0.0, 0.2e6),
        (1.0, -2.0, 9.0),
        (0.5, -1.0, -0.4),
    ),
    "upright": Case(
        (BASE, DISTAL), (0.05e6, 0.02e6, 0.0, 0.0, 0.05e6, 0.0), (0.0, 0.0, -9.81), NO_GRAVITY
    ),
}
POLYNOMIALS = 7
CELLS = 16


def rotate(turn: Complex, frames: Complex) -> Complex:
    """`frames @ exp(skew(turn))` for stacks (copies, 3) and (copies, 3, 3).

    Power series, so that complex steps pass through; good to 1e-12 for turns below 0.3 rad.
    """
    square = (turn * turn).sum(axis=1)[:, None, None]
    x, y, z = turn.T
    zero = np.zeros_like(x)
    skew = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    first = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))
    second = 0.5 - square / 24.0 * (1.0 - square / 30.0 * (1.0 - square / 56.0))
    return np.asarray(frames @ (np.eye(3) + first * skew + second * skew @ skew))


def strain_energy(section: RodSection, pressures: Sequence[float], strain: Complex) -> Complex:
    """U - W per undeformed length (J/m); `strain` (copies, 4) = (eps, k per deformed length)."""
    stretch, k = 1.0 + strain[:, 0], strain[:, 1:]
    energy = 0.5 * section.axial_stiffness * strain[:, 0] ** 2
    energy = energy + 0.5 * stretch * (section.stiffness * k**2).sum(axis=1)
    for pressure, angle in zip(pressures, section.unit_angles, strict=True):
        across = k[:, 0] * np.sin(angle) - k[:, 1] * np.cos(angle)
        length = stretch * (1.0 + section.unit_offset * across)
        energy = energy - pressure * section.unit_area * length
    return np.asarray(energy)


def walk_section(
    section: RodSection,
    pressures: Sequence[float],
    gravity: NDArray[np.float64],
    chain: list[Complex],
) -> Complex:
    """Potential energy (J); `chain` = [position, frames, coefficients], the first two moved on.

    Strains are Legendre series. Two Gauss points a cell: a fourth-order Magnus rotation, and
    positions from its value at three points by Simpson's rule.
    """
    position, frames, coefficients = chain
    h = section.length / CELLS
    energy = np.zeros(len(position), dtype=complex)
    offset = np.sqrt(3.0) / 6.0

    def strain(cell: float) -> Complex:
        basis = np.polynomial.legendre.legvander(2.0 * cell / CELLS - 1.0, POLYNOMIALS - 1)
        return np.asarray(coefficients @ basis.ravel())

    def turned(start: float, width: float) -> Complex:
        a, b = (strain(start + width * (0.5 + side * offset)) for side in (-1, 1))
        a, b = ((1.0 + s[:, :1]) * s[:, 1:] * h * width for s in (a, b))
        return rotate((a + b) / 2.0 + np.sqrt(3.0) / 12.0 * np.cross(a, b), frames)

    for cell in range(CELLS):
        middle, last = turned(cell, 0.5), turned(cell, 1.0)
        ends = [strain(cell + part) for part in (0.0, 0.5, 1.0)]
        tangents = [
            (1.0 + s[:, :1]) * f[:, :, 2] for s, f in zip(ends, (frames, middle, last), strict=True)
        ]
        for s, weight in zip(ends, (1.0, 4.0, 1.0), strict=True):
            energy = energy + h * weight / 6.0 * strain_energy(section, pressures, s)
        # mean position over the cell, exact for quadratic tangents
        mean = position + h * (tangents[0] + 2.0 * tangents[1]) / 6.0
        energy = energy - section.mass / CELLS * mean @ gravity
        position = position + h * (tangents[0] + 4.0 * tangents[1] + tangents[2]) / 6.0
        frames = last
    chain[:2] = [position, frames]
    return energy


def potential_energy(case: Case, strains: Complex) -> tuple[Complex, Complex]:
    """Energy (J) and tip (m) for a stack of coefficients (copies, sections, 4, POLYNOMIALS)."""
    copies = len(strains)
    chain = [
        np.zeros((copies, 3), dtype=complex),
        np.tile(np.eye(3, dtype=complex), (copies, 1, 1)),
    ]
    energy = np.zeros(copies, dtype=complex)
    rest = list(case.pressures)
    for index, section in enumerate(case.sections):
        chain[2:] = [strains[:, index]]
        pressures = [rest.pop(0) for _ in section.unit_angles]
        energy = energy + walk_section(section, pressures, np.array(case.gravity), chain)
    return energy - chain[0] @ np.array(case.tip_force), chain[0]


def minimise_energy(case: Case) -> NDArray[np.float64]:
    """Tip (m) at the energy minimum next to the straight arm; BFGS, complex-step gradient."""
    shape = (len(case.sections), 4, POLYNOMIALS)
    norms = 2.0 * np.arange(POLYNOMIALS) + 1.0
    scale = np.array(
        [
            np.sqrt(norms / (part.length * stiffness))
            for part in case.sections
            for stiffness in (part.axial_stiffness, *part.stiffness)
        ]
    ).reshape(shape)
    steps = 1e-30j * np.eye(scale.size)

    def value_and_slope(flat: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        stack = (flat + steps).reshape(-1, *shape) * scale
        energy, _ = potential_energy(case, stack)
        return float(energy[0].real), energy.imag / 1e-30

    start = np.zeros(scale.size)
    found = minimize(value_and_slope, start, jac=True, method="BFGS", options={"gtol": 1e-7})
    assert np.abs(found.jac).max() < 1e-6
    _, tip = potential_energy(case, found.x.reshape(1, *shape) * scale + 0j)
    return np.asarray(tip[0].real)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_rod_minimises_the_energy(case: Case) -> None:
    found = solve_rod(case.sections, case.pressures, case.gravity, case.tip_force)
    np.testing.assert_allclose(found.tip, minimise_energy(case), atol=1e-6)


# Behaviour -----------------------------------------------------------------------------------


def test_balance_of_the_whole_arm() -> None:
    """Base force is the weight plus the load; a base moment without weight is arm x force."""
    force = np.array((0.5, -1.0, 0.3))
    moment = np.array((0.05, 0.1, -0.08))
    pressures = (0.4e6, 0.1e6, 0.0, 0.0, 0.3e6, 0.1e6)
    light = solve_rod((BASE, DISTAL), pressures, NO_GRAVITY, force, moment)
    np.testing.assert_allclose(light.base_moment, moment + np.cross(light.tip, force), atol=1e-9)
    heavy = solve_rod((BASE, DISTAL), pressures, tip_force=force)
    np.testing.assert_allclose(heavy.base_force, force + np.array((0.0, 0.0, 10.791)))


def test_answer_depends_neither_on_steps_nor_on_how_a_section_is_cut() -> None:
    pressures = (0.5e6, 0.2e6, 0.0)
    coarse = solve_rod((BASE,), pressures, steps=1)
    third = replace(BASE, length=BASE.length / 3, mass=BASE.mass / 3)
    rest = replace(BASE, length=BASE.length * 2 / 3, mass=BASE.mass * 2 / 3)
    cut = solve_rod((third, rest), pressures * 2, steps=9)
    np.testing.assert_allclose(cut.tip, coarse.tip, atol=1e-9)
    np.testing.assert_allclose(cut.tip_rotation, coarse.tip_rotation, atol=1e-9)


def test_wrong_number_of_pressures_is_refused() -> None:
    with pytest.raises(ValueError, match="2 pressures for 3 units"):
        solve_rod((BASE,), (0.0, 0.0))


def test_load_that_crushes_the_arm_raises() -> None:
    with pytest.raises(RodError):
        solve_rod((BASE, DISTAL), (0.0,) * 6, tip_force=(0.0, 0.0, -2000.0))
