"""How large the model's functions are, and how long a call takes.

    python -m tests.benchmarks.instructions [--ad N]

For 1, 2, 4 and 8 segments a section of the paper's arm, with and without rotary inertia, and in
water: instructions executed and microseconds in a call (median) of the residual, of its derivative
along one direction (`residual_along`, linear in the segments), of its Jacobian in (q, dq, ddq) as
the model has it and by plain automatic differentiation (up to N segments, 8 unless told), and of
M, C, N, τ together. `ratio` is the Jacobian by automatic differentiation over the model's.
"""

from __future__ import annotations

import time
from statistics import median

import casadi as ca
import numpy as np

from softmpc.model.counting import executed
from softmpc.model.effects import (
    AddedMass,
    Buoyancy,
    Coriolis,
    Effect,
    FluidDrag,
    Gravity,
    Inertia,
    RotaryInertia,
)
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from tests.benchmarks.common import arguments, key

DEFAULT = "with rotary inertia"
SEGMENTS = (1, 2, 4, 8)
# Columns of the table -> what numbers are called.
NAMES = {
    "residual": "residual",
    "along": "residual_along",
    "Jacobian": "jacobian",
    "by AD": "jacobian_by_ad",
    "M C N τ": "equations",
}
EFFECTS: dict[str, tuple[Effect, ...]] = {
    "without rotary inertia": (Gravity(), Inertia(), Coriolis()),
    "with rotary inertia": (Gravity(), Inertia(), Coriolis(), RotaryInertia()),
    "with rotary inertia, in water": (
        *(Gravity(), Inertia(), Coriolis(), RotaryInertia()),
        *(Buoyancy(), FluidDrag(), AddedMass()),
    ),
}
COLUMNS = (
    "segments",
    "residual",
    "µs",
    "along",
    "µs",
    "Jacobian",
    "µs",
    "by AD",
    "µs",
    "ratio",
    "M C N τ",
    "µs",
)


def jacobian_by_ad(model: Model) -> ca.Function:
    """The Jacobian of the residual as CasADi differentiates its graph."""
    layout = model.layout
    sizes = {"q": layout.q, "dq": layout.dq, "ddq": layout.ddq, "p": layout.p}
    symbols = [ca.SX.sym(name, len(variables)) for name, variables in sizes.items()]
    r = model.residual(*symbols)
    blocks = [ca.jacobian(r, symbol) for symbol in symbols]
    return ca.Function("jacobian_by_ad", symbols, blocks, {"cse": True})


def microseconds(function: ca.Function, calls: int = 200) -> float:
    """Median time of a call at a random point, in CasADi's virtual machine."""
    random = np.random.default_rng(0)
    given = [ca.DM(random.uniform(-0.1, 0.1, function.size_in(k))) for k in range(function.n_in())]
    buffer, _ = function.buffer()
    arguments = [np.asarray(x, order="F") for x in given]
    results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
    for k, argument in enumerate(arguments):
        buffer.set_arg(k, memoryview(argument.reshape(-1, order="F")))
    for k, result in enumerate(results):
        buffer.set_res(k, memoryview(result))
    times = []
    for _ in range(calls):
        start = time.perf_counter()
        buffer._eval()
        times.append(time.perf_counter() - start)
    return 1e6 * median(times)


def functions(segments: int, effects: tuple[Effect, ...], by_ad: bool) -> dict[str, ca.Function]:
    """What is counted, by column."""
    model = build(Scene(chen2022(), segments=segments, effects=effects))
    found = {"residual": model.residual, "along": model.residual_along}
    found["Jacobian"] = model.residual_jacobian
    if by_ad:
        found["by AD"] = jacobian_by_ad(model)
    return found | {"M C N τ": model.equations}


def measured(
    segments: int, effects: tuple[Effect, ...], by_ad: bool
) -> dict[str, tuple[int, float]]:
    """Instructions and microseconds of a call, by column."""
    found = functions(segments, effects, by_ad)
    return {name: (executed(f), microseconds(f)) for name, f in found.items()}


def row(segments: int, found: dict[str, tuple[int, float]]) -> list[str]:
    cells = {
        name: [f"{found[name][0]:,}", f"{found[name][1]:.0f}"] if name in found else ["-", "-"]
        for name in NAMES
    }
    ratio = f"{found['by AD'][0] / found['Jacobian'][0]:.1f}" if "by AD" in found else "-"
    whole = cells.pop("M C N τ")
    return [str(segments), *(cell for two in cells.values() for cell in two), ratio, *whole]


def numbers(quick: bool) -> dict[str, float]:
    """Counts and times of the scene with rotary inertia, counts of the others; AD up to 2 or 8."""
    found: dict[str, float] = {}
    for title, effects in EFFECTS.items():
        chosen = title == DEFAULT
        for segments in SEGMENTS if chosen or not quick else (1, 2):
            own = functions(segments, effects, chosen and segments <= (2 if quick else 8))
            where = key(*(() if chosen else (title,)), f"{segments}_segments")
            for name, function in own.items():
                what = key(where, NAMES[name])
                found[f"{what}_instructions"] = executed(function)
                if chosen:
                    found[f"{what}_us"] = microseconds(function)
            if "by AD" in own:
                count = executed(own["by AD"]) / executed(own["Jacobian"])
                found[f"{where}_instructions_by_ad_over_jacobian"] = count
    return found


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--ad", type=int, default=8, help="most segments for automatic Jacobians")
    largest_ad = parser.parse_args().ad
    for title, effects in EFFECTS.items():
        print(f"\n{title}")
        print("".join(f"{name:>10}" for name in COLUMNS))
        for segments in SEGMENTS:
            found = measured(segments, effects, segments <= largest_ad)
            print("".join(f"{cell:>10}" for cell in row(segments, found)), flush=True)


if __name__ == "__main__":
    main()
