"""The arm and motions of `peer` in soromox (JAX), which softmpc does not depend on."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

__all__ = ["DURATION", "MOTIONS", "PRESSURE", "SAMPLE", "TIGHT", "arm_for_soromox", "inputs",
           "run_soromox"]  # fmt: skip

DURATION, SAMPLE = 10.0, 0.01  # s
TIGHT = 1e-10
PRESSURE = 0.6e6  # Pa
# Units under pressure, each list for its share of the duration.
MOTIONS = {
    "one step": [(1, 5)],
    "a step a second": [(1, 5), (2, 6), (3, 4), (1,), (5,), (1, 2), (4, 5), (3, 6), (2,), (1, 5)],
}
Answer = dict[str, Any]


def inputs(motion: str, high: float, units: int) -> np.ndarray:
    """Inputs (K×units), each row held for DURATION / K."""
    return np.array(
        [[high if unit + 1 in on else 0.0 for unit in range(units)] for on in MOTIONS[motion]]
    )


def arm_for_soromox() -> Answer:
    """The arm in plain numbers, strains in soromox's order: twist, two bendings, stretch."""
    import casadi as ca

    from softmpc import PressureDrive, Scene, build, chen2022
    from softmpc.model.drive import driving_force, driving_moment

    arm = chen2022()
    order = [4 * i + k for i in range(len(arm.sections)) for k in (3, 1, 2, 0)]
    damping = np.array(build(Scene(arm, actuation=PressureDrive())).C(0, 0))
    sections = []
    for s in arm.sections:
        drive = []
        for pressures in np.eye(s.units):
            moment = np.array(driving_moment(s, pressures)).ravel()
            force = float(driving_force(s, ca.DM(pressures)))
            drive.append([s.length * part for part in (*moment[[2, 0, 1]], force)])
        sections.append(
            {
                "length": s.length,
                "radius": s.disc_radius,
                "density": s.mass / (np.pi * s.disc_radius**2 * s.length),
                "bending": [s.torsional_stiffness, s.bending_stiffness, s.bending_stiffness],
                "stretching": s.axial_stiffness,
                "drive": drive,  # generalised forces of 1 Pa in each unit
            }
        )
    return {"sections": sections, "damping": damping[np.ix_(order, order)].tolist()}


def soromox_arm(arm: Answer) -> Any:
    """The same arm as a soromox PCS system."""
    import jax
    import jax.numpy as jnp
    from soromox.actuation import PassiveElement
    from soromox.systems import PCS, LinkSpec
    from soromox.systems.pcs import PCSStructure

    class Wall(PassiveElement):
        """Bending energy Σ λ/2 κ·Kκ/(1 + ε), and all of the damping."""

        stiffness: jax.Array  # λ K (S×3)
        damping: jax.Array

        @property
        def params(self) -> Any:
            return None

        def with_params(self, params: Any) -> Any:
            return self

        def elastic_force(self, robot: Any, q: Any) -> Any:
            kappa, stretch = q.reshape(-1, 4)[:, :3], 1 + q.reshape(-1, 4)[:, 3:]
            moment = self.stiffness * kappa / stretch
            tension = -0.5 * jnp.sum(moment * kappa / stretch, axis=1, keepdims=True)
            return jnp.hstack([moment, tension]).ravel()

        def damping_matrix(self, robot: Any, q: Any) -> Any:
            return self.damping

    sections = arm["sections"]
    links = [
        LinkSpec.circular(
            **{name: s[name] for name in ("length", "radius", "density")},
            reference_strain=[0, 0, 0, 1, 0, 0],
            stiffness=s["length"] * jnp.diag(jnp.array([0, 0, 0, s["stretching"], 1, 1])),
        )
        for s in sections
    ]
    bending = jnp.array([s["length"] * np.array(s["bending"]) for s in sections])
    return PCS(
        PCS.params_from_links(links, gravity=jnp.array([0.0, 0.0, 9.81])),
        PCSStructure(
            num_gauss_points=2,
            strain_selector=jnp.array([True, True, True, True, False, False] * len(sections)),
        ),
        passive_elements=(Wall(bending, jnp.array(arm["damping"])),),
        base_pose=jnp.array([-0.5, -0.5, -0.5, 0.5, 0, 0, 0]),  # along z; its y, z are our x, y
    )


def soromox_inputs(motion: str, arm: Answer) -> np.ndarray:
    """Generalised forces of the drive (K×n), each row held for DURATION / K."""
    drives = [np.array(s["drive"]) for s in arm["sections"]]
    pressures = inputs(motion, PRESSURE, sum(map(len, drives)))
    each = np.split(pressures, np.cumsum([len(drive) for drive in drives])[:-1], axis=1)
    return np.hstack([own @ drive for own, drive in zip(each, drives, strict=True)])


def run_soromox(motion: str, solver: str, tolerance: float, check: bool, arm: Answer) -> Answer:
    """One motion in this process; called in a process of its own."""
    import diffrax
    import jax
    import jax.numpy as jnp
    from soromox.systems import SystemState

    began = time.perf_counter()
    jax.config.update("jax_enable_x64", True)
    robot, method = soromox_arm(arm), getattr(diffrax, solver)()
    efforts = soromox_inputs(motion, arm)

    def moved(x: Any, efforts: Any, tolerance: Any) -> Any:
        def held(x: Any, effort: Any) -> Any:
            part = robot.rollout_to(
                SystemState(t=0.0, y=x),
                u=effort,
                t1=DURATION / len(efforts),
                save_dt=SAMPLE,
                solver=method,
                stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            )
            return part.y[-1], part.y

        return jax.lax.scan(held, x, efforts)[1].reshape(-1, len(x))

    start = jnp.zeros(2 * robot.num_velocities)
    compiled = jax.jit(moved).lower(start, efforts, tolerance).compile()
    setup, began = time.perf_counter() - began, time.perf_counter()
    states = jax.block_until_ready(compiled(start, efforts, tolerance))
    seconds = time.perf_counter() - began

    def tip(state: Any) -> Any:
        return robot.forward_kinematics(state[: robot.num_velocities], jnp.sum(robot.L))[:3, 3]

    answer = {"tip": np.asarray(tip(states[-1])).tolist(), "setup": setup, "seconds": seconds}
    answer |= {"ready": time.time(), "finished": bool(jnp.isfinite(states).all())}
    if check:
        tips = jax.vmap(tip)
        apart = tips(states) - tips(compiled(start, efforts, TIGHT))
        answer["error"] = float(jnp.linalg.norm(apart, axis=1).max())
    return answer
