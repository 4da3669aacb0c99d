"""The paper's motions beside ours: inputs, the literal equations, measures, and what fails."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from arms import literal_section
from oracles.paper_literal import (
    LiteralArm,
    LiteralHydraulics,
    largest_cumulative_error,
    largest_sectional_error,
    section_errors,
)
from scipy.linalg import expm

from softmpc.model.model import build
from softmpc.model.presets import DEFAULT_PRESET, preset
from softmpc.model.scene_file import read_document, scene_from_dict
from softmpc.simulation.inputs import InputProfile, Step
from softmpc.simulation.integrator import IntegrationError
from softmpc.simulation.run import simulate
from softmpc.simulation.settings import read_settings
from softmpc.study import paper_readings
from softmpc.study.paper_motions import MOTIONS
from softmpc.study.paper_readings import (
    AS_PRINTED,
    AS_READ,
    FINE,
    OURS,
    PaperRuns,
    slowest_decay,
)
from softmpc.study.reproduce import reproduce
from softmpc.study.reproduce_motions import curvature_overshoot, fig6, fig7
from softmpc.study.reproduce_records import Topic

ARM = preset(DEFAULT_PRESET)
EXAMPLES = Path(__file__).parent.parent / "examples"
FILES = {
    "fig6": "step_fig6", "fig7": "step_fig7", "fig8": "ramp_fig8", "fig13": "step_fig12",
    "fig14": "ramp_fig14",
}  # fmt: skip


@cache
def runs() -> PaperRuns:
    return PaperRuns(ARM)


def row(topic: Topic, what: str) -> dict[str, tuple[float, ...]]:
    (found,) = (r for r in topic.rows if r.what.startswith(what))
    return dict(found.values)


# ---------------------------------------------------------------- what is run


@pytest.mark.parametrize("figure", MOTIONS)
def test_motions_are_those_of_the_example_files(figure: str) -> None:
    document = read_document(EXAMPLES / f"{FILES[figure]}.toml")
    settings = read_settings(document, build(scene_from_dict(document)), EXAMPLES)
    times = np.linspace(-0.5, settings.duration, 1000)
    assert MOTIONS[figure].duration == settings.duration
    np.testing.assert_allclose(MOTIONS[figure].profile(times), settings.profile(times), atol=1e-12)


def literal_pressure(times: Any, torque: float) -> Any:
    """Pressure (Pa) at times (s) after a step of torque, by (36) and the matrix exponential."""
    h, section = ARM.hydraulics, ARM.sections[0]
    own = {
        "lead": h.screw_lead, "viscosity": h.water_viscosity, "unit_area": section.unit_area,
        "wall_area": section.wall_area, "young_modulus": section.young_modulus,
        "unit_length": section.length, "unit_volume": h.chamber_volume,
    }  # fmt: skip
    shared = {f.name for f in fields(LiteralHydraulics)} - set(own)
    literal = LiteralHydraulics(**own, **{name: getattr(h, name) for name in shared})
    a, b, _ = literal.matrices()
    rest = -np.linalg.solve(a, b[:, 0] * torque)
    return np.array([(rest - expm(a * t) @ rest)[1] for t in times])


@pytest.mark.sampled
@pytest.mark.parametrize(("reading", "law"), [(AS_PRINTED, "printed"), (AS_READ, "strain")])
def test_the_papers_motion_solves_its_equations(reading: str, law: str) -> None:
    """M q̈ + C q̇ + N = τ of a transcription without shared code, along the step of Fig. 7.

    Accelerations are central differences of the rates, samples of 1 ms.
    """
    h = 1e-3
    motion = simulate(
        runs().model(reading), MOTIONS["fig7"].profile, 0.08, sample_time=h, tip_tolerance=1e-9
    )
    literal = LiteralArm([literal_section(s) for s in ARM.sections], axial_law=law)
    for k in (25, 40, 60):
        dq = motion.dq[k - 3 : k + 4]
        ddq = (45 * (dq[4] - dq[2]) - 9 * (dq[5] - dq[1]) + dq[6] - dq[0]) / (60 * h)
        pressures = np.zeros(6)
        pressures[[0, 3]] = literal_pressure([motion.time[k]], 1.5)
        np.testing.assert_allclose(motion.p[k], pressures, rtol=1e-6, atol=1.0)
        m, c, n, tau = literal.terms(motion.q[k], motion.dq[k], pressures)
        gap = np.abs(m @ ddq + c @ motion.dq[k] + n - tau).reshape(2, 4).max(axis=0)
        size = np.abs(m @ ddq).reshape(2, 4).max(axis=0) + np.abs(tau).reshape(2, 4).max(axis=0)
        assert np.all(gap[[0, 2]] < 2e-3 * size[[0, 2]])


# ---------------------------------------------------------------- measures


def test_the_slowest_mode_is_what_the_end_of_a_motion_shows() -> None:
    """Distances of the tip from its end fall by e^(rate·time), whatever phase the swing is in."""
    motion = runs().motion("fig6", OURS)
    assert not isinstance(motion, str)
    rest = runs().rest(OURS, {1: 1.5, 5: 1.5, 6: 1.5})
    away = np.linalg.norm(motion.tips[:, -1] - rest.tips[-1], axis=1)
    peaks = [k for k in range(60, 250) if away[k - 1] < away[k] > away[k + 1]]
    rate = np.polyfit(motion.time[peaks], np.log(away[peaks]), 1)[0]
    assert len(peaks) >= 3
    assert slowest_decay(runs().model(OURS), rest) == pytest.approx(rate, rel=0.03)


def test_the_rest_of_the_undivided_law_is_left() -> None:
    """Fig. 7 as printed: stable for an arm without motion, but a small swing grows as computed."""
    model, rest = runs().model(AS_PRINTED), runs().rest(AS_PRINTED, {1: 1.5, 4: 1.5})
    rate = slowest_decay(model, rest)
    assert rest.stable
    assert rate > 1.0
    nudged = rest.q * 1.0
    nudged[6] += 1e-5
    z = model.drive_rest(np.array([1.5, 0, 0, 1.5, 0, 0]))
    start = np.concatenate([nudged, np.zeros(8), np.asarray(z).ravel()])
    held = InputProfile.of(6, [Step(1, -1.0, 1.5), Step(4, -1.0, 1.5)])
    motion = simulate(model, held, 1.2, sample_time=1e-3, start=start, tip_tolerance=1e-11)
    swing = np.abs(motion.q[:, 6] - rest.q[6])
    peaks = [k for k in range(600, 1150) if swing[k - 1] < swing[k] > swing[k + 1]]
    assert np.polyfit(motion.time[peaks], np.log(swing[peaks]), 1)[0] == pytest.approx(
        rate, rel=0.03
    )


def swung(share: float) -> Any:
    """κy of section 1 that goes from 1 to -3 and `share` of its way too far; segments differ."""
    time = np.linspace(0, 2, 201)
    kappa = np.where(time < 1, 1.0, -3.0)
    kappa[100:110] = -3.0 - 4 * share
    columns = {"kappa_y_1_1": kappa + 0.5, "kappa_y_1_2": kappa - 0.5, "kappa_y_2_1": 7 * kappa}

    class Motion(SimpleNamespace):
        def __getitem__(self, name: str) -> Any:
            return columns[name]

    profile = InputProfile.of(1, [Step(1, 0.99, 1.0)])
    return Motion(time=time, units=dict.fromkeys(columns, "1/m"), profile=profile)


@pytest.mark.parametrize("share", [0.0, 0.25])
def test_overshoot_of_a_curvature(share: float) -> None:
    assert curvature_overshoot(swung(share)) == pytest.approx(100 * share)


# ---------------------------------------------------------------- rows


@pytest.mark.slow
def test_fig6_stays_in_its_plane_and_rests_in_time() -> None:
    topic = fig6(runs())
    assert row(topic, "farthest of a tip")[OURS] == pytest.approx([0.0], abs=1e-9)
    assert row(topic, "time to rest")[OURS][0] < 1.0
    assert row(topic, "time to rest")[AS_READ][0] < 1.0
    assert re.search(r"would hold 0\.161 MPa", topic.why)


def test_what_cannot_be_followed_says_so() -> None:
    topic = fig7(runs())
    assert "stopped" in topic.failures[AS_PRINTED]
    assert set(topic.failures) == {AS_PRINTED}
    assert np.isnan(row(topic, "tip at the end")[AS_PRINTED]).all()
    assert row(topic, "slowest mode")[AS_PRINTED][0] > 0
    assert f"“{AS_PRINTED}” (+" in topic.why
    assert row(topic, "time to rest")[OURS][0] < 1.5


@pytest.fixture
def _nothing_moves(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def fails(*_: Any) -> None:
        raise IntegrationError("stopped: no reason")

    monkeypatch.setattr(paper_readings, "motion_of", fails)
    return


@pytest.mark.slow
@pytest.mark.usefixtures("_nothing_moves")
@pytest.mark.parametrize("key", ["fig8", "errors"])
def test_no_motion_at_all_gives_rows_without_numbers(key: str) -> None:
    found = reproduce(only=[key])
    (topic,) = found.topics
    moving = [r for r in topic.rows if not r.what.startswith("slowest mode")]
    assert all(np.isnan(v).all() for r in moving for v in r.values.values())
    assert found.lost[key] == "stopped: no reason"


def test_an_interrupted_run_keeps_what_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(paper_readings, "motion_of", interrupt)
    found = reproduce(only=["drive", "limit+x", "fig6", "fig7"])
    assert found.status == "interrupted"
    assert [topic.key for topic in found.topics] == ["drive", "limit+x"]


@pytest.mark.slow
def test_errors_are_those_of_the_literal_metric() -> None:
    (topic,) = reproduce(only=["errors"]).topics
    for figure in ("fig13", "fig14"):
        reference = runs().motion(figure, FINE)
        for reading in (AS_READ, OURS):
            motion = runs().motion(figure, reading)
            assert not isinstance(motion, str) and not isinstance(reference, str)
            gaps = section_errors(reference.tips, motion.tips)
            name = f"Fig. {figure[3:]}, {MOTIONS[figure].title}"
            one = row(topic, f"{name}: largest ERR")[reading][0]
            summed = row(topic, f"{name}: largest sum")[reading][0]
            assert one == pytest.approx(largest_sectional_error(gaps), rel=1e-9)
            assert summed == pytest.approx(largest_cumulative_error(gaps), rel=1e-9)
    assert all(r.printed and r.printed.difference(0.0) is None for r in topic.rows)
