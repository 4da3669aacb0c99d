"""Write the made-up measurements of examples/calibration: `python docs/make_calibration_data.py`.

No bench was measured: the data are those of a known arm with noise from a fixed seed, so that
anybody can see whether the calibration finds it. TRUTH is not in the files.
"""

from pathlib import Path

import numpy as np

from softmpc import Scene, load_scene
from softmpc.files import replacing
from softmpc.model.scene_paths import resolve, with_values
from softmpc.simulation.columns import write_columns
from softmpc.simulation.inputs import InputProfile
from softmpc.study.arm_at import ArmAt
from softmpc.study.observations import pressures_at_rest

FOLDER = Path(__file__).parents[1] / "examples" / "calibration"
TRUTH = {
    "sections.bending_radius": 0.0291,
    "sections.viscosity": 1.3e4,
    "effects.payload.mass": 0.16,
    "hydraulics.efficiency": 0.52,
}
TIPS, PRESSURES = 1e-3, 5e-3  # standard deviations, m and MPa
RNG = np.random.default_rng(4)


def known_arm() -> Scene:
    """The arm of the data: the scene of the example with other numbers."""
    scene = load_scene(FOLDER / "bench_arm.toml")
    return with_values(scene, {resolve(scene, path): value for path, value in TRUTH.items()})


def write_poses(arm: ArmAt) -> None:
    """Eight rests; the camera missed the first section twice."""
    lines = ["T_1 [N·m],T_2,T_3,T_4,T_5,T_6,x_1 [m],y_1 [m],z_1 [m],x_2 [m],y_2 [m],z_2 [m]"]
    for k in range(8):
        torques = np.round(RNG.uniform(0, 1.6, 6), 2)
        tips = arm.tips(arm.rest(pressures_at_rest(arm, None, torques.tolist())))
        cells = _rounded((tips + RNG.normal(0, TIPS, tips.shape)).ravel())
        if k in (2, 5):
            cells[:3] = ["", "", ""]
        lines.append(",".join([*(f"{t:g}" for t in torques), *cells]))
    with replacing(FOLDER / "poses.csv") as beside:
        beside.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _rounded(metres: np.ndarray) -> list[str]:
    """Four digits; what rounds to zero has no sign."""
    return [f"{round(float(v), 4) + 0.0:.4f}" for v in metres]


def write_motion(arm: ArmAt) -> None:
    """A step and ramps; tips 25 times a second, the pressure of unit 1 ten times."""
    knots = np.array([0.0, 0.2, 0.21, 1.0, 1.4, 2.0])
    torques = np.zeros((len(knots), 6))
    torques[2:, 0] = 1.2
    torques[4:, 4:] = 0.8
    titles = ["T_1 [N·m]", *(f"T_{j}" for j in range(2, 7))]
    columns = {"t [s]": knots} | dict(zip(titles, torques.T, strict=True))
    write_columns(FOLDER / "torques.csv", columns)
    camera, sensor = np.arange(1, 51) / 25, np.arange(1, 21) / 10
    times = np.unique(np.round(np.append(camera, sensor), 6))
    motion = arm.motion("bench", InputProfile.from_table(knots, torques), times, "rest")
    lines = ["t [s],x_2 [m],y_2 [m],z_2 [m],P_1 [MPa]"]
    for k, t in enumerate(times):
        seen = _rounded(motion.tips[k, -1] + RNG.normal(0, TIPS, 3))
        felt = f"{motion.p[k, 0] / 1e6 + RNG.normal(0, PRESSURES):.3f}"
        there = [np.abs(times_ - t).min() < 1e-6 for times_ in (camera, sensor)]
        lines.append(
            ",".join([f"{t:g}", *(seen if there[0] else ["", "", ""]), felt if there[1] else ""])
        )
    with replacing(FOLDER / "motion.csv") as beside:
        beside.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    known = ArmAt(known_arm())
    write_poses(known)
    write_motion(known)
    print(FOLDER)
