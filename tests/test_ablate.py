"""Ablation and proposals: rows against independent runs and closed forms, interrupts, reasons."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from arms import arm

from softmpc.errors import InputError, SceneError
from softmpc.model.actuation import FrictionDrive, HydraulicDrive, PressureDrive, StaticDrive
from softmpc.model.drive_effects import RotorInertia, TubeInertance
from softmpc.model.effects import (
    EFFECTS,
    Contact,
    Coriolis,
    Effect,
    EnvironmentDamping,
    Gravity,
    Inertia,
    MaterialDamping,
    TipLoad,
)
from softmpc.model.model import Model, build
from softmpc.model.parameters import Hydraulics, Manipulator, Section
from softmpc.model.scene import Scene
from softmpc.model.scene_file import read_document, save_scene, scene_to_dict, write_document
from softmpc.simulation.inputs import InputProfile, Step
from softmpc.simulation.integrator import IntegrationError
from softmpc.simulation.run import simulate, simulate_file
from softmpc.simulation.settings import SimulationSettings
from softmpc.study.ablate import Ablation, Baseline, Row, ablate, ablate_file, read_study
from softmpc.study.changes import adding, driving, without
from softmpc.study.lengths import length_m, length_text
from softmpc.study.measure import Cost, Runner, motion_of
from softmpc.study.propose import propose, write_proposal
from softmpc.study.variants import additions, variants

ONE = arm(Section())
PLANAR = ("epsilon", "kappa_y")
BENDING = SimulationSettings(InputProfile.of(3, [Step(1, 0.0, 0.4e6)]), 0.2)
MOTION = """
[simulate]
duration = 0.2
steps = [{ unit = 1, at = 0.0, pressure = 0.4 }]
"""


def instructions(runner: Runner, model: Model, beside: Model) -> tuple[float, float]:
    """Instead of times, which are noise for motions as short as these."""
    return tuple(Cost.of(each, 0.0).instructions / 1e6 for each in (model, beside))  # type: ignore[return-value]


@pytest.fixture(autouse=True, scope="module")
def _quick() -> Iterator[None]:
    """Each variant runs a fraction of a second: compiling it would take longer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOFTMPC_COMPILE", "never")
        patch.setattr(Runner, "wall_s", instructions)
        yield


def planar(**changes: object) -> Scene:
    slots = {"strains": PLANAR, "actuation": PressureDrive()} | changes
    return Scene(ONE, **slots)  # type: ignore[arg-type]


IN_SPACE = planar(strains=("epsilon", "kappa_x", "kappa_y"))


@pytest.fixture(scope="module")
def found() -> Ablation:
    return ablate(planar(), BENDING, title="bending")


def scene_file(folder: Path) -> Path:
    path = folder / "scene.toml"
    save_scene(IN_SPACE, path)
    path.write_text('title = "bending"\n' + path.read_text(encoding="utf-8") + MOTION, "utf-8")
    return path


@pytest.fixture(scope="module")
def in_space(tmp_path_factory: pytest.TempPathFactory) -> Ablation:
    """The same motion, which stays in a plane, of an arm that could leave it."""
    return ablate_file(scene_file(tmp_path_factory.mktemp("scene")))


def row_of(found: Ablation, start: str) -> Row:
    (row,) = (row for row in found.rows if row.change.name.startswith(start))
    return row


# ---------------------------------------------------------------- rows


def test_a_run_that_takes_too_long_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softmpc.study.measure.PATIENCE", 0.0)
    with pytest.raises(IntegrationError, match="took longer than 0 s"):
        motion_of(build(planar()), BENDING)


def test_row_is_the_difference_of_two_runs(found: Ablation) -> None:
    """By another method than the study's."""
    light = replace_effects(planar(), Gravity)
    runs = [
        simulate(build(scene), BENDING.profile, 0.2, method="idas", tolerance=1e-11)
        for scene in (planar(), light)
    ]
    gaps = np.linalg.norm(runs[0].tips - runs[1].tips, axis=2)[:, 0]
    errors = row_of(found, "without gravity").errors
    assert errors is not None
    assert gaps.max() > 1e-3
    assert errors.largest[0] == pytest.approx(gaps.max(), abs=1e-7)
    assert errors.rms[0] == pytest.approx(np.sqrt(np.mean(gaps**2)), abs=1e-7)


def replace_effects(scene: Scene, *kinds: type[Effect]) -> Scene:
    return scene.with_(effects=tuple(e for e in scene.effects if not isinstance(e, kinds)))


def test_cost_is_that_of_the_model(found: Ablation) -> None:
    cost = row_of(found, "without gravity").cost
    model = build(replace_effects(planar(), Gravity))
    assert cost is not None
    assert cost.residual == model.residual.n_instructions()
    assert cost.residual_jacobian == model.residual_jacobian.n_instructions()
    assert (cost.states, cost.drive) == (4, 0)
    quasi_static = row_of(found, "without inertia").cost
    assert quasi_static is not None
    assert quasi_static.states == 2
    assert quasi_static.instructions < found.baseline.cost.instructions


