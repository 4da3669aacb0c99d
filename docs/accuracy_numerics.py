"""The accuracy page's sections on numerics and controllers, its orders and references."""

from __future__ import annotations

from accuracy_lookup import MISSING, find, length, seconds

from softmpc.accuracy.orders import TOO_FEW
from softmpc.accuracy.points import FamilyResult, Point, Study
from softmpc.accuracy.tables import order_table, piped

__all__ = ["controllers", "numerics", "orders", "references"]


def numerics(motion: FamilyResult) -> str:
    rows = [["integrator", "error of the integration", "tip error", "time a simulated second"]]
    rows += [
        [p.name, length(p, "integration_m"), length(p), seconds(p)]
        for p in motion.axis("integrator")
    ]
    times = [["", "Jacobian in the virtual machine", "time a simulated second", "build"]]
    for point in [*motion.axis("derivatives"), *motion.axis("compilation")]:
        jacobian, build = (point.cost.get(key) for key in ("jacobian_us", "build_s"))
        cells = [
            MISSING if jacobian is None else f"{jacobian:.3g} µs",
            seconds(point),
            MISSING if build is None else f"{build:.2g} s",
        ]
        times.append([point.name, *cells])
    return f"""\
## What the numerics cost

Integrators beside each other, on the same model:

{piped(rows, 1)}

How the Jacobian comes about, and what a compiler brings:

{piped(times, 1)}"""


def controllers(loop: FamilyResult) -> str:
    given = loop.points[0]
    rows = [["controller", "largest tip error", "RMS", "on its own model", "step, 95 %", "C"]]
    rows.append(["as given", *_controller(given)])
    for axis in loop.axes:
        points = [p for p in loop.axis(axis) if not _same(p, given)]
        if points:
            rows.append([f"**{axis}**", *[""] * 5])
            rows += [[point.name, *_controller(point)] for point in points]
    one = find(loop, "controller segments", "controller with 1 segment a section")
    swings = (one.error_m or 0.0) > 10 * (given.error_m or 1.0)
    told = f"it swings, {length(one)} off" if swings else f"it is {length(one)} off"
    return f"""\
## Where the controller's accuracy saturates

The scene's figure eight, tracked on a plant with more segments than any controller has. “On its own
model” is the same loop where plant and controller agree. The scene's controller has two segments a
section, looks 20 steps of 25 ms ahead, and runs uncompiled.

{piped(rows, 1)}

On its own model the scene's controller is {length(given, "own_plant_m")} off at most, and
{length(given)} on the fine plant. A longer horizon, a shorter step or a converged solver change the
former alone: the model's error is what is left. With one segment a section {told}: a controller
that knows so little of its plant and asks for so much of it works against the arm ([](tuning.md)).
What a controller cannot know, an estimate of the disturbance can tell it ([](estimation.md)).

![Controllers: error and time of a step.](images/accuracy_controllers.png)"""


def _same(point: Point, given: Point) -> bool:
    return point.configuration.identity == given.configuration.identity


def _controller(point: Point) -> list[str]:
    size = point.cost.get("c_bytes")
    return [
        length(point),
        length(point, "rms_m"),
        length(point, "own_plant_m"),
        seconds(point),
        MISSING if size is None else f"{size / 1024:.0f} KiB",
    ]


def orders(study: Study) -> str:
    rows: list[list[str]] = []
    for family in study.families:
        head, *body = order_table(family) or [[]]
        if not rows:
            rows.append(["family", *head])
        rows += [[family.name, *row] for row in body if TOO_FEW not in row]
    return f"""\
## Orders of convergence

Fitted to the three finest sizes that are clear of the doubt of what they are measured against:

{piped(rows, 4)}"""


def references(study: Study) -> str:
    told = []
    for family in study.families:
        texts: dict[str, list[str]] = {}
        for name, text in family.references.items():
            if text:
                texts.setdefault(text, []).append(name)
        told += [
            f"- **{family.name}**, {', '.join(names)}: {text}" for text, names in texts.items()
        ]
    listed = "\n".join(told)
    return f"""\
## What was measured against what

{listed}

How points are measured, how times are kept alone on their core, and what the files hold is on
[](study.md)."""
