"""What is refused without a search: never a place that the arm could reach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softmpc.control.paths import Circle, Line, Point, Reference, TimeLaw
from softmpc.control.preflight import check_reach
from softmpc.errors import InputError
from softmpc.model.kinematics import ConstantStrainArc, PaperArc
from softmpc.model.model import Model, build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.reach import farthest, too_far

LAW = TimeLaw(4.0, 1.0)
MOST = 1.5  # m: 0.5 m stretched to three times that


def scene(stretch: float = 2.0, **changes: object) -> Scene:
    arm = chen2022()
    limits = replace(arm.limits, stretch_max=stretch)
    return Scene(replace(arm, limits=limits), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("arc", [ConstantStrainArc(), PaperArc()], ids=lambda arc: arc.name)
@pytest.mark.parametrize("segments", [1, 2])
def test_no_posture_within_the_limits_is_farther(arc: object, segments: int) -> None:
    """Any strains, in equilibrium or not; the straight arm at full stretch is there."""
    some = scene(0.4, kinematics=arc, segments=segments)
    model, rng = build(some), np.random.default_rng(3)
    count = model.strains // 4
    q = np.tile([0.4, 0.0, 0.0, 0.0], count)
    ends = [np.asarray(tip) for tip in np.asarray(model.frames(q)[0]).T]
    for k, tip in enumerate(ends, 1):
        assert farthest(some, k) == pytest.approx(np.linalg.norm(tip), rel=1e-12)
    assert farthest(some) == farthest(some, 2) == pytest.approx(0.7)
    for _ in range(200):
        q = np.ravel([[rng.uniform(-0.5, 0.4), *rng.normal(0, 8, 3)] for _ in range(count)])
        tips = np.asarray(model.frames(q)[0]).T
        assert all(not too_far(some, tip, k) for k, tip in enumerate(tips, 1))


def test_an_arm_that_does_not_stretch() -> None:
    assert farthest(scene(strains=("kappa_x", "kappa_y"))) == pytest.approx(0.5)


def test_words_and_free_coordinates() -> None:
    said = too_far(scene(), (120.0, None, 570.0))
    assert said.startswith("(120, -, 570) m is 582.5 m from the base, but the arm is 1.5 m long")
    assert said.endswith("are these metres?")
    assert not too_far(scene(), (None, None, 1.4)) and not too_far(scene(), (2.0, 0, 0), times=1.5)


# ---------------------------------------------------------------- paths


class Searched(Exception):
    pass


@pytest.fixture(scope="module")
def model() -> Model:
    return build(scene())


@pytest.fixture
def no_search(model: Model, monkeypatch: pytest.MonkeyPatch) -> InverseStatics:
    def search(*_: object, **__: object) -> None:
        raise Searched

    monkeypatch.setattr(InverseStatics, "solve", search)
    return InverseStatics(model, starts=6)


@pytest.mark.parametrize("project", [False, True])
def test_millimetres_are_refused_without_a_search(no_search: InverseStatics, project: bool) -> None:
    far = Reference(Circle((120.0, 0.0, 570.0), 80.0), LAW)
    with pytest.raises(InputError, match=r"\(160, 0, 570\) m is 592 m .* 1.5 m .* metres\?"):
        check_reach(no_search, far, project)


def test_a_little_farther_may_be_projected(no_search: InverseStatics) -> None:
    for distance, project, refused in ((1.6, False, True), (1.6, True, False), (2.3, True, True)):
        path = Reference(Point((0.0, 0.0, distance)), LAW)
        if refused:
            with pytest.raises(InputError, match="out of reach"):
                check_reach(no_search, path, project)
        else:
            assert check_reach(no_search, path, project) is None


@pytest.mark.slow
def test_a_path_all_of_which_is_away(model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five places are enough to say so; what they miss is what inverse statics says."""
    inverse, calls, solve = InverseStatics(model, starts=6), [0], InverseStatics.solve

    def counted(self: InverseStatics, *given: object, **more: object) -> object:
        calls[0] += 1
        return solve(self, *given, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(InverseStatics, "solve", counted)
    found = check_reach(inverse, Reference(Circle((1.2, 0.0, 0.57), 0.12), LAW))
    assert found is not None and calls[0] == 5
    alone = InverseStatics(model).solve(_position(found.place))
    assert found.excess == pytest.approx(1e3 * alone.distance, abs=1.0)
    assert found.place == pytest.approx((1.26, 0.0, 0.57))
    assert (
        "out of reach by up to 671 mm, at (1.260, 0.000, 0.570) m (no place of the 5" in found.text
    )


def test_others_are_looked_at_as_a_whole(model: Model) -> None:
    """In reach, 20 mm beyond, and begun or ended in reach: none is refused here."""
    inverse = InverseStatics(model, starts=6)
    near, far = (0.1, 0.0, 0.57), (1.2, 0.0, 0.57)
    for path in (Circle((0.12, 0.0, 0.57), 0.08), Circle((0.54, 0.0, 0.50), 0.08), Line(near, far)):
        assert check_reach(inverse, Reference(path, LAW)) is None
    assert check_reach(inverse, Reference(Line(far, near), LAW)) is None


def _position(place: tuple[float, ...]):
    from softmpc.statics.targets import Position

    return Position(place)
