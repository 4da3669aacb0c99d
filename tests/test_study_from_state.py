"""Studies of a motion that starts from a given state, which other scenes do not have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arms import arm, model_of

from softmpc.model.actuation import PressureDrive
from softmpc.model.formulations import VirtualPower
from softmpc.model.mass import GaussMass
from softmpc.model.model import Model, build
from softmpc.model.parameters import Section
from softmpc.simulation.inputs import InputProfile
from softmpc.simulation.run import simulate
from softmpc.simulation.settings import SimulationSettings
from softmpc.study.ablate import Baseline
from softmpc.study.certify import certify
from softmpc.study.measure import Runner
from softmpc.study.variants import variants

START = np.array([0.02, -0.5, 0.1, 3.0])
SETTINGS = SimulationSettings(InputProfile.of(3), 0.05, start=START)


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOFTMPC_COMPILE", "never")


@pytest.fixture
def model() -> Model:
    return model_of(arm(Section()), strains=("epsilon", "kappa_y"), actuation=PressureDrive())


def test_a_finer_scene_starts_in_the_same_shape(model: Model) -> None:
    motion = simulate(model, SETTINGS.profile, 0.05, start=START)
    found = certify(model, motion, SETTINGS).model
    assert found.reasons == ()
    slots = {"segments": 2, "formulation": VirtualPower(GaussMass(3))}
    finer = build(model.scene.with_(**slots))
    halves = np.concatenate([np.tile(START[:2], 2), np.tile(START[2:], 2)])
    again = simulate(finer, SETTINGS.profile, 0.05, start=halves, tip_tolerance=1e-9)
    gap = np.linalg.norm(again.tips - motion.tips, axis=2).max()
    assert found.windows_m[0] == pytest.approx(gap, abs=1e-6)


def test_an_ablation_says_which_rows_have_no_such_state(model: Model) -> None:
    settings = replace(SETTINGS, duration=0.02)
    baseline = Baseline.of(model.scene, Runner(settings, 1))
    changes = {change.name: change for change in variants(model.scene)}
    row = baseline.row(changes["segments 2 a section"])
    assert 'has other states than the one that the motion starts from; take start = "rest"' in (
        row.status
    )
    assert baseline.row(changes["without coriolis"]).status == "finished"
