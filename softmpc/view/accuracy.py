"""The pictures of an accuracy study."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from softmpc.view.accuracy_changes import changed_points, changes_figure
from softmpc.view.accuracy_choices import (
    controller_axes,
    controllers_figure,
    times_axes,
    times_figure,
)
from softmpc.view.accuracy_convergence import convergence_axes, convergence_figure
from softmpc.view.accuracy_front import front_figure, seen, work_precision_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from softmpc.accuracy.points import FamilyResult, Study

__all__ = ["KINDS", "front_figure", "study_figures"]

KINDS = ("work-precision", "convergence", "changes", "controllers", "times")  # how names begin


def study_figures(study: Study) -> dict[str, Figure]:
    """All pictures that a study has points for, by file name.

    Work and precision of each family, convergence along each axis with series, what effects and the
    drive change, controllers, and times of compilation and derivatives.
    """
    made: dict[str, Figure] = {}
    for family in study.families:
        made |= _figures(study, family)
    return made


def _figures(study: Study, family: FamilyResult) -> dict[str, Figure]:
    made = {}
    if seen(family):
        made[f"work-precision-{family.name}.png"] = work_precision_figure(family)
    for axis in convergence_axes(family):
        name = re.sub(r"[^a-z0-9]+", "-", axis.lower()).strip("-")
        made[f"convergence-{family.name}-{name}.png"] = convergence_figure(family, axis)
    if changed_points(family):
        made[f"changes-{family.name}.png"] = changes_figure(family)
    if controller_axes(family):
        made[f"controllers-{family.name}.png"] = controllers_figure(study, family)
    if times_axes(family):
        made[f"times-{family.name}.png"] = times_figure(study, family)
    return made
