"""The text of the accuracy page: what a stored study says, section by section.

Every number comes from the study. What a sentence claims is looked up too, so that a study that
says otherwise gives another sentence, or an error.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from accuracy_lookup import MISSING, along, length, ratio, seconds, segment_table, wrapped
from accuracy_numerics import controllers, numerics, orders, references

from softmpc.accuracy.front import front
from softmpc.accuracy.orders import DIVERGES, fits
from softmpc.accuracy.points import FamilyResult, Point, Study
from softmpc.accuracy.tables import machine_text, piped
from softmpc.study.lengths import length_text

__all__ = ["story"]

OVER_GIVEN = "time over that of the scene as given"


def story(study: Study) -> str:
    """The whole page, pictures as links to docs/images."""
    rest, motion, loop = (study.family(name) for name in ("rest", "motion", "loop"))
    parts = [
        _head(study),
        _front(motion),
        _segments(rest),
        _transmission(rest),
        _rates(rest),
        _motion(motion),
        _hydraulics(motion),
        numerics(motion),
        controllers(loop),
        orders(study),
        references(study),
    ]
    return "\n\n".join(map(wrapped, parts)) + "\n"


# ---------------------------------------------------------------- sections


def _head(study: Study) -> str:
    mode, machine = "in quick mode" if study.quick else "in full", machine_text(study.machine)
    asked = "softmpc study examples/accuracy.toml" + (" --quick" if study.quick else "")
    return f"""\
# What accuracy costs

How exact is a model, what does that cost, and when does more of it no longer help? This
page is one study of one scene, measured {mode}: `examples/accuracy.toml`, the paper's arm under
torques that bend it out of plane, and a figure eight to track.

```bash
{asked} --out out/accuracy
```

The same command does it for your own arm ([](study.md)), and `softmpc choose` picks the cheapest
configuration within your tolerance ([](choose.md)). Every number and picture here is written from
one stored run by `python docs/make_accuracy.py`.

The scene as given has one segment a section with two Gauss points of mass, virtual power, arcs of
constant strain, and Radau IIA within 1 µm a step; nothing is compiled. Names below say what differs
from that. Equations in parentheses are the paper's.

{machine[0].upper()}{machine[1:]}. Times are medians; compare them with each other
rather than with those of other machines."""


def _front(motion: FamilyResult) -> str:
    best = front(motion).points
    rows = [["configuration", "tip error", "time a simulated second", OVER_GIVEN]]
    rows += [[p.name, length(p), seconds(p), ratio(p)] for p in best]
    return f"""\
## In one picture

Each point is one way to simulate the scene's motion: its largest tip error against a fine model,
and the time for a second of motion. Nothing that was measured lies below and to the left of the
line. What is not called compiled runs in CasADi's virtual machine.

![Tip error over time, and the Pareto front.](images/accuracy_front.png)

{piped(rows, 1)}"""


def _segments(rest: FamilyResult) -> str:
    names = ("lumped mass", "1 Gauss point", "2 Gauss points", "3 Gauss points")
    known = {name: along(rest, "segments and mass", name) for name in names}
    rows = {name: points for name, points in known.items() if points}
    one, eight = rows["2 Gauss points"][1], rows["lumped mass"][8]
    better = (eight.error_m or 0.0) / (one.error_m or 1.0)
    cheaper = (eight.time_s or 0.0) / (one.time_s or 1.0)
    postures = len(one.error["by_posture_m"])
    verdict = "beats" if better > 1 and cheaper > 1 else "does not beat"
    return f"""\
## Where the mass of a segment is

At rest, against a rod without segments: the largest distance of a section tip, over {postures}
postures.

{segment_table(rows, "error_m")}

**One segment with two Gauss points {verdict} eight with lumped mass**: {length(one)} against
{length(eight)}, with a residual and its Jacobian in {seconds(one)} against {seconds(eight)}, a
factor of {cheaper:.0f}. Lumped mass halves its error with each doubling of the segments, Gauss
points quarter it.

