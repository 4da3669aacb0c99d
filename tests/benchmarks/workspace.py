"""Workspaces put to the test: no posture outside, no point out of reach, how exact, how long?

    python -m tests.benchmarks.workspace [--samples 10000] [--azimuths 24] [--polars 13] [--quick]

One section and both sections of the paper's arm, and an arm of three sections of other sizes, each
without and with a load at the tip. For each: seconds (all usable cores), and seconds of all
processes together, which a busy machine changes less; volume in litres and what leaving out every
second node changes; points of both surfaces; the check with random admissible pressures that the
search has not seen, half of them with units at their limits:

outside   how far a place is beyond what a search along its own ray finds, started from the edge,
          not from the posture; mm, the farthest
searched  places that needed such a search; the others are between the surfaces
by grid   how far a place is beyond the surfaces as they are drawn, linear between nodes; mm
off       how far a point is from where forward statics, begun anew, holds the tip; mm
bad       points off by more than 0.01 mm, not stable, or beyond the pressures
filled    share of random places between the surfaces that inverse statics reaches
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from softmpc.model.effects import TipLoad
from softmpc.model.model import build
from softmpc.model.parameters import Manipulator
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene, default_effects
from softmpc.statics.workspace import find_workspace
from softmpc.statics.workspace_check import check_workspace
from tests.benchmarks.common import arguments, key

LOAD = TipLoad(force=(0.6, -0.4, 1.0))
INSIDE = 200  # places between the surfaces
HEAD = (
    "arm", "s", "cpu s", "volume l", "± l", "points", "samples", "searched", "outside", "by grid",
    "off", "bad", "filled",
)  # fmt: skip
FORMATS = (".1f", ".1f", ".2f", ".2f", "d", "d", "d", ".1e", ".1f", ".1e", "d", ".1%")


def three_sections() -> Manipulator:
    """An arm of three sections, each of its own size."""
    paper, section = chen2022(), chen2022().sections[0]
    turned = tuple(np.radians([60.0, 180.0, 300.0]))
    sizes = (
        replace(section, length=0.3, mass=0.7, bending_radius=0.034),
        replace(section, length=0.2, mass=0.35, unit_angles=turned),
        replace(section, length=0.12, mass=0.15, unit_offset=0.014, bending_radius=0.026),
    )
    return replace(paper, sections=sizes)


def scenes() -> Iterator[tuple[str, Scene]]:
    """All arms without and with a load."""
    paper = chen2022()
    arms = {
        "one section": replace(paper, sections=paper.sections[:1]),
        "two sections": paper,
        "three sections": three_sections(),
    }
    for name, arm in arms.items():
        yield name, Scene(arm)
        yield f"{name}, load", Scene(arm, effects=(*default_effects(), LOAD))


def cpu_seconds() -> float:
    """Time that this process and those it waited for have computed."""
    spent = os.times()
    return spent.user + spent.children_user


def measured(scene: Scene, azimuths: int, polars: int, samples: int) -> dict[str, float]:
    """The columns of one arm."""
    model = build(scene)
    before = cpu_seconds()
    space = find_workspace(model, azimuths=azimuths, polars=polars)
    took = cpu_seconds() - before
    found = check_workspace(model, space, samples, seed=100, inside=INSIDE)
    return {
        "s": space.wall_s,
        "cpu_s": took,
        "volume_l": 1e3 * space.volume,
        "volume_error_l": 1e3 * space.volume_error,
        "points_count": found.points,
        "samples_count": found.samples,
        "searched_count": found.searched,
        "outside_mm": 1e3 * found.outside,
        "by_grid_mm": 1e3 * found.by_grid,
        "off_mm": 1e3 * found.off,
        "bad_count": found.unreachable,
        "filled_share": found.filled,
    }


def numbers(quick: bool) -> dict[str, float]:
    """Two sections on a coarse grid in quick mode; else all arms as printed."""
    chosen = {name: scene for name, scene in scenes() if not quick or name == "two sections"}
    grid = (8, 7, 500) if quick else (24, 13, 10_000)
    found = {name: measured(scene, *grid) for name, scene in chosen.items()}
    return {key(name, what): v for name, each in found.items() for what, v in each.items()}


def main() -> None:
    """Print the table."""
    parser = arguments(__doc__)
    parser.add_argument("--samples", type=int, default=10_000)
    parser.add_argument("--azimuths", type=int, default=24)
    parser.add_argument("--polars", type=int, default=13)
    parser.add_argument("--only", help="arms whose name contains this")
    parser.add_argument("--quick", action="store_true", help="a coarse grid and 500 samples")
    given = parser.parse_args()
    grid = (8, 7, 500) if given.quick else (given.azimuths, given.polars, given.samples)
    widths = (22, 6, 7, 9, 7, 7, 8, 9, 10, 8, 9, 4, 8)
    print("".join(f"{h:>{w}}" for h, w in zip(HEAD, widths, strict=True)))
    for name, scene in scenes():
        if given.only and given.only not in name:
            continue
        values = measured(scene, *grid).values()
        cells = [name, *(format(v, how) for v, how in zip(values, FORMATS, strict=True))]
        print("".join(f"{c:>{w}}" for c, w in zip(cells, widths, strict=True)), flush=True)


if __name__ == "__main__":
    main()
