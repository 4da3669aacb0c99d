"""Pictures of a plan: the motion with its limits, how it was found, and an animation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from softmpc.planning.result import INFEASIBLE, SOLVED, PlanResult
from softmpc.view.plan_animation import animate_plan
from softmpc.view.plan_search import draw_refinement
from softmpc.view.plan_space import draw_space, obstacles_of, replay_of
from softmpc.view.plan_time import draw_over_time, letters
from softmpc.view.style import ALARM, figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["animate_plan", "draw_plan", "draw_refinement"]


@styled
def draw_plan(result: PlanResult) -> Figure:
    """The arm in space from two sides, coloured by time; inputs, pressures, clearance, tip speed.

    What gives way where a plan is infeasible is marked at its time. Raises `InputError` where there
    is no motion to draw.
    """
    replay_of(result)  # there is one
    heights = (2.6, 1.5, 1.2, 1.0) if obstacles_of(result) else (3.0, 2.0, 1.3)
    made = figure(13.0, 1.0 + 1.2 * sum(heights), _title(result))
    halves: Any = made.subfigures(1, 2, width_ratios=(1, 1.5))
    left, right = halves
    draw_space(left, result)
    axes = list(right.subplots(len(heights), 1, sharex=True, height_ratios=heights))
    draw_over_time(axes, result)
    right.align_ylabels(axes)
    if result.gives_way:
        right.supxlabel(_gives_way(result), x=0.06, ha="left", color=ALARM, fontsize=8)
    return made


def _title(result: PlanResult) -> str:
    least = f"least {result.problem.least}, {result.time:.3g} s"
    name = f"{result.title}: {least}" if result.title else f"Plan of {least}"
    return name if result.status == SOLVED else f"{name} – {result.status}"


def _gives_way(result: PlanResult) -> str:
    """What gives way, with the letters that mark it."""
    head = "gives way" if result.status == INFEASIBLE else "not met"
    named = (f"{mark}: {one}" for mark, one in zip(letters(result), result.gives_way, strict=False))
    return f"{head}\n" + "\n".join(named)