![Tip error at rest over the size of a segment.](images/accuracy_segments.png)"""


def _transmission(rest: FamilyResult) -> str:
    names = {
        "Newton-Euler, as printed": ("formulation", "Newton-Euler, as printed"),
        "Newton-Euler, full wrench": ("formulation", "Newton-Euler, full wrench"),
        "virtual power, lumped mass": ("segments and mass", "lumped mass"),
    }
    rows = {name: along(rest, *where) for name, where in names.items()}
    shown = sorted({n for points in rows.values() for n in points})
    table = [["lowest frequency without pressure, off by", *map(str, shown)]]
    for name, points in rows.items():
        table.append([name, *(_lowest(points.get(n)) for n in shown)])
    flagged = {fit.series for fit in fits(rest) if fit.verdict == DIVERGES}
    says = "flags" if "Newton-Euler, as printed" in flagged else "does not flag"
    return f"""\
## The printed transmission does not converge

A segment hands on what the next one does to it. Equation (22) keeps the axial force and the moment
and drops shear. More segments do not help then:

{segment_table(rows, "error_m")}

{piped(table, 1)}

The study {says} the printed form, by its numbers alone. With the whole wrench the same balance
converges, at first order, as virtual power with lumped mass does. Both Newton-Euler forms have a
mass matrix that is not symmetric; see [](equations.md#what-the-formulations-are-worth).

![Convergence of the formulations.](images/accuracy_formulation.png)"""


def _lowest(point: Point | None) -> str:
    """Relative error of the lowest frequency of the hanging arm."""
    found = None if point is None else point.error.get("frequency_errors")
    return MISSING if not found else f"{100 * found['frequencies without pressure'][0]:.3g} %"


def _rates(rest: FamilyResult) -> str:
    axis = "angular velocity"
    printed = next(p.configuration.series for p in rest.axis(axis) if p.configuration.variant)
    rows = {
        "ω = θ̇, as Eqs (5) and (6) have it": along(rest, axis, printed),
        "exact ω": along(rest, "segments and mass", "2 Gauss points"),
    }
    orders = {fit.series: fit.order for fit in fits(rest) if fit.key == "error_m"}
    told = f"{orders[printed] or 0.0:.2f} instead of {orders['2 Gauss points'] or 0.0:.2f}"
    return f"""\
## ω = θ̇ costs an order

The rate of the rotation vector is the angular velocity only while its axis stands still. Out of
plane it does not. If velocities are propagated with it, the fitted order is {told}:

{segment_table(rows, "error_m")}"""


def _motion(motion: FamilyResult) -> str:
    rows = {
        series: along(motion, axis, series)
        for axis in ("segments and mass", "formulation", "kinematics")
        for series in dict.fromkeys(p.configuration.series for p in motion.axis(axis))
        if series
    }
    return f"""\
## In motion

The largest error of a section tip over the scene's motion. What takes too long to be run is left
out; the paper arc of (3) bends first and twists after. The reference: {motion.references["fine"]}.

{segment_table(rows, "error_m")}"""


def _change(point: Point) -> float:
    return float(point.error.get("change_m") or point.error_m or 0.0)


def _changes(points: Iterable[Point]) -> str:
    known = [p for p in points if p.error.get("change_m") is not None]
    rows = [["change", "moves the tip by", OVER_GIVEN]]
    rows += [[p.name, length_text(_change(p)), ratio(p)] for p in sorted(known, key=_change)[::-1]]
    return piped(rows, 1)


def _hydraulics(motion: FamilyResult) -> str:
    drive = motion.axis("drive")
    added = [p for p in drive if p.name.startswith("with ")]
    coarser = [p for p in drive if p not in added]
    farthest = max(added, key=_change)
    one = along(motion, "segments and mass", "2 Gauss points")[1]
    times = _change(farthest) / (one.error_m or 1.0)
    return f"""\
## What hydraulics detail changes

The drive of (36) is stiff. What coarser drives change, as the largest distance over the motion from
the scene as given, and what they save:

{_changes(coarser)}

What the paper's hydraulics leave out, added one by one to the scene as given:

{_changes(added)}

The friction is an example, not a measurement. The largest change, “{farthest.name}”, is
{times:.1f} times the error of one segment with two Gauss points ({length(one)}): more segments do
not help a model that leaves out such hydraulics. See [](hydraulics.md).

## What the effects change

Names are those of scene files, see [](effects.md):

{_changes([*motion.axis("effects"), *motion.axis("strains")])}

Beyond the paper:

{_changes(motion.axis("effects added"))}

![What effects and the drive change.](images/accuracy_changes.png)"""
