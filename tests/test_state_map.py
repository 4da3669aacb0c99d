"""States of a cheaper scene from those of the plant."""

import numpy as np
import pytest

from softmpc.control.state_map import StateMap
from softmpc.errors import SceneError
from softmpc.model.actuation import PressureDrive, SlowDrive, StaticDrive
from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene

FULL = build(Scene(chen2022()))
FINE = build(Scene(chen2022(), segments=3))
SLOW = build(Scene(chen2022(), actuation=SlowDrive()))
PLANAR = build(Scene(chen2022(), strains=("epsilon", "kappa_y")))


def random_state(model, seed: int = 0) -> np.ndarray:
    scale = model.layout.x.scale
    return scale * np.random.default_rng(seed).uniform(-0.3, 0.3, len(scale))


def test_same_scene_is_the_identity() -> None:
    same = StateMap(FULL, build(Scene(chen2022())))
    x = random_state(FULL)
    assert same.is_identity and np.array_equal(same(x, np.zeros(6)), x)


def test_fewer_segments_bend_a_section_as_much() -> None:
    mapped, x = StateMap(FINE, FULL), random_state(FINE)
    found = dict(zip(FULL.layout.x.names, mapped(x, np.zeros(6)), strict=True))
    given = dict(zip(FINE.layout.x.names, x, strict=True))
    for kind in ("kappa_x", "d_kappa_x", "epsilon"):
        parts = [given[f"{kind}_2_{j}"] for j in (1, 2, 3)]
        assert found[f"{kind}_2_1"] == pytest.approx(np.mean(parts))
    assert found["P_a_4"] == given["P_a_4"]


def test_more_segments_and_uneven_ones() -> None:
    two = build(Scene(chen2022(), segments=2))
    found = StateMap(FULL, FINE)(random_state(FULL), np.zeros(6))
    assert found[0] == found[4] == found[8]
    share = StateMap(FINE, two).A[0, :12:4]  # epsilon of the first half from three thirds
    assert share == pytest.approx([2 / 3, 1 / 3, 0])


def test_missing_strains_are_dropped_and_unknown_ones_are_zero() -> None:
    x = random_state(FULL)
    down = StateMap(FULL, PLANAR)(x, np.zeros(6))
    assert down[:2] == pytest.approx(x[[0, 2]])
    up = dict(zip(FULL.layout.x.names, StateMap(PLANAR, FULL)(down, np.zeros(6)), strict=True))
    assert up["kappa_x_1_1"] == up["kappa_z_2_1"] == 0.0
    assert up["kappa_y_1_1"] == x[2]


def test_slow_mode_moves_as_it_does_in_the_whole_drive() -> None:
    """The mapped state decays with the slow pole, whatever state the drive is in."""
    from scipy.linalg import expm

    mapped, full, slow = StateMap(FULL, SLOW), FULL.drive, SLOW.drive
    n, x = FULL.strains, random_state(FULL)
    later = x.copy()
    later[2 * n :] = expm(0.03 * full.A) @ x[2 * n :]
    now, then = (mapped(v, np.zeros(6))[2 * n :] for v in (x, later))
    assert then == pytest.approx(expm(0.03 * slow.A) @ now)
    u = np.array([0.5, 1.0, 0.2, 0.8, 1.5, 2.0])
    x[2 * n :] = full.at_rest(u)
    assert mapped(x, u)[2 * n :] == pytest.approx(slow.at_rest(u))


def test_whole_drive_from_a_simpler_one_is_in_balance() -> None:
    static = build(Scene(chen2022(), actuation=StaticDrive()))
    u = np.linspace(0.2, 1.2, 6)
    x = np.zeros(2 * static.strains)
    assert StateMap(static, FULL)(x, u)[16:] == pytest.approx(FULL.drive.at_rest(u))


def test_other_arms_are_refused() -> None:
    with pytest.raises(SceneError, match=r"takes torques.*pressures"):
        StateMap(build(Scene(chen2022(), actuation=PressureDrive())), FULL)