TIMED = Runner.wall_s


def test_times_are_medians_of_runs_by_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    runner, model, beside = Runner(BENDING, 3), build(planar()), build(planar(segments=2))
    spent = {model: iter([1.0, 9.0, 2.0]), beside: iter([4.0, 3.0, 8.0])}
    order = []

    def own(self: Runner, each: Model) -> SimpleNamespace:
        order.append(each)
        return SimpleNamespace(wall_s=next(spent[each]))

    monkeypatch.setattr(Runner, "own", own)
    assert TIMED(runner, model, beside) == (2.0, 4.0)
    assert order == [model, beside] * 3


def test_numerical_floor_is_far_below_the_rows(found: Ablation) -> None:
    changes = [row.errors.worst for row in found.rows if row.errors]
    assert 0 < found.baseline.floor_m < 1e-6
    assert found.baseline.floor_m < found.baseline.own_m < 1e-3
    assert max(changes) > 1e4 * found.baseline.floor_m


def test_an_effect_without_coefficient_changes_nothing() -> None:
    still = replace(ONE.sections[0], linear_damping=0.0, angular_damping=0.0)
    scene = planar().with_(manipulator=arm(still))
    (change,) = (c for c in variants(scene) if c.name == f"without {EnvironmentDamping.name}")
    baseline = Baseline.of(scene, Runner(BENDING))
    errors = baseline.row(change).errors
    assert errors is not None
    assert errors.worst <= baseline.floor_m


def test_stretch_by_a_load_in_closed_form() -> None:
    """F l/(3 E A_s): the arm without mass, damping and bending follows at once."""
    load = TipLoad(force=(0.0, 0.0, 12.0))
    scene = planar(strains=("epsilon",), effects=(load,))
    found = ablate(scene, replace(BENDING, profile=InputProfile.of(3)))
    section = ONE.sections[0]
    stretch = 12.0 * section.length / (3 * section.young_modulus * section.wall_area)
    errors = row_of(found, "without tip_load").errors
    assert errors is not None
    assert errors.largest[0] == pytest.approx(stretch, rel=1e-9)
    assert errors.rms[0] == pytest.approx(stretch, rel=1e-9)


def test_what_cannot_run_is_a_row_with_its_reason(in_space: Ablation) -> None:
    found = in_space
    row = row_of(found, "planar, bending about x only")
    assert "the motion is not planar: kappa_y up to" in row.status
    assert (row.errors, row.cost) == (None, None)
    assert row.summary(found.baseline.cost)["status"] == row.status
    assert row_of(found, "planar, bending about y only").status == "finished"
    assert "needs all four strains" in row_of(found, "formulation newton-euler-full").status
    assert found.status == "finished"


def test_finer_rows_converge(found: Ablation) -> None:
    """Second order in the segment length: what 4 segments change is 5/4 of what 2 change."""
    two, four = (row_of(found, f"segments {n} a section").errors for n in (2, 4))
    assert two and four
    assert 1.1 < four.worst / two.worst < 1.4


# ---------------------------------------------------------------- variants


@dataclass(frozen=True)
class Ballast(Effect):
    """Weight of a sleeve; no registry knows it."""

    name: ClassVar[str] = "ballast"
    needs: ClassVar[tuple[str, ...]] = ("gravity",)

    def on_body(self, section: Section, share: float) -> dict[str, float]:
        return {"heavy": 0.3 * share}


def test_variants_follow_from_the_scene() -> None:
    scene = planar(effects=(Gravity(), Inertia(), Coriolis(), MaterialDamping(), Ballast()))
    names = [change.name for change in variants(scene)]
    assert names[:5] == [
        "without gravity (nor ballast)",
        "without inertia (nor coriolis)",
        "without coriolis",
        "without material_damping",
        "without ballast",
    ]
    assert len(set(names)) == len(names)
    added = {change.slot for change in additions(scene)}
    missing = {k.name for k in EFFECTS} - {effect.name for effect in scene.effects}
    assert added == {f"effect {name}" for name in missing}


def test_strains_that_lose_their_mass_are_left_out() -> None:
    smaller = without(Scene(ONE), ["rotary_inertia"])
    assert smaller.strains == ("epsilon", "kappa_x", "kappa_y")
    assert build(smaller).massless == ()


def test_coarser_drives_lose_what_they_cannot_have() -> None:
    effects = (Inertia(), MaterialDamping(), TubeInertance(), RotorInertia())
    scene = planar(actuation=HydraulicDrive(), effects=effects)
    assert driving(scene, StaticDrive()).effects == effects[:2]
    names = [change.name for change in variants(scene)]
    assert "static drive (nor tube_inertance, rotor_inertia)" in names
    assert "plain hydraulic drive (without tube_inertance, rotor_inertia)" in names


