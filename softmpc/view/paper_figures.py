"""The paper's figures from our model, by name: those whose topics were computed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

from softmpc.study.paper_motions import MOTIONS
from softmpc.view.paper_limit_figures import limits_figure
from softmpc.view.paper_motion_figures import coordinates_figure, trajectory_figure
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

Draw = Callable[["PaperRuns", str], "Figure"]  # of the runs, under a title

# Name of the figure's file -> the topic it belongs to, what it shows, and what draws it.
FIGURES: dict[str, tuple[str, str, Draw]] = {
    "fig5": ("workspace", "limits without gravity", limits_figure),
    "fig6": ("fig6", MOTIONS["fig6"].title, partial(trajectory_figure, "fig6")),
    "fig7": ("fig7", MOTIONS["fig7"].title, partial(trajectory_figure, "fig7")),
    "fig8": ("fig8", MOTIONS["fig8"].title, partial(trajectory_figure, "fig8")),
    "fig10": ("fig11a", "the arm at rest", rest_postures_figure),
    "fig11": ("fig11b", "shapes at rest", rest_shapes_figure),
    "fig12": ("fig13", "where the steps end, t = 10 s", final_pose_figure),
    "fig13": ("fig13", MOTIONS["fig13"].title, partial(coordinates_figure, "fig13")),
    "fig14": ("fig14", MOTIONS["fig14"].title, partial(coordinates_figure, "fig14")),
}


def paper_figures(found: Reproduction) -> Iterator[tuple[str, Figure]]:
    """Name and figure, drawn one after the other; titles name the parameter set."""
    done = {topic.key for topic in found.topics}
    for name, (topic, shows, draw) in FIGURES.items():
        if topic in done:
            number = name.removeprefix("fig")
            yield (
                name,
                draw(found.runs, f"Fig. {number} from our model, {found.parameters}: {shows}"),
            )
