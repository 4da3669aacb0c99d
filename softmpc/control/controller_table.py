"""The table [track.controller]: the problem, how it is transcribed, and who solves it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from softmpc.control.costs import Cost, StrainRate, TipPosition, Torque, TorqueRate, about_plan
from softmpc.control.limits import (
    Limit,
    PressureLimit,
    StrainLimit,
    TipBox,
    TorqueLimit,
    TorqueRateLimit,
)
from softmpc.control.ocp import PRESSURE_EXCESS, Ocp
from softmpc.control.solver import Solver
from softmpc.control.solvers import CONDENSING, SOLVERS, make_solver
from softmpc.control.transcription import Transcription
from softmpc.errors import SceneError
from softmpc.model.model import Model
from softmpc.model.scene import STRAINS, Scene
from softmpc.model.tables import Table

__all__ = ["ControllerSettings", "read_controller"]

TERMINALS = ("auto", "none", "rest")
SOFTENED = ("pressure", "strain", "tip_box")
TIP_EXCESS = 1e-3  # of the arm's length, whose square costs ½
STRAIN_EXCESS = 1e-3  # of a strain's scale
AXES = ("x", "y", "z")

Bounds = tuple[tuple[str, float, float], ...]  # names with their lowest and highest values


@dataclass(frozen=True)
class ControllerSettings:
    """What is to be minimised within which limits, how far ahead, and by which solver."""

    solver: str = "real-time"
    step: float = 0.025  # s
    horizon: int = 20
    stages: int = 2
    grid: tuple[float, ...] = ()
    blocks: tuple[int, ...] | None = None
    budget: float | None = None  # s
    terminal: str = "auto"  # "rest" where the path is left for the nearest places and these jump
    hessian: str = "gauss-newton"
    tolerance: float = 1e-6
    max_iterations: int = 50
    costs: tuple[Cost, ...] = (TipPosition(), Torque(), TorqueRate(), StrainRate())
    torque_rate: float | None = None  # a second
    tip_box: Bounds = ()
    strains: Bounds = ()
    soft: tuple[str, ...] = SOFTENED
    feed_forward: bool = True  # of a plan: what it does costs nothing
    back_off: float = 0.0  # share of their range by which limits of pressure and strain are closer
    scene: Scene | None = None

    def limits(self, model: Model) -> tuple[Limit, ...]:
        """The limits of a model's arm and those of the table."""
        arm = model.scene.manipulator.limits
        driven = model.scene.actuation.input == "torque"
        pressure = (arm.pressure_min, arm.pressure_max)
        found: list[Limit] = [
            TorqueLimit(*((arm.torque_min, arm.torque_max) if driven else pressure))
        ]
        if driven:
            pressure = self._backed_off(*pressure)
            found.append(PressureLimit(*pressure, soft=self._excess("pressure", PRESSURE_EXCESS)))
        if self.torque_rate is not None:
            most = self.torque_rate * self.step
            found.append(TorqueRateLimit(-most, most))
        for axis, low, high in self.tip_box:
            found.append(TipBox(low, high, axis=axis, soft=self._excess("tip_box", TIP_EXCESS)))
        for kind, low, high in self.strains:
            soft = self._excess("strain", STRAIN_EXCESS)
            found.append(StrainLimit(*self._backed_off(low, high), kind=kind, soft=soft))
        return tuple(found)

    def _backed_off(self, low: float, high: float) -> tuple[float, float]:
        margin = self.back_off * (high - low)
        return low + margin, high - margin

    def _excess(self, name: str, excess: float) -> float | None:
        return excess if name in self.soft else None

    def problem(self, model: Model, planned: bool = False) -> Ocp:
        """The optimal-control problem, without a cost at the end; `planned` along a plan."""
        limits = self.limits(model)
        costs = about_plan(self.costs) if planned and self.feed_forward else self.costs
        return Ocp(model, self.horizon, self.step, costs, limits, grid=self.grid)

    def make_solver(self, transcription: Transcription) -> Solver:
        """The solver of that name, with those of its options that it takes."""
        options: dict[str, Any] = {}
        if self.solver in CONDENSING:
            options["blocks"] = self.blocks
        if self.solver != "real-time":
            options |= {"tolerance": self.tolerance, "max_iterations": self.max_iterations}
        if self.solver == "ipopt":
            options["hessian"] = self.hessian
        return make_solver(self.solver, transcription, **options)