def test_drives_without_friction_leave_it_out() -> None:
    rough = Manipulator(name="rough", sections=(Section(),), hydraulics=Hydraulics(friction=20.0))
    scene = planar(actuation=FrictionDrive()).with_(manipulator=rough)
    smooth = driving(scene, HydraulicDrive())
    assert smooth.manipulator.hydraulics.friction == 0.0
    assert smooth.actuation == HydraulicDrive()


def test_added_effects_bring_what_they_need() -> None:
    scene = planar(effects=(MaterialDamping(),))
    assert [e.name for e in adding(scene, Coriolis).effects] == [
        "inertia",
        "coriolis",
        "material_damping",
    ]
    twisting = adding(Scene(ONE, effects=(), actuation=PressureDrive()), Coriolis)
    assert [e.name for e in twisting.effects] == ["inertia", "coriolis", "rotary_inertia"]
    assert build(twisting).massless == ()
    with pytest.raises(SceneError, match="effect 'contact' has no default parameters"):
        adding(scene, Contact)


# ---------------------------------------------------------------- proposals


@pytest.mark.sampled
@pytest.mark.parametrize("tolerance", [2e-3, 2e-2])
def test_proposed_scene_is_within_the_tolerance(
    tmp_path: Path, in_space: Ablation, tolerance: float
) -> None:
    """Its file, run by IDAS beside the scene as given."""
    path = scene_file(tmp_path)
    proposal = propose(in_space, tolerance)
    target = write_proposal(proposal, read_document(path), tmp_path, tmp_path / "out")
    exact = {"method": "idas", "tolerance": 1e-10}
    given, cheap = (simulate_file(file, **exact) for file in (path, target))
    error = np.linalg.norm(given.tips - cheap.tips, axis=2).max()
    assert error <= tolerance
    assert proposal.within
    assert proposal.errors.worst == pytest.approx(error, abs=3e-4)  # its own integration
    assert len(cheap.q[0]) < len(given.q[0])  # the motion is planar
    assert proposal.changes
    assert cheap.title == f"bending, within {tolerance:g} m"


def test_nothing_within_a_nanometre_but_the_scene_itself(found: Ablation) -> None:
    proposal = propose(found, 1e-9)
    assert proposal.changes == ()
    assert proposal.scene == planar()
    assert not proposal.within  # its own integration is not that exact
    assert proposal.summary()["within"] is False
    with pytest.raises(InputError, match="tolerance = 0"):
        propose(found, 0.0)


def test_input_table_is_copied_beside_the_proposal(tmp_path: Path, found: Ablation) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "in" / "push.csv").write_text("t,P_1\n0,0\n0.1,0.4\n", encoding="utf-8")
    document = scene_to_dict(planar()) | {"simulate": {"duration": 0.2, "table": "in/push.csv"}}
    proposal = propose(found, 1e-9)
    target = write_proposal(proposal, document, tmp_path, tmp_path / "out")
    _, scene, settings = read_study(target)
    assert scene == planar()
    np.testing.assert_allclose(settings.profile(0.05), [0.2e6, 0, 0])


# ---------------------------------------------------------------- interrupts, files


def test_interrupt_keeps_the_rows_done() -> None:
    def progress(done: float, total: float) -> None:
        if done == 2:
            signal.raise_signal(signal.SIGINT)

    found = ablate(planar(), BENDING, progress=progress)
    assert found.status == "interrupted"
    assert [row.status for row in found.rows] == ["finished", "finished"]
    assert found.summary()["status"] == "interrupted"
    assert len(found.columns()["change"]) == 2


def test_columns_have_an_entry_for_every_row(found: Ablation) -> None:
    columns = found.columns()
    assert {len(column) for column in columns.values()} == {len(found.rows)}
    assert {"change", "status", "max_error_m", "max_errors_m_1", "time_ratio"} <= set(columns)


def test_a_scene_without_motion_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "still.toml"
    write_document(scene_to_dict(planar()), path)
    with pytest.raises(SceneError, match=r"still\.toml: has no table \[simulate\]"):
        ablate_file(path)
    with pytest.raises(InputError, match="repeats = 0"):
        ablate(planar(), BENDING, repeats=0)


# ---------------------------------------------------------------- lengths


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("1mm", 1e-3),
        ("0.5 mm", 5e-4),
        ("50um", 5e-5),
        ("50µm", 5e-5),
        ("2cm", 0.02),
        ("1e-3m", 1e-3),
    ],
)
def test_lengths(text: str, metres: float) -> None:
    assert length_m(text) == pytest.approx(metres, rel=1e-12)


@pytest.mark.parametrize("text", ["1", "mm", "1 inch", "-1mm", "0mm", "1e3m", "1..2mm", ""])
def test_wrong_lengths(text: str) -> None:
    with pytest.raises(InputError, match="must be"):
        length_m(text)


def test_lengths_for_people() -> None:
    shown = [length_text(x) for x in (0.0, 2e-8, 1.5e-6, 9.996e-4, 0.0421, 2.0)]
    assert shown == ["0", "0.02 µm", "1.5 µm", "1 mm", "42.1 mm", "2 m"]
