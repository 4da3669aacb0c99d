"""Inverse statics: is every target in reach hit, is the nearest posture the nearest, how long?

    python -m tests.benchmarks.inverse [--quick] [--inside 1000] [--outside 200] [--dense 100000]

Paper's arm, both sections, at 1 and 2 segments a section, without and with a load at the tip.

Inside: tips of random admissible pressures, half of them with units at their limits. How many are
solved to 0.01 mm, with pressures within the limits, stable and on the branch of the straight arm;
milliseconds a target (median, 95 % quantile): cold, from the spread of postures alone; compared,
cold with the best of five starts; warm, along paths in steps of 3 mm.

Outside: random places in a box half as large again, all that a dense search finds further away
than 0.1 mm: the nearest of many random postures, refined by SciPy's bounded least squares over the
pressures. How many are said to be unreachable, and by how much the distance is above that of the
dense search at worst.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from scipy.optimize import least_squares

from softmpc.model.effects import TipLoad
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene, default_effects
from softmpc.statics.equilibrium import find_equilibrium, refine_equilibrium
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.inverse_result import InverseResult
from softmpc.statics.rest_limits import rest_limits
from softmpc.statics.targets import Position
from tests.benchmarks.common import arguments, key, seconds_of

LOAD = TipLoad(force=(0.6, -0.4, 1.0))
HIT = 1e-5  # m
STEP = 3e-3  # m, of a path
SAMPLES = 250  # of a path, finer than the steps
REFINED = 5  # nearest postures of the dense search that are refined


def scenes() -> Iterator[tuple[str, Scene]]:
    for segments in (1, 2):
        for load in ((), (LOAD,)):
            effects = (*default_effects(), *load)
            name = f"{segments} segment{'s' * (segments > 1)}, {'load' if load else 'no load'}"
            yield name, Scene(chen2022(), segments=segments, effects=effects)


def random_pressures(model: Model, count: int, seed: int) -> np.ndarray:
    """Half of them anywhere within the limits, half with units at either limit, at random."""
    rng, limits = np.random.default_rng(seed), rest_limits(model)
    shares = rng.uniform(size=(count, len(limits.low)))
    ends = rng.choice([0.0, 1.0, np.nan], p=[0.4, 0.2, 0.4], size=shares.shape)
    shares[::2] = np.where(np.isnan(ends), shares, ends)[::2]
    return np.asarray(limits.low + shares * limits.range)


def tips_of(model: Model, pressures: np.ndarray) -> np.ndarray:
    return np.array([find_equilibrium(model, p).tips[-1] for p in pressures])


# ---------------------------------------------------------------- inside


def inside(
    model: Model, inverse: InverseStatics, count: int
) -> dict[str, tuple[list[InverseResult], np.ndarray]]:
    """Results and places: cold, with five starts compared, and warm along paths."""
    targets = tips_of(model, random_pressures(model, count, seed=1))
    inverse.solve(Position(tuple(targets[0])))  # build the program
    few = targets[: count // 5]
    return {
        "cold": ([inverse.solve(Position(tuple(place))) for place in targets], targets),
        "compared": ([inverse.solve(Position(tuple(place)), compare=5) for place in few], few),
        "warm": along_paths(model, inverse, max(count // 100, 3)),
    }


def show_inside(found: dict[str, tuple[list[InverseResult], np.ndarray]], model: Model) -> None:
    titles = {"cold": "inside, cold:     ", "compared": "inside, compared: "}
    for name, (results, places) in found.items():
        print(f"  {titles.get(name, 'warm, 3 mm steps: ')}{line(summary(model, results, places))}")
        if name == "compared":
            gain = gains(found)
            print(f"    cost of the first start above the best of five: more than 1 % for "
                  f"{np.mean(gain > 0.01):.1%}, more than twice for {np.mean(gain > 1):.1%}",
                  flush=True)  # fmt: skip


def gains(found: dict[str, tuple[list[InverseResult], np.ndarray]]) -> np.ndarray:
    """How much the cost of the first start is above the best of five."""
    pairs = zip(found["cold"][0], found["compared"][0], strict=False)
    return np.array([one.cost / best.cost for one, best in pairs]) - 1


def along_paths(
    model: Model, inverse: InverseStatics, count: int
) -> tuple[list[InverseResult], np.ndarray]:
    """Tip paths of pressures that go straight from one random draw to the next; results, places."""
    results, places = [], []
    for here, there in pairwise(random_pressures(model, count + 1, seed=4)):
        tips = tips_of(model, here + np.linspace(0, 1, SAMPLES)[:, None] * (there - here))
        line = [tips[0]]
        for tip in tips:
            if np.linalg.norm(tip - line[-1]) >= STEP:
                line.append(tip)
        results += inverse.solve_path([Position(tuple(place)) for place in line])
        places += line
    return results, np.array(places)


def summary(model: Model, results: list[InverseResult], places: np.ndarray) -> dict[str, float]:
    """Counts, the worst distance (mm), times (ms) of some results."""
    limits = rest_limits(model)
    hit = [np.linalg.norm(r.tips[-1] - x) <= HIT for r, x in zip(results, places, strict=False)]
    kept = [
        bool(np.all((limits.low <= r.pressures) & (r.pressures <= limits.high))) for r in results
    ]
    good = [r.solved and h and k for r, h, k in zip(results, hit, kept, strict=True)]
    calm = [r.stable and r.on_rest_branch for r in results]
    ms = 1e3 * np.array([r.seconds for r in results])
    iterations = np.array([r.iterations for r in results])
    return {
        "solved_count": sum(good),
        "of_count": len(results),
        "stable_count": sum(calm),
        "worst_mm": 1e3 * max(r.distance for r in results),
        "ms_median": float(np.median(ms)),
        "ms_95": float(np.quantile(ms, 0.95)),
        "iterations_median": float(np.median(iterations)),
    }


def line(found: dict[str, float]) -> str:
    return (
        f"{found['solved_count']} of {found['of_count']} solved, {found['stable_count']} stable "
        f"on the branch, worst {found['worst_mm']:.1e} mm, {found['ms_median']:.1f} ms "
        f"({found['ms_95']:.1f}), {found['iterations_median']:.0f} iterations"
    )


# ---------------------------------------------------------------- outside


class DenseSearch:
    """The nearest posture to a place without IPOPT."""

    def __init__(self, model: Model, count: int) -> None:
        self.model, self.limits = model, rest_limits(model)
        pressures = random_pressures(model, count, seed=2)
        found = [find_equilibrium(model, p) for p in pressures]
        self.postures = [rest for rest in found if rest.stable]
        self.tips = np.array([rest.tips[-1] for rest in self.postures])

    def distance(self, place: np.ndarray) -> float:
        """Of the best posture on the branch of the straight arm (m)."""
        near = np.argsort(np.linalg.norm(self.tips - place, axis=1))[:REFINED]
        return min(self._refined(self.postures[k].pressures, place) for k in near)

    def _refined(self, pressures: np.ndarray, place: np.ndarray) -> float:
        limits, scale = self.limits, self.model.layout.p.scale
        q = find_equilibrium(self.model, pressures).q

        def off(share: np.ndarray) -> np.ndarray:
            nonlocal q
            rest = refine_equilibrium(self.model, share * scale, q)
            q = rest.q
            return np.asarray(rest.tips[-1] - place)

        def slope(share: np.ndarray) -> np.ndarray:
            K, by_p = (np.asarray(x) for x in self.model.stiffness(q, share * scale))
            J = np.asarray(self.model.tip_jacobian(q))[-3:]
            return np.asarray(-J @ np.linalg.solve(K, by_p) * scale)

        low, high = limits.low / scale, limits.high / scale
        inner = np.clip(pressures / scale, low + 1e-9 * (high - low), high - 1e-9 * (high - low))
        found = least_squares(
            off, inner, slope, bounds=(low, high), xtol=1e-12, ftol=1e-12, gtol=1e-12, max_nfev=200
        )
        p = np.clip(found.x * scale, limits.low, limits.high)
        return float(np.linalg.norm(find_equilibrium(self.model, p).tips[-1] - place))


def outside(model: Model, inverse: InverseStatics, count: int, postures: int) -> dict[str, float]:
    """Counts, gaps to a dense search (mm), milliseconds, and how long that search took (s)."""
    began = time.perf_counter()
    dense = DenseSearch(model, postures)
    rng, low, high = np.random.default_rng(3), dense.tips.min(axis=0), dense.tips.max(axis=0)
    results, gaps = [], []
    while len(results) < count:
        place = (low + high) / 2 + 1.5 * (high - low) / 2 * rng.uniform(-1, 1, 3)
        least = dense.distance(place)
        if least > 1e-4:
            results.append(inverse.solve(Position(tuple(place))))
            gaps.append(results[-1].distance - least)
    return {
        "unreachable_count": sum(r.status == "unreachable" for r in results),
        "of_count": count,
        "stable_count": sum(r.stable and r.on_rest_branch for r in results),
        "above_dense_search_mm": 1e3 * max(gaps),
        "below_dense_search_mm": -1e3 * min(gaps),
        "ms_median": 1e3 * float(np.median([r.seconds for r in results])),
        "dense_search_s": time.perf_counter() - began,
    }


def show_outside(found: dict[str, float]) -> None:
    print(
        f"  outside: {found['unreachable_count']} of {found['of_count']} unreachable, "
        f"{found['stable_count']} stable on the branch; distance above the dense search's "
        f"{found['above_dense_search_mm']:.1e} mm at most, below it "
        f"{found['below_dense_search_mm']:.1e} mm; {found['ms_median']:.0f} ms; "
        f"the dense search took {found['dense_search_s']:.0f} s",
        flush=True,
    )


def prepared(scene: Scene) -> tuple[Model, InverseStatics, float]:
    """Model, inverse statics, and the seconds that its spread of postures took."""
    model = build(scene)
    inverse = InverseStatics(model)
    return model, inverse, seconds_of(lambda: inverse.spread)


def numbers(quick: bool) -> dict[str, float]:
    """One segment without load, 60 targets and none outside in quick mode; else as printed."""
    found: dict[str, float] = {}
    for name, scene in [*scenes()][: 1 if quick else None]:
        model, inverse, spread_s = prepared(scene)
        found[key(name, "spread_s")] = spread_s
        parts = inside(model, inverse, 60 if quick else 1000)
        each = {where: summary(model, *both) for where, both in parts.items()}
        if not quick:
            each["outside"] = outside(model, inverse, 200, 100_000)
        for where, values in each.items():
            found |= {key(name, where, what): value for what, value in values.items()}
    return found


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--quick", action="store_true", help="a tenth of it")
    parser.add_argument("--inside", type=int, default=1000)
    parser.add_argument("--outside", type=int, default=200)
    parser.add_argument("--dense", type=int, default=100_000)
    given = parser.parse_args()
    share = 10 if given.quick else 1
    for name, scene in scenes():
        print(name, flush=True)
        model, inverse, spread_s = prepared(scene)
        print(f"  {len(inverse.spread.postures)} postures to start from made in "
              f"{1e3 * spread_s:.0f} ms")  # fmt: skip
        show_inside(inside(model, inverse, given.inside // share), model)
        if given.outside // share:
            show_outside(outside(model, inverse, given.outside // share, given.dense // share))


if __name__ == "__main__":
    main()
