"""Accuracy notes: windows, mapped states, and findings against independent runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from arms import MIXED, PAPER, States, arm

from softmpc.errors import InputError, SceneError, SoftmpcError
from softmpc.model.actuation import HydraulicDrive, PressureDrive, StaticDrive
from softmpc.model.drive_effects import TubeInertance
from softmpc.model.effects import (
    EFFECTS,
    Contact,
    Gravity,
    Inertia,
    MaterialDamping,
    RotaryInertia,
)
from softmpc.model.elasticity import PrintedElasticity
from softmpc.model.formulations import NewtonEuler, VirtualPower
from softmpc.model.mass import GaussMass
from softmpc.model.model import Model, build
from softmpc.model.obstacles import Cylinder
from softmpc.model.parameters import Section
from softmpc.model.scene import MAX_SEGMENTS, Scene
from softmpc.simulation.inputs import InputProfile, Ramp, Step
from softmpc.simulation.result import Simulation
from softmpc.simulation.run import simulate, start_state
from softmpc.simulation.settings import SimulationSettings
from softmpc.statics.equilibrium import find_equilibrium, refine_equilibrium
from softmpc.study.certify import Certificate, Finding, certify, finer_scene
from softmpc.study.rests import end_rest, farthest, rest_again
from softmpc.study.windows import Window, choose_windows, divided, later, mapped_state

ONE = arm(Section())
SETTINGS = SimulationSettings(InputProfile.of(3, [Step(1, 0.1, 0.4e6)]), 0.4)
EFFECTS_HERE = (Gravity(), Inertia(), MaterialDamping())  # no Coriolis
SCENE = Scene(ONE, strains=("epsilon", "kappa_y"), effects=EFFECTS_HERE, actuation=PressureDrive())
EXACT: dict[str, Any] = {"method": "idas", "tolerance": 1e-11}


@pytest.fixture(autouse=True, scope="module")
def _quick() -> Iterator[None]:
    """Each run takes a fraction of a second: compiling it would take longer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOFTMPC_COMPILE", "never")
        yield


@pytest.fixture(scope="module")
def model() -> Model:
    return build(SCENE)


@pytest.fixture(scope="module")
def motion(model: Model) -> Simulation:
    return simulate(model, SETTINGS.profile, 0.4)


@pytest.fixture(scope="module")
def whole(model: Model, motion: Simulation) -> Certificate:
    return certify(model, motion, SETTINGS)


# ---------------------------------------------------------------- findings


def run(scene: Scene, **changes: Any) -> np.ndarray:
    return simulate(build(scene), SETTINGS.profile, 0.4, **(EXACT | changes)).tips


def test_findings_are_the_differences_of_whole_motions(
    whole: Certificate, motion: Simulation
) -> None:
    """Each scene run again by IDAS; the equilibria at the end beside it."""
    assert whole.windows == (Window(0, 40, 0.0, 0.4),)
    finer = run(SCENE.with_(segments=2, formulation=VirtualPower(GaussMass(3))))
    gap = np.linalg.norm(finer - motion.tips, axis=2).max()
    assert whole.model.windows_m[0] == pytest.approx(gap, abs=1e-7)
    gap = np.linalg.norm(run(SCENE) - motion.tips, axis=2).max()
    assert whole.numerical.worst_m == pytest.approx(gap, abs=1e-7)
    (coriolis,) = (f for f in whole.left_out if f.name == "coriolis")
    effects = tuple(kind() for kind in EFFECTS if kind.name == "coriolis")
    gap = np.linalg.norm(run(SCENE.with_(effects=EFFECTS_HERE + effects)) - motion.tips, axis=2)
    assert coriolis.windows_m[0] == pytest.approx(gap.max(), abs=1e-7)
    assert coriolis.end_m == 0.0  # at rest nothing moves


def test_every_effect_left_out_is_asked_or_has_a_reason(whole: Certificate) -> None:
    missing = {kind.name for kind in EFFECTS if SCENE.effect(kind) is None}
    assert {f.name for f in whole.left_out} | set(whole.skipped) == missing
    assert not {f.name for f in whole.left_out} & set(whole.skipped)
    surroundings = {kind.name for kind in EFFECTS if kind.surroundings}
    assert surroundings & missing <= set(whole.skipped)
    assert "needs the whole drive" in whole.skipped["tube_inertance"]
    worst = [f.worst_m for f in whole.left_out]
    assert worst == sorted(worst, key=lambda value: -(value or 0.0))


