"""CSV files of named columns: `t [s], x_1 [m], …`; a unit in brackets is for people only."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from softmpc.errors import InputError
from softmpc.files import replacing

__all__ = ["name_of", "read_columns", "read_rows", "read_titled", "write_columns"]

Path_ = str | os.PathLike[str]


def name_of(title: str) -> str:
    """The name in a title such as `T_1 [N·m]`."""
    return title.partition("[")[0].strip()


def read_columns(path: Path_, blanks: bool = False) -> dict[str, np.ndarray]:
    """Columns of a CSV file by name, without units; `t` must be there and increase.

    With `blanks` an empty cell is nan, but for `t`. Raises `InputError` for a missing file, no
    rows, a value that is no finite number, a name given twice, or times that do not increase.
    """
    return {name_of(title): column for title, column in read_titled(path, blanks).items()}


def read_titled(path: Path_, blanks: bool = False) -> dict[str, np.ndarray]:
    """As `read_columns`, by title with unit."""
    header, rows = read_rows(Path(path))
    names = [name_of(cell) for cell in header]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{path}: column {name!r} is there twice")
    if "t" not in names:
        raise InputError(f"{path}: has no column 't' (time in s); columns: {', '.join(names)}")
    values = np.array([_numbers(path, names, line, row, blanks) for line, row in rows])
    _check_times(path, values[:, names.index("t")], [line for line, _ in rows])
    return dict(zip((cell.strip() for cell in header), values.T, strict=True))


def write_columns(path: Path_, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of equal length; a crash leaves the last good file."""
    with replacing(path) as beside, open(beside, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))


def read_rows(path: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The header, and each row with the number of its line."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            rows = [(reader.line_num, row) for row in reader if any(c.strip() for c in row)]
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: is not a CSV file: {error}") from None
    if len(rows) < 2:
        raise InputError(f"{path}: must have a header line and at least one row of numbers")
    return rows[0][1], rows[1:]


def _numbers(path: Path_, names: list[str], line: int, row: list[str], blanks: bool) -> list[float]:
    if len(row) != len(names):
        raise InputError(f"{path}, line {line}: {len(row)} values, the header has {len(names)}")
    numbers = []
    for name, cell in zip(names, row, strict=True):
        try:
            number = float(cell)
        except ValueError:
            number = np.nan
        missing = blanks and name != "t" and not cell.strip()
        if not (missing or np.isfinite(number)):
            where = f"{path}, line {line}"
            raise InputError(f"{where}, {name} = {cell.strip()!r}: must be a finite number")
        numbers.append(number)
    return numbers


def _check_times(path: Path_, times: np.ndarray, lines: list[int]) -> None:
    back = np.flatnonzero(np.diff(times) <= 0)
    if len(back):
        k = int(back[0]) + 1
        raise InputError(
            f"{path}, line {lines[k]}: t = {times[k]:g} s follows t = {times[k - 1]:g} s; "
            "times must increase"
        )
