"""Rows of the arm at rest: the drive and the limits of section 3.1, the postures of section 4.2."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, hypot, pi, radians

import numpy as np

from softmpc.model.hydraulics import screw_advance, screw_ratio
from softmpc.model.model import Model
from softmpc.model.parameters import Hydraulics
from softmpc.statics.equilibrium import Equilibrium, find_equilibrium
from softmpc.study.paper_motions import UNITS
from softmpc.study.paper_readings import (
    AS_PRINTED,
    AS_READ,
    FINE,
    OURS,
    PRINTED_EFFICIENCY,
    READINGS,
    PaperRuns,
    screw_as_printed,
    section_bends,
)
from softmpc.study.reproduce_records import Printed, Row, Topic

__all__ = [
    "FULL", "LIMIT_POSTURES", "REST_TORQUES", "drive", "limit_minus_x", "limit_plus_x",
    "limit_posture", "rests_of_unit_1", "rests_of_unit_4", "workspace",
]  # fmt: skip

FULL = 1e6  # Pa, the largest pressure of section 3.1
TORQUE = 2.5  # N·m, which it belongs to
REST_TORQUES = (0.5, 1.0, 1.5, 2.0)  # N·m, section 4.2
LIMIT_POSTURES = {"all units": (1, 2, 3, 4, 5, 6), "1, 5, 6": (1, 5, 6), "2, 3, 4": (2, 3, 4)}
STATIC = (AS_PRINTED, AS_READ, OURS)


def drive(runs: PaperRuns) -> Topic:
    """2.5 N·m of motor torque and 1 MPa belong together."""
    own = runs.arm.hydraulics
    drives = {
        AS_PRINTED: screw_as_printed(own),
        AS_READ: replace(own, screw="lead/2pi", efficiency=PRINTED_EFFICIENCY),
        OURS: own,
    }
    gains = {name: _gain(h) for name, h in drives.items()}
    needed = FULL * own.piston_area * own.screw_lead / (2 * pi * TORQUE)
    return Topic(
        key="drive",
        title="motor torque and pressure at rest",
        where="3.1",
        rows=(
            Row(
                f"pressure at {TORQUE:g} N·m",
                "MPa",
                {name: (1e-6 * gain * TORQUE,) for name, gain in gains.items()},
                Printed(1e-6 * FULL),
            ),
            Row(
                "torque for 1 MPa",
                "N·m",
                {name: (FULL / gain,) for name, gain in gains.items()},
                Printed(TORQUE),
            ),
        ),
        why="(33) takes the lead for the advance a radian, which is 2π times too much. With "
        f"lead/2π the printed η = {PRINTED_EFFICIENCY:g} holds too much pressure; the printed pair "
        f"needs η = {needed:.3f}. The set has {own.efficiency:.3g}.",
        readings={name: _drive_text(h) for name, h in drives.items()},
    )


def _gain(hydraulics: Hydraulics) -> float:
    """Pressure over torque at rest, Pa/(N·m); friction, which holds either way, left out."""
    return screw_ratio(hydraulics) / hydraulics.piston_area


def _drive_text(hydraulics: Hydraulics) -> str:
    advance = 1e3 * screw_advance(hydraulics)
    return f"(33) with s = {advance:.4g} mm, η = {hydraulics.efficiency:.3g}"


# ---------------------------------------------------------------- limits of one section


def limit_plus_x(runs: PaperRuns) -> Topic:
    """Units 2 and 3 at the largest pressure."""
    return _limit(
        runs,
        "limit+x",
        (0.0, FULL, FULL),
        (165.7, 0.401, 0.139),
        "The three printed numbers agree with each other. The radius is A_d P r_d against the "
        "bending stiffness, and the set's bending radius was chosen for it, so it proves nothing. "
        "No reading of (17) gives both printed arcs.",
    )


def limit_minus_x(runs: PaperRuns) -> Topic:
    """Unit 1 at the largest pressure."""
    topic = _limit(
        runs,
        "limit-x",
        (FULL, 0.0, 0.0),
        (168.0, 0.473, 0.136),
        f"168° at a radius of 0.136 m make an arc of {radians(168) * 0.136:.3f} m, not the printed "
        "one. (17) as printed meets the printed arc, perhaps by chance, for it misses the angle "
        "and the other limit. Unit 1 bends as much as 2 and 3 together, but it stretches the "
        "section half as much, so its angle is the smaller one by every reading, not the larger.",
    )
    arcs = topic.rows[1].values
    own = Row("arc, against angle times radius", "m", arcs, Printed(radians(168) * 0.136))
    return replace(topic, rows=(*topic.rows, replace(own, printed=_rounded(own.printed))))


def _rounded(printed: Printed | None) -> Printed | None:
    return replace(printed, text=f"{printed.value:.3f}") if printed else None


def _limit(
    runs: PaperRuns,
    key: str,
    pressures: tuple[float, ...],
    printed: tuple[float, float, float],
    why: str,
) -> Topic:
    """Angle, arc and radius of one section without weight."""
    shapes = {}
    for reading in STATIC:
        rest = find_equilibrium(runs.weightless(reading, 1), pressures)
        shapes[reading] = _shape(runs.arm.sections[0].length, rest)
    whats = (("bending angle", "°", 1), ("arc", "m", 3), ("radius", "m", 3))
    rows = tuple(
        Row(what, unit, {name: (s[i],) for name, s in shapes.items()}, Printed(printed[i]), digits)
        for i, (what, unit, digits) in enumerate(whats)
    )
    sides = {"limit+x": "+x", "limit-x": "−x"}
    shown = ", ".join(f"{p / FULL:g}" for p in pressures)
    return Topic(
        key=key,
        title=f"{sides[key]} limit of one section, P = ({shown}) MPa, no gravity",
        where="3.1, Fig. 5b",
        rows=rows,
        why=why,
        readings={name: READINGS[name] for name in STATIC},
    )


def _shape(length: float, rest: Equilibrium) -> tuple[float, float, float]:
    """Angle (deg), arc (m) and radius (m) of a section of one segment; nan without a rest."""
    if not rest.converged:
        return (np.nan,) * 3
    epsilon, kappa_x, kappa_y, _ = rest.q.tolist()
    arc, curvature = length * (1 + epsilon), hypot(kappa_x, kappa_y)
    return degrees(arc * curvature), arc, 1 / curvature


def workspace(runs: PaperRuns) -> Topic:
    """Extents of the places that the tip of one section can have."""
    found = {reading: runs.workspace(reading) for reading in STATIC}
    sizes = {reading: np.diff(w.extents, axis=1)[:, 0].tolist() for reading, w in found.items()}
    about = Printed(0.5, "about")
    rows = [
        Row(f"extent along {axis}", "m", {name: (size[k],) for name, size in sizes.items()}, about)
        for k, axis in enumerate("xyz")
    ]
    ranges = {name: tuple(w.extents[2].tolist()) for name, w in found.items()}
    picture = Printed(None, text="picture")
    rows += [
        Row("z of the tip, lowest and highest", "m", ranges, picture, 3, ("lowest", "highest")),
        Row("volume of the shell", "l", {OURS: (1e3 * found[OURS].volume,)}, picture, 1),
    ]
    longest = 1 + runs.arm.limits.stretch_max
    return Topic(
        key="workspace",
        title="workspace of one section, 0 to 1 MPa, no gravity",
        where="3.1, Fig. 5a",
        rows=tuple(row.completed(STATIC) for row in rows),
        why="The paper rounds, and may count z from the base. The highest tip is that of the "
        "straight section with all units at 1 MPa. (17) as printed would go on beyond the set's "
        f"limit of stretch, {longest:g} times the length at rest.",
        readings={name: READINGS[name] for name in STATIC},
    )


def limit_posture(runs: PaperRuns) -> Topic:
    """Both sections at the largest pressure."""
    rests: dict[str, dict[str, Equilibrium]] = {name: {} for name in LIMIT_POSTURES}
    for reading in STATIC:
        for name, units in LIMIT_POSTURES.items():
            pressures = [FULL if unit in units else 0.0 for unit in range(1, UNITS + 1)]
            rests[name][reading] = find_equilibrium(runs.weightless(reading, 2), pressures)
    models = {reading: runs.weightless(reading, 2) for reading in STATIC}
    rows: list[Row] = []
    for name, found in rests.items():
        rows += _posture_rows(name, models, found)
    return Topic(
        key="posture",
        title="limit posture of both sections, 1 MPa, no gravity",
        where="Fig. 5c",
        rows=tuple(rows),
        why="A picture only, without numbers, and it does not say which units carry 1 MPa: with "
        "all six the arm is straight and longest, with 1, 5, 6 or 2, 3, 4 it bends one way.",
        readings={name: READINGS[name] for name in STATIC},
    )


# ---------------------------------------------------------------- postures under torque


def rests_of_unit_4(runs: PaperRuns) -> Topic:
    """Torques on unit 4: the second section bends."""
    return _rests(
        runs,
        "fig11a",
        4,
        "Figs 10, 11a",
        "Shapes only: photographs and curves without numbers. The paper's formulation lumps the "
        "weight at the ends of the sections and hands on no shear (22): that bends the first "
        "section further back.",
    )


def rests_of_unit_1(runs: PaperRuns) -> Topic:
    """Torques on unit 1: the first section bends and carries the second."""
    return _rests(
        runs,
        "fig11b",
        1,
        "Figs 10, 11b",
        "Shapes only, as above. With its weight lumped at its end, the second section turns "
        "further to the vertical. 4 segments a section show what one segment costs our model.",
    )


def _rests(runs: PaperRuns, key: str, unit: int, where: str, why: str) -> Topic:
    readings = (*STATIC, FINE)
    models = {reading: runs.model(reading) for reading in readings}
    rows: list[Row] = []
    for torque in REST_TORQUES:
        found = {reading: runs.rest(reading, {unit: torque}) for reading in readings}
        rows += _posture_rows(f"{torque:g} N·m", models, found)
    return Topic(
        key=key,
        title=f"rest under torque on unit {unit}",
        where=where,
        rows=tuple(rows),
        why=why,
        readings={name: READINGS[name] for name in readings},
    )


def _posture_rows(what: str, models: dict[str, Model], found: dict[str, Equilibrium]) -> list[Row]:
    """Bending of the sections and place of the tip, by reading."""
    picture = Printed(None, text="picture")
    bends, tips = {}, {}
    for reading, rest in found.items():
        lost = (np.nan, np.nan)
        bends[reading] = section_bends(models[reading], rest) if rest.converged else lost
        tips[reading] = tuple((rest.tips[-1, [0, 2]] + 0.0).tolist()) if rest.converged else lost
    sections = ("section 1", "section 2")
    return [
        Row(f"{what}: bending of sections", "°", bends, picture, 1, sections),
        Row(f"{what}: tip (x, z)", "m", tips, picture, 3, ("x", "z")),
    ]
