"""`softmpc compare A.csv B.csv`: distance of the section tips of two motions, Eq. (37)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import Answer, answering, table

if TYPE_CHECKING:
    from softmpc.simulation.compare import Comparison

__all__ = ["command"]

CSV = click.Path(path_type=Path)


@click.command("compare")
@click.argument("a", type=CSV, metavar="A.csv")
@click.argument("b", type=CSV, metavar="B.csv")
@answering("compare")
def command(a: Path, b: Path, out: Path | None) -> Answer:
    """Compare the section tips of two motions, for instance two simulation.csv.

    Both files need the columns t (s), x_1, y_1, z_1, x_2, … (m). The distances are taken at the
    times of A.csv that B.csv covers.
    """
    from softmpc.simulation.compare import compare_files

    found = compare_files(a, b)
    data = {"a": str(a), "b": str(b), **found.summary()}
    if out:
        _write(out, found)
    return Answer(data, _text(data))


def _write(out: Path, found: Comparison) -> None:
    from softmpc.simulation.columns import write_columns
    from softmpc.view.style import save_figure
    from softmpc.view.time_plots import errors_figure

    columns = {f"ERR_{i} [m]": error for i, error in enumerate(found.errors.T, 1)}
    write_columns(out / "compare.csv", {"t [s]": found.time, **columns})
    save_figure(errors_figure(found.time, found.errors), out / "compare.png")


def _text(data: dict[str, Any]) -> str:
    span = f"{data['from_s']:g} to {data['to_s']:g} s, {data['samples']} samples"
    rows: list[tuple[str, object]] = [("time", span)]
    for i, error in enumerate(data["largest_by_section_m"], 1):
        rows.append((f"largest ERR_{i}", f"{error:.6f} m"))
    rows.append(("largest sectional", f"{data['largest_sectional_m']:.6f} m"))
    rows.append(("largest cumulative", f"{data['largest_cumulative_m']:.6f} m"))
    return table(rows)
