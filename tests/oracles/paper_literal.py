"""Literal NumPy transcription of the paper's Eqs. (1)-(37): an oracle that shares no code.

Chen, Sun, Guo, Gong, Micromachines 2022, 13, 130. Every function cites its equation, "as read",
that is with the printed slips corrected. Sums are loops, derivatives are numerical: nothing here
comes from the toolkit, from a symbolic library, or from an identity the paper does not print.

Segments are numbered i = 1 ... S as in the paper, S = sections * segments. Segment i belongs to
section (i - 1) // segments, and owns q[4 (i - 1) : 4 i] = [eps, kx, ky, kz], Eq. (1).

    M(q) ddq + C(q, dq) dq + N(q) = tau(q, P)                                           (26)

has four rows a segment, in frame i - 1: the axial force Z-hat f, then the moments about o_{i-1}.
Signs: M and C positive; N = K q - gravity - what the next segment hands back; tau = +drive + load.

How N and tau share the hand-back. The next segment hands back elastic minus drive, Eq. (22).
N takes the elastic part, so N does not depend on the pressures; tau takes the drive part, so tau
holds the drive of segment i MINUS the drive of segment i + 1 turned into frame i - 1, and depends
on q through that rotation. Nothing is handed back to the last segment; it alone takes the tip
load (23), given in the base frame, entirely in tau. Only the axial force and the moment are
handed back, never the shear force: that is the paper's formulation.

Velocities and accelerations are those relative to the base, expressed in frame i - 1. Both are
differentiated in the base frame first and rotated afterwards, the linear and the angular ones
alike. The angular velocity is the paper's, the derivative of the rotation vector, (5)-(6).

Accuracy: first derivatives are complex steps (exact to rounding); second derivatives are an
eighth-order central difference of complex steps. Eq. (2) divides by the bending angle, so a
state with a segment straighter than SMALLEST_BEND is refused. Against 50-digit arithmetic the
first derivatives are within 1e-13 of their largest entry; the second derivatives, which only C
needs, within 1e-12 at bends above 0.1 rad and 1e-10 at the smallest bend.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

SMALLEST_BEND = 0.02  # rad: Eqs. (2)-(3) divide by theta
COMPLEX_STEP = 1e-30
# Eighth-order central difference: f'(0) = sum_m WEIGHT[m] f(OFFSET[m] h) / h.
OFFSETS = np.array([-4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0])
WEIGHTS = np.array([3.0, -32.0, 168.0, -672.0, 672.0, -168.0, 32.0, -3.0]) / 840.0

Z_HAT = np.array([0.0, 0.0, 1.0])
SELECTOR = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0]])  # g, Eq. (8)
GAMMA = np.array([0.0, 0.0, 0.0, 1.0])  # [X_i, 1] with X_i = 0, above Eq. (7)

Function = Callable[[np.ndarray], np.ndarray]


# ---------------------------------------------------------------- numerical differentiation


def jacobian(function: Function, q: np.ndarray) -> np.ndarray:
    """d function / d q by complex steps; the new index is the last. q may carry leading axes."""
    points = q[..., None, :] + 1j * COMPLEX_STEP * np.eye(q.shape[-1])
    return np.moveaxis(function(points).imag / COMPLEX_STEP, q.ndim - 1, -1)


def hessian(function: Function, q: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """d2 function / (d q_b d q_a), indices [..., b, a], central differences of the Jacobian."""
    columns = []
    for a, step in enumerate(steps):
        points = np.tile(q, (OFFSETS.size, 1))
        points[:, a] += OFFSETS * step
        columns.append(np.tensordot(WEIGHTS, jacobian(function, points), axes=1) / step)
    return np.stack(columns, axis=-1)


# ---------------------------------------------------------------- one segment: Eqs. (2)-(8)


class Shape(NamedTuple):
    """The shape parameters of Eq. (2), phi through its cosine and sine."""

    length: np.ndarray
    theta: np.ndarray
    cos_phi: np.ndarray
    sin_phi: np.ndarray
    tau: np.ndarray


def shape_parameters(q_i: np.ndarray, rest_length: float) -> Shape:
    """Eq. (2): phi = arctan2(-kx, ky), hence cos phi = ky / |k| and sin phi = -kx / |k|."""
    strain, kx, ky, kz = (q_i[..., k] for k in range(4))
    length = (1.0 + strain) * rest_length
    curvature = np.sqrt(kx**2 + ky**2)
    return Shape(length, length * curvature, ky / curvature, -kx / curvature, length * kz)


def matrix(rows: list[list[np.ndarray]]) -> np.ndarray:
    """Stack scalars (each of which may carry leading axes) into a matrix."""
    shape = np.broadcast_shapes(*(np.shape(entry) for row in rows for entry in row))
    return np.stack(
        [np.stack([np.broadcast_to(entry, shape) for entry in row], axis=-1) for row in rows],
        axis=-2,
    )


def rotation_z(cosine: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Rotation about z."""
    return matrix([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def rotation_y(cosine: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Rotation about y."""
    return matrix([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def segment_transform(q_i: np.ndarray, rest_length: float) -> np.ndarray:
    """^{i-1}H_i, Eqs. (3)-(4): R = Rz(phi) Ry(theta) Rz(tau - phi), p beside it."""
    length, theta, c_phi, s_phi, tau = shape_parameters(q_i, rest_length)
    c_theta, s_theta = np.cos(theta), np.sin(theta)
    c_tau, s_tau = np.cos(tau), np.sin(tau)
    rotation = (
        rotation_z(c_phi, s_phi)
        @ rotation_y(c_theta, s_theta)
        @ rotation_z(c_tau * c_phi + s_tau * s_phi, s_tau * c_phi - c_tau * s_phi)
    )
    radius = length / theta
    position = np.stack(
        [radius * c_phi * (1.0 - c_theta), radius * s_phi * (1.0 - c_theta), radius * s_theta],
        axis=-1,
    )
    transform = np.zeros((*q_i.shape[:-1], 4, 4), dtype=rotation.dtype)
    transform[..., :3, :3] = rotation
    transform[..., :3, 3] = position
    transform[..., 3, 3] = 1.0
    return transform


def rotation_vector(q_i: np.ndarray, rest_length: float) -> np.ndarray:
    """^{i-1}theta_i, Eq. (5)."""
    shape = shape_parameters(q_i, rest_length)
    return np.stack([-shape.theta * shape.sin_phi, shape.theta * shape.cos_phi, shape.tau], axis=-1)


def skew(vector: np.ndarray) -> np.ndarray:
    """The matrix of `vector` x."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


# ---------------------------------------------------------------- parameters


@dataclass(frozen=True)
class LiteralSection:
    """One section, SI units. Mass and damping are the whole section's, shared by its segments."""

    length: float  # l_0
    young_modulus: float  # E
    shear_modulus: float  # G
    bending_radius: float  # r_i of K_i, Eq. (19)
    disc_radius: float  # r_i of I_i, Eq. (16)
    unit_offset: float  # |r_d|, Eq. (21)
    unit_area: float  # A_d
    wall_area: float  # A_s
    mass: float
    unit_angles: tuple[float, ...]  # rad, the direction of r_d of each unit
    linear_damping: float  # d_v
    angular_damping: float  # d_omega

    def unit_positions(self) -> list[np.ndarray]:
        """r_{d,j}, below Eq. (21)."""
        return [self.unit_offset * np.array([np.cos(a), np.sin(a), 0.0]) for a in self.unit_angles]


class Terms(NamedTuple):
    """The four terms of Eq. (26)."""

    mass: np.ndarray  # M, 4S x 4S
    velocity: np.ndarray  # C, 4S x 4S
    position: np.ndarray  # N, 4S
    inputs: np.ndarray  # tau, 4S


# ---------------------------------------------------------------- the arm: Eqs. (1)-(31)


@dataclass(frozen=True)
class LiteralArm:
    """The arm of Eqs. (1)-(31). `segments` is n, the number of segments a section.

    `axial_law` is "strain" (E A_s sum_j (l_ij - l_i0) / l_i0) or "printed" (Eq. (17) undivided,
    a formula that depends on n and is allowed for one segment a section only).
    """

    sections: list[LiteralSection]
    segments: int = 1
    gravity: tuple[float, float, float] = (0.0, 0.0, 9.81)
    tip_force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tip_moment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axial_law: str = "strain"

    def __post_init__(self) -> None:
        """Refuse what the equations do not cover."""
        if self.axial_law not in ("strain", "printed"):
            raise ValueError(f"unknown axial law {self.axial_law!r}")
        if self.axial_law == "printed" and self.segments != 1:
            raise ValueError("Eq. (17) as printed holds for one segment a section only")

    # ---- indices

    @property
    def count(self) -> int:
        """S, the number of segments of the arm."""
        return len(self.sections) * self.segments

    def section(self, i: int) -> LiteralSection:
        """The section segment i belongs to."""
        return self.sections[(i - 1) // self.segments]

    def rest_length(self, i: int) -> float:
        """l_0 / n of segment i: its initial length l_i0."""
        return self.section(i).length / self.segments

    def mass(self, i: int) -> float:
        """m_i."""
        return self.section(i).mass / self.segments

    def linear_damping(self, i: int) -> float:
        """d_v of one segment."""
        return self.section(i).linear_damping / self.segments

    def angular_damping(self, i: int) -> float:
        """d_omega of one segment."""
        return self.section(i).angular_damping / self.segments

    def unit_pressures(self, pressures: np.ndarray, i: int) -> np.ndarray:
        """P_{i,j}: every segment of a section carries the pressures of the section's units."""
        number = (i - 1) // self.segments
        first = sum(len(section.unit_angles) for section in self.sections[:number])
        return np.asarray(pressures)[first : first + len(self.section(i).unit_angles)]

    def state(self, q: np.ndarray) -> np.ndarray:
        """Return q as floats, or refuse it: wrong size, collapsed, or too straight for Eq. (2)."""
        q = np.asarray(q, dtype=float)
        if q.shape != (4 * self.count,):
            raise ValueError(f"q must have shape ({4 * self.count},), not {q.shape}")
        for i in range(1, self.count + 1):
            strain, kx, ky, _ = block(q, i)
            length = (1.0 + strain) * self.rest_length(i)
            bend = length * np.hypot(kx, ky)
            if not (length > 0.0 and bend >= SMALLEST_BEND):
                raise ValueError(f"segment {i} has length {length} m and bend {bend} rad")
        return q

    def steps(self, q: np.ndarray) -> np.ndarray:
        """Steps of the second differences, short enough to stay clear of theta = 0."""
        steps = []
        for i in range(1, self.count + 1):
            shape = shape_parameters(block(q, i), self.rest_length(i))
            curvature_step = min(0.01, shape.theta / 8.0) / shape.length
            steps += [0.005, curvature_step, curvature_step, 0.01 / shape.length]
        return np.array(steps)

    # ---- kinematics, Eqs. (1)-(12). These take q with leading axes, real or complex.

    def local_transform(self, q: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}H_i, Eq. (3)."""
        return segment_transform(block(q, i), self.rest_length(i))

    def base_transform(self, q: np.ndarray, i: int) -> np.ndarray:
        """^0H_i = ^0H_1 ^1H_2 ... ^{i-1}H_i; the identity for i = 0."""
        transform = np.broadcast_to(np.eye(4), (*q.shape[:-1], 4, 4))
        for zeta in range(1, i + 1):
            transform = transform @ self.local_transform(q, zeta)
        return transform

    def base_rotation(self, q: np.ndarray, i: int) -> np.ndarray:
        """^0R_i."""
        return self.base_transform(q, i)[..., :3, :3]

    def base_position(self, q: np.ndarray, i: int) -> np.ndarray:
        """^0X_i, Eq. (7) carried on to the base: g ^0H_i gamma."""
        return (SELECTOR @ self.base_transform(q, i)) @ GAMMA

    def local_position(self, q: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}X_i, Eqs. (7)-(8): g ^{i-1}H_i gamma."""
        return (SELECTOR @ self.local_transform(q, i)) @ GAMMA

    def local_rotation(self, q: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}R_i."""
        return self.local_transform(q, i)[..., :3, :3]

    def angle(self, q: np.ndarray, zeta: int) -> np.ndarray:
        """^{zeta-1}theta_zeta, Eq. (5)."""
        return rotation_vector(block(q, zeta), self.rest_length(zeta))

    def section_tips(self, q: np.ndarray) -> np.ndarray:
        """psi_i of Eq. (37): the base-frame position of the end of each section."""
        q = np.asarray(q, dtype=float)
        ends = range(self.segments, self.count + 1, self.segments)
        return np.stack([self.base_position(q, i) for i in ends], axis=-2)

    def position_jacobian(self, q: np.ndarray, i: int) -> np.ndarray:
        """J_i, Eq. (9): (^0R_{i-1})^T d ^0X_i / dq, for the velocity relative to the base."""
        return self.base_rotation(q, i - 1).T @ jacobian(lambda s: self.base_position(s, i), q)

    def position_hessian(self, q: np.ndarray, i: int) -> np.ndarray:
        """(^0R_{i-1})^T d2 ^0X_i / (dq dq), the second derivative in Eq. (12)."""
        second = hessian(lambda s: self.base_position(s, i), q, self.steps(q))
        return np.tensordot(self.base_rotation(q, i - 1).T, second, axes=1)

    def position_jacobian_rate(self, q: np.ndarray, dq: np.ndarray, i: int) -> np.ndarray:
        """dJ_i/dt of Eqs. (12) and (28): sum over alpha, beta of d2X/(dq dq_ab) dq_ab."""
        second = self.position_hessian(q, i)
        rate = np.zeros((3, q.size))
        for alpha in range(1, i + 1):
            for beta in range(1, 5):
                rate += second[:, :, index(alpha, beta)] * dq[index(alpha, beta)]
        return rate

    def velocity(self, q: np.ndarray, dq: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}v_i, Eqs. (10)-(11): relative to the base, expressed in frame i - 1."""
        first = self.position_jacobian(q, i)
        result = np.zeros(3)
        for zeta in range(1, i + 1):
            for chi in range(1, 5):
                result += first[:, index(zeta, chi)] * dq[index(zeta, chi)]
        return result

    def acceleration(self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}dv_i/dt, Eq. (12), sum by sum."""
        first, second = self.position_jacobian(q, i), self.position_hessian(q, i)
        result = np.zeros(3)
        for zeta in range(1, i + 1):
            for chi in range(1, 5):
                b = index(zeta, chi)
                result += first[:, b] * ddq[b]
                for alpha in range(1, i + 1):
                    for beta in range(1, 5):
                        a = index(alpha, beta)
                        result += second[:, b, a] * dq[a] * dq[b]
        return result

    def angle_jacobian(self, q: np.ndarray, i: int) -> np.ndarray:
        """U_i, Eq. (29): sum over zeta of ^{i-1}R_{zeta-1} d ^{zeta-1}theta_zeta / dq."""
        to_frame = self.base_rotation(q, i - 1).T
        total = np.zeros((3, q.size))
        for zeta in range(1, i + 1):
            first = jacobian(lambda s, zeta=zeta: self.angle(s, zeta), q)
            total += to_frame @ self.base_rotation(q, zeta - 1) @ first
        return total

    def angle_jacobian_rate(self, q: np.ndarray, dq: np.ndarray, i: int) -> np.ndarray:
        """dU_i/dt, for dw/dt in Eq. (28): base-frame derivative, then turned into frame i - 1.

        (^0R_{i-1})^T sum over zeta of [d(^0R_{zeta-1})/dt dtheta/dq + ^0R_{zeta-1} d/dt(dtheta/dq)]
        """
        steps = self.steps(q)
        total = np.zeros((3, q.size))
        for zeta in range(1, i + 1):
            rotation = self.base_rotation(q, zeta - 1)
            rotation_rate = jacobian(lambda s, z=zeta: self.base_rotation(s, z - 1), q) @ dq
            first = jacobian(lambda s, z=zeta: self.angle(s, z), q)
            second = hessian(lambda s, z=zeta: self.angle(s, z), q, steps)
            total += rotation_rate @ first + rotation @ (second @ dq)
        return self.base_rotation(q, i - 1).T @ total

    # ---- forces and moments, Eqs. (14)-(25)

    def inertia(self, q: np.ndarray, i: int) -> np.ndarray:
        """I_i, Eqs. (15)-(16), turned into frame i - 1: R I R^T."""
        disc = self.mass(i) * self.section(i).disc_radius ** 2
        rotation = self.local_rotation(q, i)
        return rotation @ np.diag([disc / 4.0, disc / 4.0, disc / 2.0]) @ rotation.T

    def inertial_wrench(
        self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, i: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Eq. (14), with X x m dv/dt in the moment."""
        force = self.mass(i) * self.acceleration(q, dq, ddq, i)
        inertia = self.inertia(q, i)
        first, rate = self.angle_jacobian(q, i), self.angle_jacobian_rate(q, dq, i)
        omega = first @ dq  # Eq. (6)
        moment = np.cross(self.local_position(q, i), force)
        moment += inertia @ (first @ ddq + rate @ dq) + np.cross(omega, inertia @ omega)
        return force, moment

    def unit_length(self, q_i: np.ndarray, i: int, position: np.ndarray) -> float:
        """l_ij: arc length of the unit whose axis runs at `position` in the cross-section."""
        strain, kx, ky, _ = q_i
        length = (1.0 + strain) * self.rest_length(i)
        return length * (1.0 + kx * position[1] - ky * position[0])

    def elastic_force(self, q: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}f_{i,e}, Eq. (17), with l_i0 the initial length; divided by it if "strain"."""
        section, initial = self.section(i), self.rest_length(i)
        total = 0.0
        for position in section.unit_positions():
            total += self.unit_length(block(q, i), i, position) - initial
        if self.axial_law == "strain":
            total /= initial
        return np.array([0.0, 0.0, section.young_modulus * section.wall_area * total])

    def elastic_moment(self, q: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}M_{i,e}, Eqs. (18)-(19)."""
        section = self.section(i)
        second_moment = np.pi * section.bending_radius**4 / 4.0
        polar_moment = np.pi * section.bending_radius**4 / 2.0
        bending = section.young_modulus * second_moment
        stiffness = np.diag([bending, bending, section.shear_modulus * polar_moment])
        return stiffness @ block(q, i)[1:]

    def driving_force(self, pressures: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}f_{i,d}, Eq. (20)."""
        total = 0.0
        for pressure in self.unit_pressures(pressures, i):
            total += pressure
        return np.array([0.0, 0.0, self.section(i).unit_area * total])

    def driving_moment(self, pressures: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}M_{i,d}, Eq. (21)."""
        section = self.section(i)
        moment = np.zeros(3)
        pairs = zip(section.unit_positions(), self.unit_pressures(pressures, i), strict=True)
        for position, pressure in pairs:
            moment += np.cross(position, np.array([0.0, 0.0, section.unit_area * pressure]))
        return moment

    def elastic_hand_back(self, q: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
        """The elastic part of ^if_{i+1} and ^iM_{i+1}, Eq. (22), in frame i; zero at the tip."""
        if i == self.count:
            return np.zeros(3), np.zeros(3)
        return self.elastic_force(q, i + 1), self.elastic_moment(q, i + 1)

    def driving_hand_back(self, pressures: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
        """The driving part of ^if_{i+1} and ^iM_{i+1}, Eq. (22), with its minus sign."""
        if i == self.count:
            return np.zeros(3), np.zeros(3)
        return -self.driving_force(pressures, i + 1), -self.driving_moment(pressures, i + 1)

    def tip_load(self, q: np.ndarray, i: int) -> tuple[np.ndarray, np.ndarray]:
        """F_ext and M_ext, Eqs. (23) and (31), in frame i - 1; zero but for the last segment."""
        if i < self.count:
            return np.zeros(3), np.zeros(3)
        to_frame = self.base_rotation(q, i - 1).T
        return to_frame @ np.array(self.tip_force), to_frame @ np.array(self.tip_moment)

    def damping_wrench(
        self, q: np.ndarray, dq: np.ndarray, i: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Eq. (24), with X x d_v v in the moment."""
        force = self.linear_damping(i) * self.velocity(q, dq, i)
        moment = np.cross(self.local_position(q, i), force)
        return force, moment + self.angular_damping(i) * (self.angle_jacobian(q, i) @ dq)

    def weight(self, q: np.ndarray, i: int) -> np.ndarray:
        """^{i-1}G_i, Eqs. (25) and (30): (^0R_{i-1})^T m g."""
        return self.base_rotation(q, i - 1).T @ (self.mass(i) * np.array(self.gravity))

    def handed_over(
        self, q: np.ndarray, i: int, force: np.ndarray, moment: np.ndarray
    ) -> np.ndarray:
        """Rows of the last two terms of Eq. (13): Z (R f) and X x (R f) + R M."""
        rotation = self.local_rotation(q, i)
        turned = rotation @ force
        return rows(turned, np.cross(self.local_position(q, i), turned) + rotation @ moment)

    def balance(
        self, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, pressures: np.ndarray
    ) -> np.ndarray:
        """Eq. (13) summed from its wrenches, zero along a motion: M ddq + C dq + N - tau."""
        q = self.state(q)
        result = []
        for i in range(1, self.count + 1):
            position, weight = self.local_position(q, i), self.weight(q, i)
            load_force, load_moment = self.tip_load(q, i)
            total = rows(*self.inertial_wrench(q, dq, ddq, i))
            total += rows(*self.damping_wrench(q, dq, i))
            total += rows(self.elastic_force(q, i), self.elastic_moment(q, i))
            total -= rows(self.driving_force(pressures, i), self.driving_moment(pressures, i))
            total -= rows(weight, np.cross(position, weight))  # Eq. (25)
            total -= rows(load_force, np.cross(position, load_force) + load_moment)  # Eq. (23)
            elastic, driving = self.elastic_hand_back(q, i), self.driving_hand_back(pressures, i)
            total -= self.handed_over(q, i, elastic[0] + driving[0], elastic[1] + driving[1])
            result.append(total)
        return np.concatenate(result)

    # ---- the terms of Eq. (26)

    def mass_rows(self, q: np.ndarray, i: int) -> np.ndarray:
        """Eq. (27): [Z m J ; X x (m J) + I U]."""
        linear = self.mass(i) * self.position_jacobian(q, i)
        position = skew(self.local_position(q, i))
        moment = position @ linear + self.inertia(q, i) @ self.angle_jacobian(q, i)
        return np.vstack([Z_HAT @ linear, moment])

    def velocity_rows(self, q: np.ndarray, dq: np.ndarray, i: int) -> np.ndarray:
        """Eq. (28): [Z (m dJ + d_v J) ; X x (m dJ + d_v J) + d_w U + I dU + (U dq) x I U]."""
        linear = self.mass(i) * self.position_jacobian_rate(q, dq, i)
        linear += self.linear_damping(i) * self.position_jacobian(q, i)
        angular, inertia = self.angle_jacobian(q, i), self.inertia(q, i)
        moment = skew(self.local_position(q, i)) @ linear
        moment += self.angular_damping(i) * angular
        moment += inertia @ self.angle_jacobian_rate(q, dq, i)
        moment += skew(angular @ dq) @ inertia @ angular
        return np.vstack([Z_HAT @ linear, moment])

    def position_rows(self, q: np.ndarray, i: int) -> np.ndarray:
        """Eq. (30): K q - gravity - the elastic part of what the next segment hands back."""
        weight = self.weight(q, i)
        result = rows(self.elastic_force(q, i), self.elastic_moment(q, i))
        result -= rows(weight, np.cross(self.local_position(q, i), weight))
        return result - self.handed_over(q, i, *self.elastic_hand_back(q, i))

    def input_rows(self, q: np.ndarray, pressures: np.ndarray, i: int) -> np.ndarray:
        """Eq. (31): drive + the driving part of the hand-back + the tip load."""
        force, moment = self.tip_load(q, i)
        result = rows(self.driving_force(pressures, i), self.driving_moment(pressures, i))
        result += rows(force, np.cross(self.local_position(q, i), force) + moment)
        return result + self.handed_over(q, i, *self.driving_hand_back(pressures, i))

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """M(q), Eq. (27)."""
        q = self.state(q)
        return np.vstack([self.mass_rows(q, i) for i in range(1, self.count + 1)])

    def velocity_matrix(self, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
        """C(q, dq), Eq. (28)."""
        q, dq = self.state(q), np.asarray(dq, dtype=float)
        return np.vstack([self.velocity_rows(q, dq, i) for i in range(1, self.count + 1)])

    def position_vector(self, q: np.ndarray) -> np.ndarray:
        """N(q), Eq. (30)."""
        q = self.state(q)
        return np.concatenate([self.position_rows(q, i) for i in range(1, self.count + 1)])

    def input_vector(self, q: np.ndarray, pressures: np.ndarray) -> np.ndarray:
        """tau(q, P), Eq. (31)."""
        q = self.state(q)
        return np.concatenate([self.input_rows(q, pressures, i) for i in range(1, self.count + 1)])

    def terms(self, q: np.ndarray, dq: np.ndarray, pressures: np.ndarray) -> Terms:
        """M, C, N and tau of Eq. (26)."""
        return Terms(
            self.mass_matrix(q),
            self.velocity_matrix(q, dq),
            self.position_vector(q),
            self.input_vector(q, pressures),
        )

    def joint_acceleration(
        self, q: np.ndarray, dq: np.ndarray, pressures: np.ndarray
    ) -> np.ndarray:
        """Eq. (26) solved for ddq."""
        terms = self.terms(q, dq, pressures)
        return np.linalg.solve(terms.mass, terms.inputs - terms.position - terms.velocity @ dq)


def index(zeta: int, chi: int) -> int:
    """Place of q_{zeta chi} in q, Eq. (1), both counted from 1."""
    return 4 * (zeta - 1) + chi - 1


def block(q: np.ndarray, i: int) -> np.ndarray:
    """q_i = [eps_i, kx_i, ky_i, kz_i]."""
    return q[..., 4 * (i - 1) : 4 * i]


def rows(force: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """The four rows of a segment: Z-hat force, moments."""
    return np.array([Z_HAT @ force, *moment])


# ---------------------------------------------------------------- hydraulics: Eqs. (32)-(36)


@dataclass(frozen=True)
class LiteralHydraulics:
    """One motor, screw, cylinder, tube and unit, SI units. `screw` reads s in Eq. (33).

    `screw` is "lead" (s = lead, as printed) or "lead/2pi" (s = lead / 2 pi, omega in rad/s).
    """

    piston_mass: float  # m_b
    piston_damping: float  # d_v of Eq. (32)
    friction: float  # f
    piston_area: float  # A_c
    efficiency: float  # eta
    lead: float
    tube_diameter: float  # d_p
    tube_length: float  # l_p
    viscosity: float  # mu
    bulk_modulus: float  # K
    unit_area: float  # A_d
    wall_area: float  # A_s
    young_modulus: float  # E
    unit_length: float  # l_0
    unit_volume: float  # V_1
    cylinder_volume: float  # V_2
    screw: str = "lead/2pi"

    def screw_advance(self) -> float:
        """s of Eq. (33), metres of travel per unit of motor angle."""
        if self.screw == "lead":
            return self.lead
        if self.screw == "lead/2pi":
            return self.lead / (2.0 * np.pi)
        raise ValueError(f"unknown reading of Eq. (33): {self.screw!r}")

    def screw_force(self, torque: float) -> float:
        """F_b, Eq. (33): eta T omega = F_b dx and dx = omega s, so F_b = eta T / s."""
        return self.efficiency * torque / self.screw_advance()

    def piston_acceleration(self, speed: float, cylinder_pressure: float, torque: float) -> float:
        """ddx, Eq. (32), for a piston that moves forward: friction is +f."""
        resistance = self.friction + cylinder_pressure * self.piston_area
        resistance += self.piston_damping * speed
        return (self.screw_force(torque) - resistance) / self.piston_mass

    def tube_conductance(self) -> float:
        """pi d_p^4 / (128 mu l_p), Eqs. (34)-(35)."""
        return np.pi * self.tube_diameter**4 / (128.0 * self.viscosity * self.tube_length)

    def unit_compliance(self) -> float:
        """C_1 = A_d^2 l_0 / (E A_s) + V_1 / K, Eq. (34)."""
        stretch = self.unit_area**2 * self.unit_length / (self.young_modulus * self.wall_area)
        return stretch + self.unit_volume / self.bulk_modulus

    def cylinder_compliance(self) -> float:
        """C_2 = V_2 / K, Eq. (35)."""
        return self.cylinder_volume / self.bulk_modulus

    def unit_pressure_rate(self, unit_pressure: float, cylinder_pressure: float) -> float:
        """dP_a, Eq. (34)."""
        flow = self.tube_conductance() * (cylinder_pressure - unit_pressure)
        return flow / self.unit_compliance()

    def cylinder_pressure_rate(
        self, speed: float, unit_pressure: float, cylinder_pressure: float
    ) -> float:
        """dP_c, Eq. (35)."""
        flow = self.piston_area * speed
        flow += self.tube_conductance() * (unit_pressure - cylinder_pressure)
        return flow / self.cylinder_compliance()

    def matrices(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A, B and friction column of Eq. (36), dz = A z + B T - friction, z = [dx, P_a, P_c].

        B and the friction column are 3 x 1. The column is [f / m_b, 0, 0], for a piston that
        moves forward; multiply it by sign(dx), or by its regularisation, otherwise.
        """
        m_b, k = self.piston_mass, self.tube_conductance()
        c_1, c_2 = self.unit_compliance(), self.cylinder_compliance()
        a = np.array(
            [
                [-self.piston_damping / m_b, 0.0, -self.piston_area / m_b],
                [0.0, -k / c_1, k / c_1],
                [self.piston_area / c_2, k / c_2, -k / c_2],
            ]
        )
        b = np.array([[self.efficiency / (self.screw_advance() * m_b)], [0.0], [0.0]])
        friction = np.array([[self.friction / m_b], [0.0], [0.0]])
        return a, b, friction


# ---------------------------------------------------------------- errors: Eq. (37)


def section_errors(reference: np.ndarray, model: np.ndarray) -> np.ndarray:
    """ERR_i(t), Eq. (37). Both arrays are [time, section, xyz]; the answer is [time, section]."""
    difference = np.asarray(reference) - np.asarray(model)
    x, y, z = (difference[..., k] for k in range(3))
    return np.sqrt(x**2 + y**2 + z**2)


def largest_sectional_error(errors: np.ndarray) -> float:
    """max([max(ERR_1), max(ERR_2), ...]), below Eq. (37)."""
    return max(float(np.max(errors[:, i])) for i in range(errors.shape[1]))


def largest_cumulative_error(errors: np.ndarray) -> float:
    """max over time of sum_i ERR_i, below Eq. (37)."""
    total = np.zeros(errors.shape[0])
    for i in range(errors.shape[1]):
        total += errors[:, i]
    return float(np.max(total))