@pytest.mark.slow
def test_a_window_starts_from_the_motion(model: Model, motion: Simulation) -> None:
    """The same scene from the motion's own state: only the integration is left."""
    found = certify(model, motion, SETTINGS, window=0.15)
    (window,) = found.windows
    assert window.start > 0 and window.end - window.start == pytest.approx(0.15)
    assert found.numerical.windows_m[0] is not None
    assert 0 < found.numerical.windows_m[0] < 1e-4
    finer = build(SCENE.with_(segments=2, formulation=VirtualPower(GaussMass(3))))
    coarse = motion.x[window.first]
    start = np.concatenate([np.tile(coarse[:2], 2), np.tile(coarse[2:], 2)])
    profile = InputProfile.of(3, [Step(1, 0.1 - window.start, 0.4e6)])
    again = simulate(finer, profile, 0.15, start=start, **EXACT)
    gap = again.tips - motion.tips[window.first : window.last + 1]
    assert found.model.windows_m[0] == pytest.approx(np.linalg.norm(gap, axis=2).max(), abs=1e-7)


def test_end_posture_is_seen_by_itself() -> None:
    """Without inertia and damping the arm is at rest all the time."""
    scene = SCENE.with_(effects=(Gravity(),))
    settings = replace(SETTINGS, profile=InputProfile.constant([0.4e6, 0.0, 0.0]))
    model = build(scene)
    found = certify(model, simulate(model, settings.profile, 0.1), settings)
    assert found.model.end_m is not None and found.model.end_m > 1e-4
    assert found.model.windows_m[0] == pytest.approx(found.model.end_m, rel=1e-6)


def test_what_cannot_run_has_a_reason(model: Model, motion: Simulation) -> None:
    """An arm whose twist has no mass cannot move; its rest is still compared."""
    massless = Scene(ONE, effects=(Inertia(), MaterialDamping()), actuation=PressureDrive())
    other = build(massless)
    assert other.massless
    straight = np.tile(np.asarray(other.frames(np.zeros(4))[0]).T, (41, 1, 1))
    none = {name: np.zeros((41, 4)) for name in ("q", "dq")}
    still = replace(motion, **none, u=0 * motion.u, tips=straight, tip_speeds=np.zeros((41, 1)))
    found = certify(other, still, SETTINGS)
    assert found.model.windows_m == (None,)
    assert any("strains have no mass" in reason for reason in found.model.reasons)
    assert found.model.end_m == pytest.approx(0.0, abs=1e-9)


def test_text_names_what_shows() -> None:
    def finding(name: str, worst: float | None) -> Finding:
        return Finding(name, (worst,), None)

    left_out = finding("tube_inertance", 9e-3), finding("cavitation", 2e-6)
    note = Certificate(
        (), finding("numerical", 1e-6), finding("model", 1.8e-3), left_out, {"payload": "why"}
    )
    assert note.text == "model error 1.8 mm, numerical 1 µm; left out: tube inertance 9 mm"
    assert note.summary()["left_out_m"] == {"tube_inertance": 9e-3, "cavitation": 2e-6}
    nothing = replace(note, left_out=(), model=finding("model", None))
    assert nothing.text == "model error unknown, numerical 1 µm; left out: nothing could be run"
    rounding = replace(
        note, numerical=finding("numerical", 0.0), left_out=(finding("rotor_inertia", 3e-17),)
    )
    assert rounding.text.endswith("nothing that shows")


def test_wrong_input(model: Model, motion: Simulation) -> None:
    with pytest.raises(InputError, match=r"window = 0\.0 s"):
        certify(model, motion, SETTINGS, window=0.0)
    with pytest.raises(InputError, match="windows = 0"):
        certify(model, motion, SETTINGS, windows=0)
    with pytest.raises(InputError, match="one sample"):
        certify(model, replace(motion, time=motion.time[:1]), SETTINGS)


# ---------------------------------------------------------------- finer scenes


def test_finer_scenes() -> None:
    printed = Scene(ONE, formulation=NewtonEuler(), actuation=PressureDrive())
    assert finer_scene(printed).formulation == VirtualPower(GaussMass(2))
    law = VirtualPower(GaussMass(1), PrintedElasticity())
    assert finer_scene(SCENE.with_(formulation=law)).formulation == VirtualPower(GaussMass(2))
    assert finer_scene(SCENE).segments == 2
    with pytest.raises(SceneError, match=f"{MAX_SEGMENTS} are the most"):
        finer_scene(SCENE.with_(segments=MAX_SEGMENTS))


