"""How large the model's functions are, and how long a call takes.

    python -m tests.benchmarks.instructions [--ad N]

For 1, 2, 4 and 8 segments a section of the paper's arm, with and without rotary inertia, and in
water: instructions executed and microseconds in a call (median) of the residual, of its derivative
along one direction (`residual_along`, linear in the segments), of its Jacobian in (q, dq, ddq) as
the model has it and by plain automatic differentiation (up to N segments, 8 unless told), and of
M, C, N, τ together. `ratio` is the Jacobian by automatic differentiation over the model's.
"""

from __future__ import annotations

import argparse
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


def row(segments: int, effects: tuple[Effect, ...], largest_ad: int) -> list[str]:
    model = build(Scene(chen2022(), segments=segments, effects=effects))
    functions: list[ca.Function | None] = [model.residual, model.residual_along]
    functions.append(model.residual_jacobian)
    functions += [jacobian_by_ad(model) if segments <= largest_ad else None, model.equations]
    cells = []
    for function in functions:
        cells += ["-", "-"] if function is None else [_count(function), _time(function)]
    ratio = "-"
    if functions[3] is not None:
        ratio = f"{executed(functions[3]) / executed(model.residual_jacobian):.1f}"
    return [str(segments), *cells[:8], ratio, *cells[8:]]


def _count(function: ca.Function) -> str:
    return f"{executed(function):,}"


def _time(function: ca.Function) -> str:
    return f"{microseconds(function):.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=_Raw)
    parser.add_argument("--ad", type=int, default=8, help="most segments for automatic Jacobians")
    largest_ad = parser.parse_args().ad
    for title, effects in EFFECTS.items():
        print(f"\n{title}")
        print("".join(f"{name:>10}" for name in COLUMNS))
        for segments in (1, 2, 4, 8):
            print("".join(f"{cell:>10}" for cell in row(segments, effects, largest_ad)), flush=True)


_Raw = argparse.RawDescriptionHelpFormatter

if __name__ == "__main__":
    main()
