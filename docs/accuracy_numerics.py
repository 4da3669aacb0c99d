"""The accuracy page's sections on numerics and controllers, its orders and references."""

from __future__ import annotations

from accuracy_lookup import MISSING, find, length, seconds

from softmpc.accuracy.orders import TOO_FEW
from softmpc.accuracy.points import FamilyResult, Point, Study
from softmpc.accuracy.tables import order_table, piped
from softmpc.study.lengths import length_text

__all__ = ["controllers", "numerics", "orders", "references"]


def numerics(motion: FamilyResult) -> str:
    rows = [["integrator", "error of the integration", "tip error", "time a simulated second"]]
    rows += [
        [p.name, length(p, "integration_m"), length(p), seconds(p)]
        for p in motion.axis("integrator")
    ]
    coarsest = max(motion.axis("integrator"), key=_integration)
    times = [["", "Jacobian in the virtual machine", "time a simulated second", "build"]]
    for point in [*motion.axis("derivatives"), *motion.axis("compilation")]:
        jacobian, build = (point.cost.get(key) for key in ("jacobian_us", "build_s"))
        cells = [
            MISSING if jacobian is None else f"{jacobian:,.0f} µs",
            seconds(point),
            MISSING if build is None else f"{build:.2g} s",
        ]
        times.append([point.name, *cells])
    return f"""\
## What the numerics cost

Integrators beside each other, on the same model:

{piped(rows, 1)}

The tip error is that of the model, with one segment a section: the coarsest integration here,
“{coarsest.name}”, is {length(coarsest, "integration_m")} off.

How the Jacobian comes about, and what a compiler brings:

{piped(times, 1)}"""


def _integration(point: Point) -> float:
    return float(point.error.get("integration_m") or 0.0)


def controllers(loop: FamilyResult) -> str:
    given = loop.points[0]
    rows = [
        [
            "controller",
            "largest tip error",
            "RMS error",
            "on its own model",
            "step, 95 %",
            "C sources",
        ]
    ]
    rows.append(["as given", *_controller(given)])
    for axis in loop.axes:
        points = [p for p in loop.axis(axis) if not _same(p, given)]
        if points:
            rows.append([f"**{axis}**", *[""] * 5])
            rows += [[point.name, *_controller(point)] for point in points]
    one = find(loop, "controller segments", "controller with 1 segment a section")
    swings = max(one.error_m or 0.0, one.doubt_m or 0.0) > 10 * (given.error_m or 1.0)
    own = one.error.get("doubt_m") != given.error.get("doubt_m")
    told = f"it is {_doubted(one) if own else f'{length(one)} off'}"
    if swings:
        told = (
            f"it swings, {length_text(one.error_m or 0.0)} off here and by "
            f"{length_text(one.doubt_m or 0.0)} otherwise on a plant that is one step coarser"
        )
    return f"""\
## Where the controller's accuracy saturates

The scene's figure eight, tracked on a plant with more segments than any controller has. “On its own
model” is the same loop where plant and controller agree. The scene's controller has two segments a
section, looks 20 steps of 25 ms ahead, and runs uncompiled; with another step it looks as far. 95 %
of the steps take no longer than the time that is told.

{piped(rows, 1)}

On its own model the scene's controller is {length(given, "own_plant_m")} off at most. On the
fine plant it is {_doubted(given)}: so much the error moves with a plant that is one step coarser.
{_saturated(loop)}With one segment a section {told}: a controller that knows so little of its
plant and asks for so much of it works against the arm ([](tuning.md)). What a controller cannot
know, an estimate of the disturbance can tell it ([](estimation.md)).

![Controllers: error and time of a step.](images/accuracy_controllers.png)"""


def _doubted(point: Point) -> str:
    return f"{length(point)} off, in doubt by {length(point, 'doubt_m')}"


def _saturated(loop: FamilyResult) -> str:
    """Which choices do not change the error by more than the doubt of the plant."""
    given = loop.points[0]
    doubt = float(given.error.get("doubt_m") or 0.0)
    names = [
        axis
        for axis in ("horizon", "step", "stages", "solver", "iterations", "grid and blocks")
        if (others := [point for point in loop.axis(axis) if not _same(point, given)])
        and all(_apart(point, given) <= doubt for point in others)
    ]
    if not names:
        return ""
    return (
        f"Less than the doubt is what these change: {', '.join(names)}. The model's error is left. "
    )


def _apart(point: Point, given: Point) -> float:
    return abs((point.error_m or 0.0) - (given.error_m or 0.0))


def _same(point: Point, given: Point) -> bool:
    return point.configuration.identity == given.configuration.identity


def _controller(point: Point) -> list[str]:
    size = point.cost.get("c_bytes")
    return [
        length(point),
        length(point, "rms_m"),
        length(point, "own_plant_m"),
        seconds(point),
        MISSING if size is None else f"{size / 1000:.0f} kB",
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

Fitted to the three finest sizes whose errors are clear of the *doubt*: how far the reference moves
when it is made one step coarser. Sizes are lengths of a segment over that of its section; of
integrators tolerances, those of radau in m, or steps in s. [](study.md#how-to-read-the-tables) says
what the verdicts mean.

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
