"""softmpc beside a peer, soromox (JAX): `python -m tests.benchmarks.peer`.

Needs `pip install soromox`, which softmpc does not depend on; without it one line says so and the
exit status is 2. `--solver` and `--tolerance` change how soromox integrates.

Prints two motions of 10 s, a row for soromox and four for softmpc: pressures given directly (the
same content) and full hydraulics (which soromox does not have), each in CasADi's virtual machine
and compiled by a C compiler, nothing being compiled before. Times are the medians of 5 processes of
their own; the rows take turns.

Alike: two constant-strain sections with stretch, bending and twist (soromox's shears are switched
off), start straight and unstretched, lengths, weight, mass spread along the arm (2 Gauss points),
rotary inertia (soromox's solid circle has the radius and mass of our discs), stretching, bending
and twisting stiffness, forces and moments of the drive on the strains, a sample every 10 ms.
soromox's curvatures are per rest length, ours per current length, so its own quadratic law would
be another material: the bending energy λ/2 κ·Kκ/(1 + ε) is added through its interface for passive
elements. So both have the same rest, and the tips at the end show it.

Not alike: damping in soromox is a constant matrix, that of our straight arm at rest (material and
environment); ours depends on the posture. The integrators: ours Radau IIA, implicit, at most 1 µm
at the tip a step; soromox's rollout with its own choice, diffrax's Tsit5, explicit, here with
diffrax's adaptive controller, rtol = atol = 1e-4 (strains and rates in SI), which makes errors of
the tip comparable; with no controller given soromox takes steps of 0.1 ms. A step of the input
begins a new rollout of one compiled function. The error is the largest distance of the tip, at any
sample, from the same model with a tolerance of 1e-10, ours by IDAS. While the arm rests an implicit
method takes long steps and an explicit one cannot: the second motion, with a step every second,
leaves less rest.

Set up is construction, compilation and, ours, the start of the integrator; imports are only in the
time from the start of the process to the result. Ratios are soromox's time over that of the row.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

RUNS, DURATION, SAMPLE = 5, 10.0, 0.01  # s
TIGHT = 1e-10
PRESSURE = 0.6e6  # Pa
# Units under pressure, each list for its share of the duration.
MOTIONS = {
    "one step": [(1, 5)],
    "a step a second": [(1, 5), (2, 6), (3, 4), (1,), (5,), (1, 2), (4, 5), (3, 6), (2,), (1, 5)],
}
PEER = "soromox"
# Row -> drive, and what SOFTMPC_COMPILE is.
OURS = {
    "softmpc, pressures": ("pressure", "never"),
    "softmpc, pressures, compiled": ("pressure", "require"),
    "softmpc, hydraulics": ("hydraulic", "never"),
    "softmpc, hydraulics, compiled": ("hydraulic", "require"),
}
Answer = dict[str, Any]


def inputs(motion: str, high: float, units: int) -> np.ndarray:
    """Inputs (K×units), each row held for DURATION / K."""
    return np.array(
        [[high if unit + 1 in on else 0.0 for unit in range(units)] for on in MOTIONS[motion]]
    )


def run_softmpc(motion: str, drive: str, check: bool) -> Answer:
    """One motion in this process; called in a process of its own."""
    from softmpc import HydraulicDrive, PressureDrive, Scene, build, chen2022
    from softmpc.simulation.inputs import InputProfile, Step
    from softmpc.simulation.run import simulate

    began = time.perf_counter()
    arm = chen2022()
    actuation = PressureDrive() if drive == "pressure" else HydraulicDrive()
    model = build(Scene(arm, actuation=actuation))
    high = PRESSURE / actuation.matrices(arm).static_gain[0, 0]
    rows = inputs(motion, high, arm.units)
    hold = DURATION / len(rows)
    profile = InputProfile.of(
        arm.units,
        [Step(i + 1, k * hold, to) for k, row in enumerate(rows) for i, to in enumerate(row)],
    )
    built = time.perf_counter() - began
    moved = simulate(model, profile, DURATION, sample_time=SAMPLE, start="straight")
    answer = {
        "ready": time.time(),
        "setup": built + moved.setup_s,
        "seconds": moved.wall_s,
        "tip": moved.final_tips[-1].tolist(),
        "finished": moved.finished,
    }
    if check:
        tight = {"method": "idas", "tolerance": TIGHT, "sample_time": SAMPLE, "start": "straight"}
        exact = simulate(model, profile, DURATION, **tight)
        answer["error"] = np.linalg.norm(moved.tips[:, -1] - exact.tips[:, -1], axis=1).max()
    return answer


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


def measured(call: Answer, mode: str) -> Answer:
    """The answer of a process of its own, which finds nothing compiled before."""
    with tempfile.TemporaryDirectory() as cache:
        variables = {**os.environ, "SOFTMPC_COMPILE": mode, "SOFTMPC_CACHE": cache}
        command = [sys.executable, str(Path(__file__).resolve()), "--one", json.dumps(call)]
        began = time.time()
        done = subprocess.run(command, capture_output=True, text=True, env=variables)
    if done.returncode:
        sys.exit(f"{call['library']} failed:\n{done.stderr}")
    answer: Answer = json.loads(done.stdout.splitlines()[-1])
    if not answer["finished"]:
        sys.exit(f"{call['library']} did not finish {call['motion']!r}")
    return answer | {"whole": answer["ready"] - began}


def table(motion: str, peer: Answer) -> None:
    """Print the rows of one motion; `peer` is how soromox is to be called."""
    calls = {PEER: ({"library": PEER, "motion": motion} | peer, "never")}
    for row, (drive, mode) in OURS.items():
        calls[row] = ({"library": "softmpc", "motion": motion, "drive": drive}, mode)
    answers: dict[str, list[Answer]] = {row: [] for row in calls}
    for run in range(RUNS):
        for row, (call, mode) in calls.items():
            answers[row].append(measured(call | {"check": run == 0}, mode))
    title = f"{motion}, {DURATION:g} s"
    print(f"{title:29}  set up  motion  × real  start to  ratio of        error   end of the tip")
    print(f"{'':29}  s       s       time    result s  motion  result  mm      mm")
    for row, many in answers.items():
        m = {name: middle(many, name) for name in ("setup", "seconds", "whole")}
        by = {name: middle(answers[PEER], name) / m[name] for name in m}
        tip = ", ".join(f"{1e3 * x:.2f}" for x in many[0]["tip"])
        print(
            f"{row:29}  {m['setup']:6.2f}  {m['seconds']:6.3f}  {DURATION / m['seconds']:6.0f}  "
            f"{m['whole']:8.2f}  {by['seconds']:6.1f}  {by['whole']:6.1f}  "
            f"{1e3 * many[0]['error']:.4f}  {tip}",
            flush=True,
        )


def middle(answers: list[Answer], name: str) -> float:
    return statistics.median(answer[name] for answer in answers)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--solver", default="Tsit5", help="of diffrax, for soromox")
    parser.add_argument("--tolerance", type=float, default=1e-4, help="its rtol and atol")
    parser.add_argument("--one", type=json.loads, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        library = given.one.pop("library")
        print(json.dumps((run_soromox if library == PEER else run_softmpc)(**given.one)))
        return
    if importlib.util.find_spec(PEER) is None:
        print(f"{PEER} is not installed: pip install {PEER}", file=sys.stderr)
        sys.exit(2)
    names = ("softmpc", "casadi", PEER, "jax", "diffrax")
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, "
          + ", ".join(f"{name} {version(name)}" for name in names))  # fmt: skip
    print(f"medians of {RUNS} processes; {PEER} by {given.solver}, tolerance {given.tolerance:g}")
    peer = {"solver": given.solver, "tolerance": given.tolerance, "arm": arm_for_soromox()}
    for motion in MOTIONS:
        table(motion, peer)


if __name__ == "__main__":
    main()