@pytest.mark.parametrize("segments", [1, 3])
def test_mapped_states_keep_the_shape(segments: int) -> None:
    """Two sections of other lengths: the section tips of the divided arm are where they were."""
    coarse = build(Scene(MIXED, segments=segments))
    fine = build(finer_scene(coarse.scene))
    states = States(coarse, 3)
    q, dq, _, _ = states.motion()
    z = np.arange(1.0, len(coarse.layout.z) + 1)
    x = mapped_state(np.concatenate([q, dq, z]), coarse, fine, np.zeros(len(fine.layout.x)))
    n = fine.strains
    tips, rotations = coarse.frames(q)
    fine_tips, fine_rotations = fine.frames(x[:n])
    np.testing.assert_allclose(fine_tips, tips, atol=1e-14)
    np.testing.assert_allclose(fine_rotations, rotations, atol=1e-13)
    speeds = np.asarray(fine.tip_jacobian(x[:n])) @ x[n : 2 * n]
    np.testing.assert_allclose(speeds, np.asarray(coarse.tip_jacobian(q)) @ dq, rtol=1e-12)
    np.testing.assert_array_equal(x[2 * n :], z)


def test_new_drive_states_are_as_at_rest() -> None:
    plain = build(Scene(PAPER, actuation=HydraulicDrive()))
    heavy = build(plain.scene.with_(effects=(*plain.scene.effects, TubeInertance())))
    held = InputProfile.constant([1.0] * 6)
    rest = start_state(heavy, held, "straight")
    x = np.arange(1.0, len(plain.layout.x) + 1)
    mapped = dict(zip(heavy.layout.x.names, mapped_state(x, plain, heavy, rest), strict=True))
    at_rest = dict(zip(heavy.layout.x.names, rest, strict=True))
    for name, value in zip(plain.layout.x.names, x, strict=True):
        assert mapped.pop(name) == value
    assert len(mapped) == 6
    assert mapped == {name: at_rest[name] for name in mapped}


# ---------------------------------------------------------------- windows


def moving(speeds: np.ndarray, sample_time: float = 0.1) -> Any:
    return SimpleNamespace(time=sample_time * np.arange(len(speeds)), tip_speeds=speeds[:, None])


def test_the_window_has_the_fastest_motion_and_starts_calm() -> None:
    speeds = np.zeros(101)
    speeds[40:46] = [1.0, 3.0, 5.0, 3.0, 1.0, 0.1]
    (window,) = choose_windows(moving(speeds), 1.0)
    assert (window.end - window.start) == pytest.approx(1.0)
    assert window.first < 40 and window.last > 44
    assert not window.whole


def test_windows_do_not_overlap_and_come_in_order() -> None:
    speeds = np.full(101, 0.01)
    speeds[70:74], speeds[20:24] = 2.0, 1.0
    first, second = choose_windows(moving(speeds), 1.0, 2)
    assert first.last < second.first
    assert first.first <= 20 < first.last and second.first <= 70 < second.last
    assert len(choose_windows(moving(speeds), 6.0, 3)) == 1  # no room for more


def test_a_short_motion_is_one_window() -> None:
    (window,) = choose_windows(moving(np.ones(11)), 1.0, 3)
    assert window == Window(0, 10, 0.0, 1.0)
    assert window.whole


def test_later_inputs() -> None:
    profile = InputProfile.of(1, [Step(1, 0.5, 2.0)])
    moved = later(profile, 0.4)
    np.testing.assert_allclose(moved([0.05, 0.15]), [[0.0], [2.0]])
    np.testing.assert_allclose(moved.breakpoints, [0.1])


def test_inertia_is_asked_with_what_it_needs() -> None:
    """A quasi-static scene: rotary inertia comes with inertia, and is no finding of its own."""
    scene = Scene(ONE, effects=(MaterialDamping(),), actuation=StaticDrive())
    settings = replace(SETTINGS, profile=InputProfile.of(3, [Step(1, 0.0, 1.0)]))
    model = build(scene)
    motion = simulate(model, settings.profile, 0.05)
    found = certify(model, motion, settings)
    (inertia,) = (f for f in found.left_out if f.name == "inertia")
    moving = build(scene.with_(effects=(MaterialDamping(), Inertia(), RotaryInertia())))
    gap = simulate(moving, settings.profile, 0.05, **EXACT).tips - motion.tips
    assert inertia.windows_m[0] == pytest.approx(np.linalg.norm(gap, axis=2).max(), abs=1e-7)
    for name in ("rotary_inertia", "coriolis"):
        assert "needs inertia, which the scene leaves out" in found.skipped[name]


# ---------------------------------------------------------------- rests, stops, patience


