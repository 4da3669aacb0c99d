"""`softmpc calibrate SCENE DATA`: parameters of a scene fitted to measurements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import (
    INTERRUPTED,
    NOT_CONVERGED,
    Answer,
    answering,
    load,
    progress,
    scene_argument,
    table,
)
from softmpc.cli.sweep_options import executor_for, sweep_options

if TYPE_CHECKING:
    from softmpc.study.calibration_result import Calibration

__all__ = ["command"]

SHOWN = 8  # residuals in the text
CLOSE = 0.95  # correlation from which a pair is named


@click.command("calibrate")
@scene_argument
@click.argument("data", type=click.Path(path_type=Path), metavar="DATA")
@click.option(
    "--starts", type=click.IntRange(min=1), default=1, show_default=True, metavar="N",
    help="Search from N starts within the bounds, and take the best.",
)  # fmt: skip
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of those starts.")
@sweep_options
@answering("calibrate")
def command(
    scene: Path,
    data: Path,
    starts: int,
    seed: int,
    workers: int | None,
    dask: str | None,
    out: Path | None,
) -> Answer:
    """Fit parameters of the scene file SCENE to what the TOML file DATA says was measured.

    DATA names the parameters, with bounds and priors, and has or points to static poses, motion
    records and summary values.
    """
    from softmpc.study.calibrate import calibrate
    from softmpc.study.calibration_files import load_calibration

    problem = load_calibration(data, load(scene)[1])
    with executor_for(workers, dask) as executor, progress("calibrating", "arm") as tell:
        found = calibrate(problem, starts=starts, seed=seed, executor=executor, progress=tell)
    summary = found.summary()
    if out:
        _write(out, scene, found)
    if found.converged:
        return Answer(summary, _text(found))
    if found.status == "interrupted":
        return Answer(summary, _text(found), INTERRUPTED, "interrupted; the best so far is kept")
    return Answer(summary, _text(found), NOT_CONVERGED, f"the calibration: {found.status}")


def _write(out: Path, scene: Path, found: Calibration) -> None:
    from softmpc.model.scene_file import read_document
    from softmpc.view.calibration import calibration_figure
    from softmpc.view.style import save_figure

    kept = ("title", "simulate", "track")
    document = read_document(scene)
    found.save(out, {key: document[key] for key in kept if key in document})
    save_figure(calibration_figure(found), out / "calibration.png")


def _text(found: Calibration) -> str:
    freedom = f"{found.freedom:.1f}".removesuffix(".0")
    rows: list[tuple[str, object]] = [
        ("status", found.status),
        ("chi²", f"{found.chi2:.4g} with {freedom} degrees of freedom"),
        ("fit", found.verdict),
        ("arms computed", f"{found.arms} in {found.wall_s:.1f} s"),
    ]
    if found.starts > 1:
        rows.append(("starts", f"{found.agreeing} of {found.starts} ended here"))
    parts = [found.title, table(rows), _estimates(found)]
    parts += [_list("The data alone cannot see", found.undetermined)]
    parts += [_list("Hardly told apart", _close(found)), _residuals(found), _beside(found)]
    return "\n\n".join(part for part in parts if part)


def _estimates(found: Calibration) -> str:
    head = ("parameter", "estimate", "std error", "95 % interval", "unit", "from")
    rows: list[tuple[str, ...]] = [head]
    for e in found.estimates:
        interval = f"{e.low95:.5g} to {e.high95:.5g}" if not e.bound else f"at its {e.bound} bound"
        error = "" if e.bound else f"{e.std_error:.2g}"
        rows.append((e.path, f"{e.estimate:.6g}", error, interval, e.unit, e.source))
    return _aligned(rows)


def _aligned(rows: list[tuple[str, ...]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        for row in rows
    ]
    return "\n".join(line.rstrip() for line in lines)


def _list(title: str, lines: Any) -> str:
    return "\n".join([f"{title}:", *(f"  {line}" for line in lines)]) if lines else ""


def _close(found: Calibration) -> list[str]:
    """Pairs whose estimates go together."""
    names = [e.path for e in found.estimates]
    return [
        f"{names[i]} and {names[j]}: correlation {found.correlation[i, j]:+.3f}"
        for i in range(len(names))
        for j in range(i)
        if abs(found.correlation[i, j]) > CLOSE
    ]


def _residuals(found: Calibration) -> str:
    head = ("largest residuals", "measured", "shown", "in sigmas")
    rows: list[tuple[str, ...]] = [head]
    for r in found.largest(SHOWN):
        measured = f"{r.sense if r.sense != '=' else ''}{r.measured:.5g}"
        rows.append((r.name, measured, f"{r.shown:.5g}", f"{r.residual + 0.0:+.2f}"))
    return _aligned(rows)


def _beside(found: Calibration) -> str:
    """Values that were set beside the arm and not fitted."""
    rows: list[tuple[str, ...]] = [("not fitted", "given", "shown")]
    rows += [
        (r.name, f"{r.measured:.5g}", f"{r.shown:.5g}") for r in found.residuals if not r.fitted
    ]
    return _aligned(rows) if len(rows) > 1 else ""
