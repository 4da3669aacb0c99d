"""The command `softmpc`: finds the command, and turns errors into one line and an exit status.

Commands are imported when called, so `softmpc --help` needs neither CasADi nor NumPy.
"""

from __future__ import annotations

import io
import sys
import traceback
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import click

from softmpc import __version__
from softmpc.cli.common import (
    INTERRUPTED,
    NOT_CONVERGED,
    WRONG_INPUT,
    as_json,
    is_interrupt,
    notice,
)
from softmpc.errors import BuildError, InputError, SoftmpcError, unknown_name

__all__ = ["main"]

# Name of the command, which is its module's name too -> what `softmpc --help` says about it.
COMMANDS = {
    "info": "Show a scene as a model: states, inputs, effects, size.",
    "statics": "Find the posture at rest under pressures or torques.",
    "inverse": "Find pressures and torques that hold the tip at a place.",
    "workspace": "Find where the tip can be at rest, and the limits of each section.",
    "simulate": "Run the motion that a scene describes.",
    "plan": "Plan the motion of least time, effort or jerk through goals.",
    "track": "Move the tip along a path by nonlinear MPC.",
    "codegen": "Write the controller of a scene as a directory of C.",
    "replay": "Run a flight log through the controllers again.",
    "compare": "Compare the section tips of two simulations.",
    "choose": "Choose the cheapest configuration within a tolerance and a rate.",
    "ablate": "Show what each part of a scene changes and costs.",
    "study": "Measure what accuracy costs in time, along every axis.",
    "reproduce": "Put the paper's numbers and figures beside the model's.",
    "calibrate": "Fit parameters of a scene to measurements.",
    "cache": "Show or clear the compiled functions that are kept.",
}
UNEXPECTED = 1


class Commands(click.Group):
    """Commands that are imported when called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        if cmd_name not in COMMANDS:
            raise click.UsageError(unknown_name("command", cmd_name, COMMANDS), ctx)
        return import_module(f"softmpc.cli.{cmd_name}").command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([*COMMANDS.items()])

    def main(self, args: Sequence[str] | None = None, *_: Any, **extra: Any) -> Any:
        """Run the command given by `args` and exit with its status."""
        words = list(sys.argv[1:] if args is None else args) or ["--help"]
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="replace")  # a pipe on Windows knows no Greek
        extra |= {"prog_name": "softmpc", "standalone_mode": False}
        try:
            status = super().main(words, **extra)
        except click.Abort:
            status = _fail("interrupted", INTERRUPTED, words)
        except click.ClickException as error:
            status = _fail(_one_line(error), WRONG_INPUT, words)
        except SoftmpcError as error:
            wrong = isinstance(error, InputError | BuildError)
            status = _fail(str(error), WRONG_INPUT if wrong else NOT_CONVERGED, words)
        except Exception as error:
            status = _fail_unexpectedly(error, words)
        sys.exit(status)


def _one_line(error: click.ClickException) -> str:
    """Click's message and where to find help."""
    message = " ".join(error.format_message().split()).rstrip(".")
    context = getattr(error, "ctx", None)
    return message + (f"; see {context.command_path} --help" if context else "")


def _fail_unexpectedly(error: BaseException, words: Sequence[str]) -> int:
    """A traceback, unless it is Ctrl-C."""
    if is_interrupt(error):
        return _fail("interrupted", INTERRUPTED, words)
    traceback.print_exception(error)
    return _fail(f"unexpected {type(error).__name__}: {error}", UNEXPECTED, words)


def _fail(message: str, status: int, words: Sequence[str]) -> int:
    """Say what is wrong in one line, and as a JSON object if that was asked for."""
    notice(f"error: {message}")
    if "--json" in words:
        click.echo(as_json({"error": message}))
    return status


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, message="softmpc %(version)s")
def main() -> None:
    """Optimal control and MPC of fluid-driven soft manipulators.

    SCENE is a TOML file that says what the arm is and what it does. Every command takes --json,
    --out DIR and -v. Exit status: 0 good, 2 wrong input, 3 a solver did not converge, the motion
    stopped or nothing can be chosen, 4 a replay differs, 130 interrupted.
    """
