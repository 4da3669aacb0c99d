"""The paper's figures from our model, by name: those whose topics were computed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

from softmpc.view.paper_motion_figures import coordinates_figure, motion_title, trajectory_figure
from softmpc.view.paper_posture_figures import (
    final_pose_figure,
    rest_postures_figure,
    rest_shapes_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softmpc.study.paper_readings import PaperRuns
    from softmpc.study.reproduce import Reproduction

__all__ = ["FIGURES", "paper_figures"]

Draw = Callable[["PaperRuns"], "Figure"]


def _motion(draw: Callable[[PaperRuns, str, str], Figure], name: str) -> Draw:
    return lambda runs: draw(runs, name, motion_title(name))


# Name of the figure's file -> the topic it belongs to, and what draws it.
FIGURES: dict[str, tuple[str, Draw]] = {
    "fig6": ("fig6", _motion(trajectory_figure, "fig6")),
    "fig7": ("fig7", _motion(trajectory_figure, "fig7")),
    "fig8": ("fig8", _motion(trajectory_figure, "fig8")),
    "fig10": (
        "fig11a",
        partial(rest_postures_figure, title="Fig. 10 from our model: the arm at rest"),
    ),
    "fig11": (
        "fig11b",
        partial(rest_shapes_figure, title="Fig. 11 from our model: shapes at rest"),
    ),
    "fig12": (
        "fig13",
        partial(final_pose_figure, title="Fig. 12 from our model: where the steps end, t = 10 s"),
    ),
    "fig13": ("fig13", _motion(coordinates_figure, "fig13")),
    "fig14": ("fig14", _motion(coordinates_figure, "fig14")),
}


def paper_figures(found: Reproduction) -> Iterator[tuple[str, Figure]]:
    """Name and figure, drawn one after the other."""
    done = {topic.key for topic in found.topics}
    for name, (topic, draw) in FIGURES.items():
        if topic in done:
            yield name, draw(found.runs)
