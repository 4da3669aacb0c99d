"""`softmpc codegen SCENE --out DIR`: the controller of a scene as a directory of C."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.cli.common import Answer, answering, scene_argument, stages, table

if TYPE_CHECKING:
    from softmpc.codegen.generate import Generated

__all__ = ["command"]

KINDS = ("nmpc", "lqr", "table")
STAGE = "checking the path", "place"
OF_NMPC = {"iterations": "--iterations", "max_rows": "--max-rows"}


@click.command("codegen")
@scene_argument
@click.option(
    "--controller", "kind", type=click.Choice(KINDS), default="nmpc", show_default=True,
    help="Nonlinear MPC, or a baseline behind the same interface: LQR, or a table of inverse "
    "statics with feedback.",
)  # fmt: skip
@click.option(
    "--iterations", type=click.IntRange(1, 1_000_000), default=1000, show_default=True,
    help="Most iterations of the quadratic program in a step.",
)  # fmt: skip
@click.option(
    "--max-rows", type=click.IntRange(1, 1_000_000),
    help="Rows of limits that may be near or active at once; all by default. Fewer take less "
    "memory, and a step that needs more fails with status 'too many rows'.",
)  # fmt: skip
@click.option(
    "--workspace", type=click.Path(exists=True, dir_okay=False, path_type=Path), metavar="FILE",
    help="workspace.npz of `softmpc workspace SCENE`: the monitor then knows how far tip and "
    "reference are from the edge of what is in reach.",
)  # fmt: skip
@click.option(
    "--footprint", "measured", is_flag=True,
    help="Compile for a Cortex-M7 with arm-none-eabi-gcc and print flash, RAM and stack.",
)  # fmt: skip
@answering("codegen")
def command(
    scene: Path,
    kind: str,
    iterations: int,
    max_rows: int | None,
    workspace: Path | None,
    measured: bool,
    out: Path | None,
) -> Answer:
    """Write the controller of the table [track] of SCENE as C99 into the folder --out.

    The folder needs nothing but a C compiler: `make run` in it runs the scene's path. Its README
    says more.
    """
    if out is None:
        raise click.UsageError("codegen needs a folder to write to: give --out DIR")
    if kind == "nmpc":
        made = _nonlinear(scene, out, iterations, max_rows, workspace)
    else:
        _refuse_options(kind)
        made = _baseline(scene, kind, out, workspace)
    return _with_footprint(made, out) if measured else made


def _with_footprint(made: Answer, folder: Path) -> Answer:
    from softmpc.codegen.footprint import footprint, footprint_table

    with stages("compiling for the board", "precision"):
        found = footprint(folder)
    return Answer(made.data | {"footprint": found}, made.text + "\n\n" + footprint_table(found))


def _nonlinear(
    scene: Path, out: Path, iterations: int, max_rows: int | None, workspace: Path | None
) -> Answer:
    from softmpc.codegen.generate import generate_file

    with stages(*STAGE) as stage:
        made = generate_file(
            scene, out, stage(*STAGE), iterations=iterations, max_rows=max_rows, workspace=workspace
        )
    data = _about(made) | _margins(out)
    return Answer(data, _text(data))


def _refuse_options(kind: str) -> None:
    """Raise `UsageError` for what was given and a baseline has no use for."""
    from click.core import ParameterSource

    source = click.get_current_context().get_parameter_source
    by_hand = ParameterSource.COMMANDLINE
    given = [option for name, option in OF_NMPC.items() if source(name) is by_hand]
    if given:
        raise click.UsageError(
            f"{' and '.join(given)} is for the quadratic program of --controller nmpc; {kind} has "
            "none: leave it out"
        )


def _baseline(scene: Path, kind: str, out: Path, workspace: Path | None) -> Answer:
    from softmpc.codegen.baselines import generate_baseline
    from softmpc.codegen.directory import checked_folder
    from softmpc.control.tracking import read_track_file, ready, set_up
    from softmpc.errors import errors_in
    from softmpc.statics.workspace_result import Workspace

    space = None if workspace is None else Workspace.load(workspace)
    checked_folder(out)  # before anything takes time
    title, arm, task = read_track_file(scene)
    with stages(*STAGE) as stage, errors_in(scene):
        setup = ready(lambda report: set_up(arm, task, progress=report), stage(*STAGE))
        generate_baseline(setup, kind, out, title, space)
    data = {"folder": str(out), "controller": kind, **_margins(out)}
    rows = [
        ("controller", kind),
        ("margins", _said(data)),
        ("folder", out),
        ("to run it", _run(out)),
    ]
    return Answer(data, table(rows))


def _margins(folder: Path) -> dict[str, float | None]:
    """How good the monitor's margins are, None without a workspace: what lines between its nodes
    cut off, and how far tips at rest of its arm and of the controller's model are apart."""
    from softmpc.codegen.directory_readme import macros_of

    macros = macros_of((folder / "monitor_data.h").read_text(encoding="utf-8"))
    names = {"margin_error_mm": "REACH_ERROR", "workspace_apart_mm": "REACH_APART"}
    known = macros["REACH"] == "1"
    return {key: 1e3 * float(macros[name]) if known else None for key, name in names.items()}


def _said(data: dict[str, Any]) -> str:
    """The same for people."""
    if data["margin_error_mm"] is None:
        return "not known: give --workspace"
    return (
        f"good to {data['margin_error_mm']:.3g} mm between the places of the workspace, whose tips "
        f"at rest are up to {data['workspace_apart_mm']:.3g} mm from this model's"
    )


def _run(folder: Path) -> str:
    return f"make -C {shlex.quote(str(folder))} test"


def _about(made: Generated) -> dict[str, Any]:
    """What programs are told."""
    sizes, worst = made.sizes, made.conditioning
    return {
        "folder": str(made.folder),
        "controller": "nmpc",
        "version": made.identity["VERSION"],
        "scene_hash": made.identity["SCENE_HASH"],
        "states": sizes["NX"],
        "inputs": sizes["INPUTS"],
        "intervals": sizes["N"],
        "moves": sizes["MOVES"],
        "rows": sizes["PROGRAM_ROWS"],
        "max_rows": sizes["MAX_ROWS"],
        "condition": worst.condition,
        "float_regularisation": None if worst.refused else worst.damping,
        "float_refused": worst.refused or None,
    }


def _text(data: dict[str, Any]) -> str:
    single = data["float_refused"] or f"regularised by {data['float_regularisation']:.1e}"
    return table([
        ("controller", f"{data['states']} states, {data['inputs']} inputs, "
         f"{data['intervals']} intervals"),
        ("program", f"{data['moves']} moves, {data['rows']} rows of limits"),
        ("condition", f"{data['condition']:.1e} of the scaled Hessian"),
        ("float", single),
        ("margins", _said(data)),
        ("identity", f"{data['version']}, scene {data['scene_hash']}"),
        ("folder", data["folder"]),
        ("to run it", _run(Path(data["folder"]))),
    ])  # fmt: skip