@pytest.mark.slow
def test_end_posture_near_an_obstacle_is_on_the_side_where_the_motion_ended() -> None:
    """Statics from the straight arm lands beyond the post; the finer model's own motion does not.

    Finer from the last posture slips over the post as well, its own path tells which rest it is.
    """
    post = Cylinder(point=(-0.2, 0.0, 0.4), axis=(0.0, 1.0, 0.0), radius=0.05)
    scene = Scene(PAPER, effects=(*Scene(PAPER).effects, Contact(obstacles=(post,))))
    settings = SimulationSettings(InputProfile.of(6, [Step(u, 0.0, 1.5) for u in (1, 5, 6)]), 3.0)
    model, finer = build(scene), build(finer_scene(scene))
    motion, other = (simulate(each, settings.profile, 3.0) for each in (model, finer))
    rest = end_rest(model, motion)
    np.testing.assert_allclose(rest.tips, motion.tips[-1], atol=1e-6)
    assert farthest(find_equilibrium(model, rest.pressures).tips, rest.tips) > 0.1
    again = rest_again(model, rest, finer, motion.u[-1])
    np.testing.assert_allclose(again.tips, other.tips[-1], atol=1e-4)
    assert farthest(refine_equilibrium(finer, rest.pressures, other.q[-1]).tips, again.tips) < 1e-9


def test_no_end_posture_where_the_motion_did_not_come_to_rest(
    model: Model, motion: Simulation
) -> None:
    cut = replace(motion, **{n: getattr(motion, n)[:15] for n in ("time", "q", "u", "tips")})
    with pytest.raises(SoftmpcError, match=r"did not end at rest: its tips are \d"):
        end_rest(model, cut)
    with pytest.raises(SoftmpcError, match="did not come to its end"):
        end_rest(model, replace(motion, status="stopped: why"))


@pytest.mark.slow
@pytest.mark.parametrize("up", [True, False])
def test_an_arm_that_stays_at_an_unstable_rest_is_not_certified(up: bool) -> None:
    """A soft arm on end: all models agree that nothing moves, which means nothing."""
    soft = arm(replace(Section(), young_modulus=3e4))
    gravity = Gravity((0.0, 0.0, -9.81 if up else 9.81))
    model = build(SCENE.with_(manipulator=soft, effects=(gravity, Inertia(), MaterialDamping())))
    still = replace(SETTINGS, profile=InputProfile.of(3))
    found = certify(model, simulate(model, still.profile, 0.05), still)
    assert found.text.startswith("unknown: the arm stays at an unstable rest") == up
    assert (found.model.worst_m is None) == up
    assert (found.windows == ()) == up
    assert up or found.notes == ()


def test_a_stopped_motion_is_covered_up_to_its_stop(model: Model, motion: Simulation) -> None:
    stopped = replace(motion, status="stopped: the water boils, after t = 0.4 s")
    found = certify(model, stopped, SETTINGS, window=0.1)
    assert [(w.start, w.end) for w in found.windows] == [(pytest.approx(0.3), 0.4)]
    assert found.notes == (
        "only what came before is covered: stopped: the water boils, after t = 0.4 s",
        "postures at rest are not compared: the motion did not come to its end",
    )
    assert found.model.windows_m[0] and found.model.end_m is None
    assert found.summary()["notes"] == list(found.notes)


def test_a_window_at_the_end_beside_the_fastest() -> None:
    speeds = np.full(101, 0.01)
    speeds[20:24] = 2.0
    first, second = choose_windows(moving(speeds), 1.0, 2, to_the_end=True)
    assert first.first <= 20 < first.last < second.first
    assert (second.first, second.last) == (90, 100)


@pytest.mark.slow
def test_what_takes_too_long_is_given_up(
    model: Model, motion: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("softmpc.study.measure.PATIENCE", 0.0)
    found = certify(model, motion, SETTINGS)
    assert found.numerical.windows_m == found.model.windows_m == (None,)
    assert found.left_out == ()
    assert "took longer than 0 s" in found.skipped["coriolis"]
    monkeypatch.setattr("softmpc.study.certify.ENOUGH", -1.0)
    assert "not begun" in certify(model, motion, SETTINGS).skipped["coriolis"]


def test_divided_inputs_are_the_same_and_cut_a_run(model: Model) -> None:
    profile = InputProfile.of(3, [Step(1, 0.1, 2.0), Ramp(2, 0.1, 0.3, 5.0)])
    assert len(profile.breakpoints) == 2
    more = divided(profile, 0.01, 0.4)
    times = np.linspace(0.0, 0.5, 501)
    np.testing.assert_array_equal(more(times), profile(times))
    seen: list[float] = []
    simulate(model, more, 0.4, progress=lambda done, _: seen.append(done))
    assert len(seen) >= 10
    assert np.diff([0.0, *seen]).max() == pytest.approx(0.04)
