"""The paper's numbers beside ours, at rest: closed forms, the rod and the literal transcription."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from arms import literal_section
from oracles.closed_forms import drive_arc
from oracles.paper_literal import LiteralArm, LiteralHydraulics

from softmpc.accuracy.rod import solve_rod
from softmpc.accuracy.rod_of_scene import rod_section
from softmpc.errors import InputError, ParameterError
from softmpc.model.parameters import Section
from softmpc.model.presets import DEFAULT_PRESET, preset
from softmpc.study.paper_readings import (
    AS_PRINTED,
    AS_READ,
    FINE,
    OURS,
    READINGS,
    PaperRuns,
    screw_as_printed,
)
from softmpc.study.reproduce import TOPICS, Reproduction, reproduce
from softmpc.study.reproduce_records import Printed, Row, Topic
from softmpc.view.paper_tables import markdown, terminal

ARM = preset(DEFAULT_PRESET)
STILL = ("drive", "limit+x", "limit-x", "posture", "fig11a", "fig11b")
PA = 1e6


@cache
def found() -> Reproduction:
    return reproduce(only=STILL)


def topic(key: str) -> Topic:
    return next(t for t in found().topics if t.key == key)


def values(key: str, what: str) -> dict[str, tuple[float, ...]]:
    (row,) = (row for row in topic(key).rows if row.what == what)
    return dict(row.values)


# ---------------------------------------------------------------- the drive


@pytest.mark.parametrize("reading", [AS_PRINTED, OURS])
def test_pressure_under_torque(reading: str) -> None:
    """The literal (32) at rest: the screw's force is the cylinder's pressure times its area."""
    h = screw_as_printed(ARM.hydraulics) if reading == AS_PRINTED else ARM.hydraulics
    section = ARM.sections[0]
    own = {
        "lead": h.screw_lead, "viscosity": h.water_viscosity, "unit_area": section.unit_area,
        "wall_area": section.wall_area, "young_modulus": section.young_modulus,
        "unit_length": section.length, "unit_volume": h.chamber_volume,
    }  # fmt: skip
    shared = {f.name for f in fields(LiteralHydraulics)} - set(own)
    literal = LiteralHydraulics(**own, **{name: getattr(h, name) for name in shared})
    (pressure,) = values("drive", "pressure at 2.5 N·m")[reading]
    assert literal.piston_acceleration(0.0, PA * pressure, 2.5) == pytest.approx(0.0, abs=1e-9)
    (torque,) = values("drive", "torque for 1 MPa")[reading]
    assert literal.piston_acceleration(0.0, PA, torque) == pytest.approx(0.0, abs=1e-9)


def test_the_printed_pair_decides() -> None:
    pressure = values("drive", "pressure at 2.5 N·m")
    assert pressure[AS_PRINTED][0] == pytest.approx(0.268, abs=5e-4)
    assert pressure[OURS][0] == pytest.approx(1.0, abs=1e-3)


# ---------------------------------------------------------------- limits of section 3.1


def closed_arc(section: Section, pressures: tuple[float, ...], reading: str) -> tuple[float, float]:
    """Arc (m) and radius (m) of a weightless section, on paper: A_d ΣP and A_d P r_d alone."""
    force = section.unit_area * sum(pressures)
    angles = np.radians([0, 120, 240])
    moment = section.unit_area * section.unit_offset * abs(np.exp(1j * angles) @ pressures)
    stiffness = section.young_modulus * np.pi * section.bending_radius**4 / 4
    axial = 3 * section.young_modulus * section.wall_area
    extra = 0.5 * moment**2 / stiffness if reading == OURS else 0.0
    epsilon = (force + extra) / axial
    if reading == AS_PRINTED:
        epsilon /= section.length
    return section.length * (1 + epsilon), stiffness / moment


@pytest.mark.parametrize("reading", [AS_PRINTED, AS_READ, OURS])
@pytest.mark.parametrize(
    ("key", "pressures"), [("limit+x", (0.0, PA, PA)), ("limit-x", (PA, 0.0, 0.0))]
)
def test_limits_are_closed_forms(key: str, pressures: tuple[float, ...], reading: str) -> None:
    arc, radius = closed_arc(ARM.sections[0], pressures, reading)
    assert values(key, "arc")[reading][0] == pytest.approx(arc, rel=1e-10)
    assert values(key, "radius")[reading][0] == pytest.approx(radius, rel=1e-10)
    angle = np.degrees(arc / radius)
    assert values(key, "bending angle")[reading][0] == pytest.approx(angle, rel=1e-10)


def test_arcs_of_the_two_literal_laws() -> None:
    """The numbers that an independent derivation gave, to its three digits."""
    arcs = {key: values(key, "arc") for key in ("limit-x", "limit+x")}
    for reading, wanted in ((AS_READ, (0.306, 0.361)), (AS_PRINTED, (0.472, 0.694))):
        got = [arcs[key][reading][0] for key in ("limit-x", "limit+x")]
        assert got == pytest.approx(wanted, abs=6e-4)


def test_the_printed_limit_contradicts_itself() -> None:
    rows = {row.what: row.printed for row in topic("limit-x").rows}
    own, arc = rows["arc, against angle times radius"], rows["arc"]
    assert own is not None and arc is not None
    assert own.value == pytest.approx(0.399, abs=5e-4)
    assert arc.value == 0.473


@pytest.mark.parametrize("name", ["1, 5, 6", "2, 3, 4", "all units"])
def test_limit_posture_is_two_arcs(name: str) -> None:
    """Each section without weight is an arc of its own pressures."""
    on = range(1, 7) if name == "all units" else [int(unit) for unit in name.split(", ")]
    place, turn, bends = np.zeros(3), np.eye(3), []
    for s, section in enumerate(ARM.sections):
        pressure = np.array([PA if 3 * s + j in on else 0.0 for j in (1, 2, 3)])
        thrust, angles = section.unit_area * pressure, np.array(section.unit_angles)
        moment = section.unit_offset * np.array(
            [thrust @ np.sin(angles), -thrust @ np.cos(angles), 0.0]
        )
        stiffness = np.array([section.bending_stiffness] * 2 + [section.torsional_stiffness])
        pose = drive_arc(
            section.length, thrust.sum(), moment, 3 * 1.2e6 * section.wall_area, stiffness
        )
        place, turn = place + turn @ pose.position, turn @ pose.rotation
        bends.append(np.degrees(np.arctan2(pose.rotation[0, 2], pose.rotation[2, 2])))
    assert values("posture", f"{name}: tip (x, z)")[OURS] == pytest.approx(place[[0, 2]], abs=1e-9)
    got = values("posture", f"{name}: bending of sections")[OURS]
    assert got == pytest.approx(bends, abs=1e-7)


# ---------------------------------------------------------------- rests of section 4.2


@pytest.mark.parametrize("unit", [1, 4])
@pytest.mark.parametrize("torque", [0.5, 1.0, 1.5, 2.0])
def test_rests_are_those_of_the_rod(unit: int, torque: float) -> None:
    sections = [rod_section(s) for s in ARM.sections]
    h = ARM.hydraulics
    pressures = np.zeros(6)
    pressures[unit - 1] = 2 * np.pi * h.efficiency * torque / (h.screw_lead * h.piston_area)
    rod = solve_rod(sections, pressures)
    tips = values("fig11a" if unit == 4 else "fig11b", f"{torque:g} N·m: tip (x, z)")
    assert np.hypot(*(tips[FINE] - rod.tip[[0, 2]])) < 1e-3
    assert np.hypot(*(tips[OURS] - rod.tip[[0, 2]])) < 15e-3
    assert np.hypot(*(tips[AS_READ] - rod.tip[[0, 2]])) > np.hypot(*(tips[OURS] - rod.tip[[0, 2]]))


@pytest.mark.parametrize(("reading", "law"), [(AS_PRINTED, "printed"), (AS_READ, "strain")])
@pytest.mark.parametrize("torques", [{1: 1.0}, {4: 2.0}, {1: 1.5, 5: 1.5, 6: 1.5}])
def test_rests_of_the_paper_solve_its_equations(
    reading: str, law: str, torques: dict[int, float]
) -> None:
    """N(q) = τ(p) of a transcription without shared code."""
    rest = PaperRuns(ARM).rest(reading, torques)
    literal = LiteralArm([literal_section(s) for s in ARM.sections], axial_law=law)
    terms = literal.terms(rest.q, np.zeros(8), rest.pressures)
    assert rest.converged
    np.testing.assert_allclose(terms.position, terms.inputs, atol=1e-8)


# ---------------------------------------------------------------- records and tables


def test_differences_from_what_is_printed() -> None:
    number, bound = Printed(2.0), Printed(1.5, "<")
    assert (number.difference(2.5), number.percent(2.5)) == (0.5, 25.0)
    assert (bound.difference(1.2), bound.shown) == (pytest.approx(-0.3), "< 1.5")
    for nothing in (Printed(0.03, "rig"), Printed(None, text="picture")):
        assert nothing.difference(1.0) is None
        assert nothing.percent(1.0) is None
    assert Printed(0.0).percent(1.0) is None
    assert Printed(0.5, "about").shown == "about 0.5"


def made(row: Row) -> Reproduction:
    one = Topic("drive", "a topic", "3.1", (row,), "Because.", {AS_PRINTED: "x", OURS: "y"})
    return Reproduction("finished", "a set", (one,), PaperRuns(ARM))


def test_cells_of_a_table() -> None:
    text = terminal(
        made(Row("time", "s", {AS_PRINTED: (np.nan,), OURS: (0.75,)}, Printed(1.0, "<"), 2))
    )
    (line,) = (line for line in text.splitlines() if line.startswith("time (s)"))
    assert line.split()[2:] == ["<", "1", "–", "0.75", "–", "−0.25", "(−25.0", "%),", "kept"]
    over = made(Row("time", "s", {AS_PRINTED: (2.0,), OURS: (1.0,)}, Printed(1.0, "<"), 1))
    assert "+1.0 (+100.0 %), not kept" in terminal(over)
    assert "| 0.0 (0.0 %), not kept |" in markdown(over)["drive"]
    pair = Row("tip", "m", {AS_PRINTED: (-1e-9, 2), OURS: (3, 4)}, None, 1, ("x", "z"))
    assert "| tip (m) | – | 0.0, 2.0 | 3.0, 4.0 |" in markdown(made(pair))["drive"]


def test_every_reading_is_explained() -> None:
    text = terminal(found())
    for name, about in {**READINGS, **topic("drive").readings}.items():
        assert f"{name}: {about}" in text
    assert DEFAULT_PRESET in text


def test_columns_name_the_set_and_leave_gaps() -> None:
    columns = made(
        Row("time", "s", {AS_PRINTED: (np.nan,), OURS: (0.5,)}, Printed(None, text="picture"))
    ).columns()
    assert columns["value"].tolist() == ["", 0.5]
    assert columns["printed"].tolist() == ["", ""]
    assert set(columns["parameters"]) == {"a set"}
    assert {len(column) for column in columns.values()} == {2}


def test_summary_is_complete() -> None:
    summary = found().summary()
    assert [t["key"] for t in summary["topics"]] == list(STILL)
    assert all(t["why"] and t["rows"] for t in summary["topics"])
    parts = {record["what"] for t in summary["topics"] for record in t["rows"]}
    assert {"1 N·m: tip (x, z): x", "1 N·m: tip (x, z): z"} <= parts


# ---------------------------------------------------------------- wrong input


def test_wrong_input() -> None:
    with pytest.raises(InputError, match=r"unknown topic: 'limit'; did you mean 'limit-x'"):
        reproduce(only=["limit"])
    with pytest.raises(ParameterError, match="chen2022-v1"):
        reproduce("chen2021")
    with pytest.raises(InputError, match="two sections of three units"):
        PaperRuns(replace(ARM, sections=ARM.sections[:1]))


def test_topics_are_done_in_the_order_of_the_paper() -> None:
    seen: list[tuple[int, int]] = []
    done = reproduce(only=["limit-x", "drive"], progress=lambda k, n: seen.append((k, n)))
    assert [t.key for t in done.topics] == ["drive", "limit-x"]
    assert seen == [(1, 2), (2, 2)]
    assert {t.key for t in found().topics} < set(TOPICS)


# ---------------------------------------------------------------- workspace of Fig. 5a


def closed_tips(section: Section, reading: str, most: float, steps: int = 61) -> np.ndarray:
    """Tips (K×3) of a weightless section at a grid of pressures, arcs on paper; ε up to `most`."""
    share = np.linspace(0, PA, steps)
    p = np.stack(np.meshgrid(share, share, share), axis=-1).reshape(-1, 3)
    pull = section.unit_area * section.unit_offset * p @ np.exp(1j * np.array(section.unit_angles))
    kappa = np.abs(pull) / section.bending_stiffness  # bends away from where it pulls
    extra = 0.5 * section.bending_stiffness * kappa**2 if reading == OURS else 0.0
    epsilon = (section.unit_area * p.sum(axis=1) + extra) / section.axial_stiffness
    epsilon = epsilon / section.length if reading == AS_PRINTED else epsilon
    kappa, pull, epsilon = (x[epsilon <= most] for x in (kappa, pull, epsilon))
    arc = section.length * (1 + epsilon)
    side = arc * np.sinc(kappa * arc / 2 / np.pi) * np.sin(kappa * arc / 2)
    way = -pull / np.maximum(np.abs(pull), 1e-300)
    return np.stack([side * way.real, side * way.imag, arc * np.sinc(kappa * arc / np.pi)], axis=1)


@pytest.mark.slow
def test_workspace_is_that_of_all_pressures() -> None:
    (workspace,) = reproduce(only=["workspace"]).topics
    rows = {row.what: dict(row.values) for row in workspace.rows}
    for reading in (AS_PRINTED, AS_READ, OURS):
        tips = closed_tips(ARM.sections[0], reading, ARM.limits.stretch_max)
        sizes = [rows[f"extent along {axis}"][reading][0] for axis in "xyz"]
        lacking = sizes - np.ptp(tips, axis=0)  # of the grid, which misses the edges a little
        assert np.all(lacking > -1e-6), reading
        assert np.all(lacking < (20e-3 if reading == AS_PRINTED else 1e-3)), reading
    assert rows["z of the tip, lowest and highest"][OURS][1] == pytest.approx(
        closed_tips(ARM.sections[0], OURS, 2.0, 2)[:, 2].max(), abs=1e-6
    )
