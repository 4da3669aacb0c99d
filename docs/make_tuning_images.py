"""Draw the pictures of the tuning page: `python docs/make_tuning_images.py [FOLDER]`.

Closed loops of the paper's arm on a circle of 120 mm, 1.5 s a lap, with one setting of the
controller changed at a time; all numbers are printed. Three plants:

    same      the controller's model, its state known exactly
    noisy     the same, but the state has noise of 0.1 % of each state's scale, seeded
    stiffer   the rubber is 5 % stiffer than the controller knows, the state exact

Then a table of grids, blocks and ends of the horizon, with the CPU time that a step takes. Loops
that chatter or diverge differ from machine to machine.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from make_motion_images import ROOT, save
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from softmpc.cli.common import progress
from softmpc.control.controller_table import ControllerSettings
from softmpc.control.costs import Cost, StrainRate, TipPosition, Torque, TorqueRate
from softmpc.control.mpc import Mpc, Step
from softmpc.control.paths import Circle, Reference, TimeLaw
from softmpc.control.track_scene import Plant, Tracking
from softmpc.control.tracking import Setup, make_mpc, set_up
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.simulation.methods import Method
from softmpc.sweeps import sweep
from softmpc.view.style import COLOURS, DASHES, INK, figure, label, styled
from softmpc.view.time_plots import plain_log

SETTLE = 1.0  # s, not counted
NOISE, STIFFER = 1e-3, 1.05
AHEAD = 0.5  # s of horizon, where the step is changed
PLANTS = {
    "same": "plant as the model",
    "noisy": "state with 0.1 % noise",
    "stiffer": "rubber 5 % stiffer",
}
WEIGHTS: dict[str, tuple[str, tuple[float, ...]]] = {
    "tip_deviation": ("tip deviation (mm)", (0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100)),
    "torque_rate_deviation": (
        "torque rate deviation",
        (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10),
    ),
    "strain_rate_deviation": ("strain rate deviation", (0.003, 0.01, 0.03, 0.1, 0.3, 1, 3)),
    "torque_deviation": ("torque deviation", (0.03, 0.1, 0.3, 1, 3, 10, 30)),
}
TIMING: dict[str, tuple[str, tuple[float, ...]]] = {
    "horizon": ("horizon N (steps of 25 ms)", (1, 2, 3, 4, 6, 10, 20, 40)),
    "step": ("step (ms), horizon 0.5 s", (12.5, 20, 25, 40, 50, 100)),
}
DEFAULTS = {
    "tip_deviation": 1, "torque_rate_deviation": 0.1, "strain_rate_deviation": 0.3,
    "torque_deviation": 3, "horizon": 20, "step": 25,
}  # fmt: skip
MEASURES = ("RMS tip error (mm)", "RMS torque rate (N·m/s)")


def settings_of(name: str, value: float) -> ControllerSettings:
    """The default controller with one setting changed; lengths in mm, times in ms."""
    given = DEFAULTS | {name: value}
    step = 1e-3 * given["step"]
    costs: tuple[Cost, ...] = (
        TipPosition(1e-3 * given["tip_deviation"]),
        Torque(given["torque_deviation"]),
        TorqueRate(given["torque_rate_deviation"] * given["step"] / DEFAULTS["step"]),
        StrainRate(given["strain_rate_deviation"]),
    )
    horizon = round(AHEAD / step) if name == "step" else int(given["horizon"])
    return ControllerSettings(step=step, horizon=horizon, costs=costs)


VARIANTS: dict[str, dict[str, Any]] = {
    "20 intervals": {},
    "blocks 1 1 2 4 12": {"blocks": (1, 1, 2, 4, 12)},
    "grid 1 1 1 1 2 2 4 4 4": {"grid": (1, 1, 1, 1, 2, 2, 4, 4, 4), "horizon": 9},
    "5 intervals": {"horizon": 5},
    "5 intervals, terminal": {"horizon": 5, "terminal": "rest"},
    "2 intervals": {"horizon": 2},
    "2 intervals, terminal": {"horizon": 2, "terminal": "rest"},
    "1 stage": {"stages": 1},
    "3 stages": {"stages": 3},
    "tip deviation 0.01 mm": {"costs": settings_of("tip_deviation", 0.01).costs},
    "the same, sqp": {"costs": settings_of("tip_deviation", 0.01).costs, "solver": "sqp"},
}


@cache
def setup_of(plant: str) -> Setup:
    """The task on one plant, once a process."""
    arm = chen2022()
    stiffer = tuple(replace(s, young_modulus=STIFFER * s.young_modulus) for s in arm.sections)
    other = Scene(replace(arm, sections=stiffer)) if plant == "stiffer" else None
    reference = Reference(Circle((0.12, 0.0, 0.57), 0.12), TimeLaw(1.5, 1.5, 0.75))
    method = Method("idas", tolerance=1e-7)
    return set_up(Scene(arm), Tracking(reference, SETTLE, plant=Plant(other, method)))


class Told:
    """A controller that is told the state with noise, and keeps the CPU time of its steps."""

    def __init__(self, controller: Mpc, noise: float) -> None:
        self.controller, self.ocp = controller, controller.ocp
        self.amount = noise * controller.ocp.model.layout.x.scale

    def reset(self) -> None:
        self.random, self.seconds = np.random.default_rng(1), list[float]()
        self.controller.reset()

    def step(self, x: Any, u_before: Any, given: Any) -> Step:
        noise, began = self.amount * self.random.standard_normal(len(x)), time.process_time()
        found = self.controller.step(x + noise, u_before, given)
        self.seconds.append(time.process_time() - began)
        return found


def closed_loop(plant: str, settings: ControllerSettings) -> list[float]:
    """Error (mm), torque rate (N·m/s), failed steps, median CPU time of a step (ms)."""
    setup = setup_of(plant)
    problem = settings.problem(setup.ocp.model)
    controller = make_mpc(problem, settings, setup.preflight.rest, setup.guide.project)
    told = Told(controller, NOISE if plant == "noisy" else 0.0)
    result = setup.run(told)
    error = 1e3 * result.error[result.time >= SETTLE]
    counted = result.control_time[1:] >= SETTLE
    rates = np.diff(result.u, axis=0)[counted] / settings.step
    rms = [float(np.sqrt(np.mean(x**2))) for x in (error, rates)]
    return [*rms, result.failures, 1e3 * float(np.median(told.seconds))]


def loop(case: tuple[str, str, float]) -> list[float]:
    """The numbers of one case: plant, setting, value."""
    plant, name, value = case
    return closed_loop(plant, settings_of(name, value))


@styled
def sensitivity_figure(asked: dict[str, Any], found: dict[Any, list[float]], title: str) -> Figure:
    """Error above torque rate, a column for each setting, a line for each plant."""
    made = figure(3.1 * len(asked), 5.6, title)
    grid: Any = made.subplots(2, len(asked), sharey="row", sharex="col", squeeze=False)
    for column, (name, (words, values)) in enumerate(asked.items()):
        for row, axes in enumerate(grid[:, column]):
            for k, (plant, meaning) in enumerate(PLANTS.items()):
                line = [found[plant, name, value][row] for value in values]
                style = {"color": COLOURS[k], "linestyle": DASHES[k], "marker": "o"}
                axes.loglog(values, line, markersize=3, label=meaning, **style)
            default = {"color": INK, "linewidth": 0.8, "linestyle": DASHES[2], "zorder": 1}
            axes.axvline(DEFAULTS[name], label="default", **default)
            axes.xaxis.set_major_locator(FixedLocator(values[::2] if len(values) > 6 else values))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axes.xaxis.set_minor_locator(NullLocator())
            label(axes, words if row else "", "" if column else MEASURES[row])
    for axes in grid[:, 0]:
        plain_log(axes)
    handles, names = grid[0, 0].get_legend_handles_labels()
    made.legend(handles, names, loc="outside lower center", ncols=len(names))
    return made


def all_loops() -> dict[Any, list[float]]:
    """All cases by plant, setting and value; printed."""
    every = WEIGHTS | TIMING
    cases = [
        (plant, name, value) for plant in PLANTS for name, (_, v) in every.items() for value in v
    ]
    with progress("closed loops", "loop") as report:
        results = sweep(loop, cases, chunk=1, progress=report)
    found = dict(zip(cases, results, strict=True))
    print(f"{'setting':22} {'value':>7}  " + "  ".join(f"{name:^24}" for name in PLANTS))
    print(f"{'':30}  " + "  ".join(f"{'mm':>9} {'N·m/s':>7} {'failed':>6}" for _ in PLANTS))
    for name, (_, values) in every.items():
        for value in values:
            cells = (found[plant, name, value] for plant in PLANTS)
            line = "  ".join(f"{e:9.4f} {r:7.3f} {int(n):6}" for e, r, n, _ in cells)
            print(f"{name:22} {value:7g}  {line}")
    return found


def print_variants() -> None:
    """Grids, blocks and ends of the horizon, on the plant that is as the model."""
    print(f"\n{'':24} {'mm':>9} {'N·m/s':>7} {'failed':>6} {'CPU of a step (ms)':>18}")
    for name, changes in VARIANTS.items():
        error, rate, failed, median = closed_loop("same", ControllerSettings(**changes))
        print(f"{name:24} {error:9.4f} {rate:7.3f} {int(failed):6} {median:18.2f}", flush=True)


def main() -> None:
    """Write the pictures to a folder, by default docs/images."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    found = all_loops()
    title = "Circle of 120 mm, 1.5 s a lap: what each allowed deviation does"
    save(sensitivity_figure(WEIGHTS, found, title), folder / "tuning_weights.png")
    title = "Circle of 120 mm, 1.5 s a lap: horizon and step"
    save(sensitivity_figure(TIMING, found, title), folder / "tuning_timing.png")
    print_variants()


if __name__ == "__main__":
    main()
