"""Eq. (37) on hand-made motions, and its files."""

from pathlib import Path

import numpy as np
import pytest

from softmpc.errors import InputError
from softmpc.simulation.compare import TipPath, compare, compare_files, read_tips

TIME = np.linspace(0.0, 1.0, 11)


def path(time: np.ndarray = TIME, sections: int = 2) -> TipPath:
    """Tips that move along a line, section i at speed i."""
    tips = np.zeros((len(time), sections, 3))
    tips[:, :, 0] = np.outer(time, np.arange(1, sections + 1))
    return TipPath(time, tips)


def test_errors_of_each_section_and_of_both() -> None:
    a, b = path(), path()
    b.tips[3, 0] += (0.03, 0.04, 0.0)
    b.tips[7, 0] += (0.0, 0.0, 0.03)
    b.tips[7, 1] += (0.0, 0.04, 0.0)
    found = compare(a, b)
    assert found.errors.shape == (11, 2)
    assert found.errors[3] == pytest.approx([0.05, 0.0])
    assert found.largest_sectional == pytest.approx(0.05)
    assert found.largest_cumulative == pytest.approx(0.07)
    assert found.summary()["largest_by_section_m"] == pytest.approx([0.05, 0.04])


def test_other_stamps_are_interpolated_where_both_are() -> None:
    found = compare(path(), path(np.array([0.25, 0.9, 3.0])))
    np.testing.assert_allclose(found.time, TIME[3:])
    np.testing.assert_allclose(found.errors, 0.0, atol=1e-15)


def test_equal_stamps_lose_nothing() -> None:
    a = path()
    assert compare(a, a).largest_cumulative == 0.0


def test_what_cannot_be_compared() -> None:
    with pytest.raises(InputError, match="2 section tips against 3"):
        compare(path(), path(sections=3))
    with pytest.raises(
        InputError, match="no common time: the first has 0 to 1 s, the second 2 to 3"
    ):
        compare(path(), path(TIME + 2.0))
    with pytest.raises(InputError, match="must be"):
        compare(TipPath(TIME, np.zeros((11, 3))), path())


def test_files(tmp_path: Path) -> None:
    one, two = tmp_path / "one.csv", tmp_path / "two.csv"
    one.write_text("t,x_1,y_1,z_1\n0,0,0,0\n1,0,0,1\n")
    two.write_text("t [s], z_1 [m], y_1 [m], x_1 [m], T_1 [N·m]\n0,0,0,0,9\n2,2,0,0.1,9\n")
    assert compare_files(one, two).errors.ravel().tolist() == pytest.approx([0.0, 0.05])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,T_1\n0,1\n", "has no column x_1, y_1, z_1"),
        ("t,x_1,y_1\n0,1,1\n", "has no column z_1"),
        ("t,x_1,y_1,z_1,x_2\n0,1,1,1,1\n", "has no column y_2, z_2"),
    ],
)
def test_wrong_files(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "tips.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        read_tips(file)
    with pytest.raises(InputError, match="no such file"):
        read_tips(tmp_path / "none.csv")
