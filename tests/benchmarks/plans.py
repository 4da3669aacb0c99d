"""Random planning problems, solved without tuning and replayed: how many, how good, how long.

    python -m tests.benchmarks.plans [--runs 50] [--workers 2] [--json FILE] [--keep FILE]

Each problem has a seed: the rest under random pressures, the tip's place in another such rest at
least 8 cm away, and up to three obstacles of random kinds, none of which touches either posture.
The first one stands where the arm would pass on a straight way between both. Least time; all else
is as by default. A plan counts as good where its replay by another method at a tight tolerance
ends within 1 mm of the goal, keeps clear of obstacles to 1 mm along arm and time, and stays within
pressures and strokes. The interrupted benchmark goes on from what `--keep` has.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.common import arguments

APART, ROOM = 0.08, 8e-3  # m: between tips, and of both postures to obstacles
GOOD = 1e-3  # m
REACH = 0.25  # of full pressure and more, for most units


@dataclass(frozen=True)
class Problem:
    """Solves one random problem, by its seed."""

    @cached_property
    def model(self) -> Any:
        from softmpc import Scene, build, chen2022

        return build(Scene(chen2022()))

    def __call__(self, seed: int) -> dict[str, Any]:
        from softmpc.planning.planner import plan

        problem = self.problem(seed)
        found = plan(problem, executor=1)
        data = found.summary()
        kept = {"seed": seed, "obstacles": [one.name for one in problem.obstacles]}
        keys = ("status", "time_s", "cost_error", "intervals", "defect_mm", "misses_mm", "drift_mm",
                "clearance_mm", "beyond", "gives_way", "held_by", "seconds")  # fmt: skip
        kept |= {key: data.get(key) for key in keys}
        kept["starts"] = len(found.starts)
        kept["won"] = next((start.name for start in found.starts if start.won), "")
        kept["good"] = bool(found.solved and _good(data))
        return kept

    def problem(self, seed: int) -> Any:
        """The problem of a seed."""
        from softmpc.control.clearance import arm_clearance
        from softmpc.planning.goals import Goal, Start
        from softmpc.planning.problem import PlanProblem
        from softmpc.statics.targets import Position

        random, model = np.random.default_rng(seed), self.model
        while True:
            a, b = self._rest(random), self._rest(random)
            if np.linalg.norm(a.tips[-1] - b.tips[-1]) >= APART:
                break
        obstacles: list[Any] = []
        count = int(random.integers(0, 4))
        while len(obstacles) < count:
            share = 0.5 if not obstacles else random.uniform()
            one = _obstacle(random, model, a, b, share)
            if one is None:
                continue
            room = arm_clearance(model, (one,))(np.array([a.q, b.q])).clearance.min()
            if room > ROOM:
                obstacles.append(one)
        torques = np.linalg.solve(model.drive.static_gain, a.pressures)
        goal = Goal((Position(tuple(b.tips[-1].tolist())),))
        start = Start.at_rest(model, a.q, torques)
        return PlanProblem(model, start, (goal,), obstacles=tuple(obstacles))

    def _rest(self, random: np.random.Generator) -> Any:
        """A stable rest under random pressures, not too near to their limits."""
        from softmpc import find_equilibrium

        limits = self.model.scene.manipulator.limits
        while True:
            shares = random.uniform(0.05, 0.85, self.model.scene.manipulator.units)
            found = find_equilibrium(self.model, (shares * limits.pressure_max).tolist())
            if found.converged and found.stable:
                return found


def _obstacle(random: np.random.Generator, model: Any, a: Any, b: Any, share: float) -> Any:
    """A random obstacle beside some place of the arm, `share` of the way from a to b."""
    from softmpc.model.obstacles import Box, Cylinder, Plane, Sphere

    q = (1 - share) * a.q + share * b.q
    line = np.asarray(model.centerline(q)).T
    place = line[int(random.integers(len(line) // 3, len(line)))]
    aside = random.normal(size=3)
    aside /= np.linalg.norm(aside)
    size = float(random.uniform(0.01, 0.06))
    center = tuple((place + random.uniform(0.0, 0.08) * aside).tolist())
    way = random.normal(size=3)
    kind = str(random.choice(["sphere", "box", "cylinder", "plane"]))
    if kind == "sphere":
        return Sphere(center=center, radius=size)
    if kind == "box":
        turn = tuple(random.uniform(-90, 90, 3).tolist())
        return Box(
            center=center,
            size=tuple((2 * size * random.uniform(0.5, 1.5, 3)).tolist()),
            rotation=turn,
        )
    if kind == "cylinder":
        return Cylinder(point=center, axis=tuple(way.tolist()), radius=size)
    beyond = place + 0.08 * aside
    return Plane(point=tuple(beyond.tolist()), normal=tuple((-aside).tolist()))


def _good(data: dict[str, Any]) -> bool:
    """Whether the replay does what was asked."""
    arrives = max(data["misses_mm"]) <= 1e3 * GOOD
    clear = min(data["clearance_mm"].values(), default=0.0) >= -1e3 * GOOD
    within = all(one["scaled"] <= 2e-3 for one in data["beyond"].values())
    return bool(arrives and clear and within)


def solved(seeds: range, workers: int, keep: Path | None = None) -> list[dict[str, Any]]:
    """The problems of some seeds."""
    from tqdm import tqdm

    from softmpc.sweeps import sweep

    with tqdm(total=len(seeds), unit="problem") as bar:
        return sweep(
            Problem(), seeds, executor=workers, chunk=1, keep=keep,
            progress=lambda done, _: bar.update(done - bar.n),
        )  # fmt: skip


def numbers(quick: bool) -> dict[str, float]:
    """Two problems in quick mode, else 50: how many plans are good, how long planning takes."""
    found = solved(range(2 if quick else 50), 2)
    seconds = [one["seconds"] for one in found]
    defects = [one["defect_mm"] for one in found if one["defect_mm"] is not None]
    return {
        "problems_count": len(found),
        "good_count": sum(one["good"] for one in found),
        "planning_s_median": float(np.median(seconds)),
        "planning_s_most": max(seconds),
        "defect_mm_most": max(defects, default=0.0),
        "motion_s_mean": float(np.mean([one["time_s"] for one in found if one["time_s"]])),
    }


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    found = solved(range(given.first, given.first + given.runs), given.workers, given.keep)
    if given.json:
        given.json.write_text(json.dumps(found, indent=1), encoding="utf-8")
    print(_table(found))


HEAD = ("obstacles", "problems", "good", "starts", "motion, s", "planning, s (median, most)",
        "clearance, mm (least)", "plan and replay, mm (most)")  # fmt: skip


def _table(found: list[dict[str, Any]]) -> str:
    good = [one for one in found if one["good"]]
    counts = Counter(one["status"] for one in found).most_common()
    lines = [f"{len(good)} of {len(found)} problems solved and verified by replay: "]
    lines[0] += ", ".join(f"{number} {status}" for status, number in counts)
    several = [one["won"] for one in found if one["starts"] > 1]
    lines.append(f"of {len(several)} with several starts the straight one won "
                 f"{several.count('straight')}")  # fmt: skip
    lines += ["", "| " + " | ".join(HEAD) + " |", "|---" * len(HEAD) + "|"]
    for count in range(4):
        some = [one for one in found if len(one["obstacles"]) == count]
        if some:
            lines.append(_row(count, some))
    return "\n".join([*lines, *(_told(one) for one in found if not one["good"])])


def _told(one: dict[str, Any]) -> str:
    """What became of a problem that has no good plan."""
    ways = (f"{g['name']} by {g['amount']:.3g} {g['unit']}" for g in one["gives_way"] or [])
    held = ", ".join(one["held_by"] or [])
    return f"seed {one['seed']}: {one['status']}; gives way: {'; '.join(ways)}; held by: {held}"


def _row(count: int, some: list[dict[str, Any]]) -> str:
    seconds, times = (
        [one["seconds"] for one in some],
        [one["time_s"] for one in some if one["time_s"]],
    )
    rooms = [room for one in some for room in (one["clearance_mm"] or {}).values()]
    cells = [
        f"{count}", f"{len(some)}", f"{sum(one['good'] for one in some)}",
        f"{np.mean([one['starts'] for one in some]):.1f}",
        f"{min(times):.2f} to {max(times):.2f}",
        f"{np.median(seconds):.0f}, {max(seconds):.0f}",
        f"{min(rooms):.2f}" if rooms else "",
        f"{max(one['defect_mm'] for one in some if one['defect_mm'] is not None):.3f}",
    ]  # fmt: skip
    return "| " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