def read_controller(table: Table, scene: Scene | None = None) -> ControllerSettings:
    """Settings of a table; raises `SceneError` naming the key, what was given and is allowed."""
    step = table.number("step", ControllerSettings.step, unit="s", low=1e-3, high=1.0)
    grid, horizon = _read_grid(table)
    solver = table.string("solver", ControllerSettings.solver, SOLVERS)
    return ControllerSettings(
        solver=solver,
        step=step,
        horizon=horizon,
        stages=table.integer("stages", ControllerSettings.stages, low=1, high=5),
        grid=grid,
        blocks=_read_blocks(table, horizon, solver),
        budget=_optional(table, "budget", unit="s", low=0.0, low_open=True, high=10.0),
        terminal=table.string("terminal", ControllerSettings.terminal, TERMINALS),
        hessian=table.string("hessian", "gauss-newton", ("gauss-newton", "exact")),
        tolerance=table.number("tolerance", ControllerSettings.tolerance, low=1e-10, high=1e-2),
        max_iterations=table.integer("max_iterations", 50, low=1, high=10_000),
        costs=(
            TipPosition(_deviation(table, "tip_deviation", TipPosition.deviation, "m")),
            Torque(_deviation(table, "torque_deviation", Torque.deviation)),
            TorqueRate(_deviation(table, "torque_rate_deviation", TorqueRate.deviation)),
            StrainRate(_deviation(table, "strain_rate_deviation", StrainRate.deviation)),
        ),
        torque_rate=_optional(table, "torque_rate", low=0.0, low_open=True, high=1e12),
        tip_box=_read_bounds(table, "tip_box", AXES, "m"),
        strains=_read_bounds(table, "strains", STRAINS, ""),
        soft=table.strings("soft", SOFTENED, allowed=SOFTENED),
        feed_forward=table.boolean("feed_forward", True),
        back_off=table.number("back_off", 0.0, low=0.0, high=0.4),
        scene=scene,
    )


def _deviation(table: Table, key: str, default: float, unit: str = "") -> float:
    return table.number(key, default, unit=unit, low=1e-9, high=1e9)


def _optional(table: Table, key: str, **allowed: Any) -> float | None:
    return table.number(key, **allowed) if key in table else None


def _read_grid(table: Table) -> tuple[tuple[float, ...], int]:
    """Lengths of the intervals in steps, and how many there are."""
    if "grid" not in table:
        return (), table.integer("horizon", ControllerSettings.horizon, low=1, high=500)
    grid = table.vector("grid", None, low=1.0, high=1e4)
    horizon = table.integer("horizon", len(grid), low=1, high=500)
    if horizon != len(grid):
        raise SceneError(
            f"{table.where} grid has {len(grid)} lengths for a horizon of {horizon} intervals: "
            "give one for each, or leave horizon out"
        )
    if grid[0] != 1.0:
        raise table.error("grid", list(grid), "a list that begins with 1, the controller's step")
    return grid, horizon


def _read_blocks(table: Table, horizon: int, solver: str) -> tuple[int, ...] | None:
    """How many intervals share each move."""
    if "blocks" not in table:
        return None
    if solver not in CONDENSING:
        raise SceneError(
            f"{table.where} blocks: the solver {solver!r} shares no moves; leave them out, or take "
            f"{' or '.join(CONDENSING)}"
        )
    given = table.vector("blocks", None, low=1.0, high=500.0)
    blocks = tuple(int(count) for count in given)
    if any(a != b for a, b in zip(blocks, given, strict=True)) or sum(blocks) != horizon:
        wanted = f"a list of whole numbers that add up to the {horizon} intervals of the horizon"
        raise table.error("blocks", list(given), wanted)
    return blocks


def _read_bounds(table: Table, key: str, names: tuple[str, ...], unit: str) -> Bounds:
    """Lowest and highest values by name, such as {z = [0.4, 0.6]}."""
    inner = Table(table.raw(key, {}), f"{table.where} {key}")
    found = []
    for name in names:
        if name in inner:
            low, high = inner.vector(name, 2, unit=unit)
            if not low < high:
                raise inner.error(name, [low, high], "two numbers, the lower one first")
            found.append((name, low, high))
    inner.finish()
    return tuple(found)
