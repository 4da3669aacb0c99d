"""Size of the graphs: CI gates on instruction counts, which no machine's load can change.

`python -m tests.benchmarks.instructions` prints the whole table, with times.
"""

from __future__ import annotations

from functools import cache

import pytest
from arms import LEAN, model_of

from softmpc.compiled import instructions
from softmpc.model.counting import executed
from softmpc.model.model import Model


@cache
def lean(segments: int) -> Model:
    """The scene of the acceptance list: 2-point Gauss mass, exact ω, no rotary inertia."""
    return model_of(segments=segments, effects=LEAN)


def residual(segments: int) -> int:
    return lean(segments).residual.n_instructions()


def test_residual() -> None:
    assert residual(1) <= 2_500


def test_residual_grows_linearly() -> None:
    assert residual(8) - residual(4) <= 2.1 * (residual(4) - residual(2))


def test_directional_derivative_is_linear_in_the_segments() -> None:
    """A few times the residual, whatever the number of segments."""
    for segments in (1, 8):
        along = lean(segments).residual_along.n_instructions()
        assert along <= 3 * residual(segments)


def test_equations() -> None:
    """M, C, N and τ in one pass."""
    assert lean(1).equations.n_instructions() <= 7_000


def test_residual_jacobian() -> None:
    """In (q, dq, ddq) and p; plain automatic differentiation of a prototype took 41,000."""
    assert lean(1).residual_jacobian.n_instructions() <= 20_000


def test_jacobian_stays_usable_at_eight_segments() -> None:
    """2.5 million by automatic differentiation, which no compiler takes."""
    few, many = (lean(n).residual_jacobian for n in (4, 8))
    assert executed(many) <= 700_000, "of which half are products of matrices, quick ones"
    assert executed(many) <= 3.2 * executed(few), "below the square: the products grow with it"
    assert instructions(many) <= 35_000, "small functions called in loops"


# Full default scene, one segment a section; measured, and 2 % for changes nobody would notice.
DEFAULT = {
    "residual": 3151,
    "residual_jacobian": 23222,
    "M": 3742,
    "C": 8512,
    "N": 1122,
    "tau": 76,
    "equations": 10393,
    "balance": 1169,
    "stiffness": 3269,
    "frames": 446,
}


@pytest.mark.parametrize("name", DEFAULT)
def test_default_scene_does_not_grow(name: str) -> None:
    found = default().instructions()[name]
    assert found <= 1.02 * DEFAULT[name], f"{found} instructions, {DEFAULT[name]} recorded"


def test_every_counted_function_is_recorded() -> None:
    assert set(default().instructions()) == set(DEFAULT)


@cache
def default() -> Model:
    return model_of()
