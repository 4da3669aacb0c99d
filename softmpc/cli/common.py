"""What all commands share: options, answers, progress, logging.

A command returns an `Answer`; `answering` prints it, for people or as one JSON object, writes it
to the folder of results and turns it into the exit status. Nothing else writes to stdout.
"""

from __future__ import annotations

import logging
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from softmpc.errors import is_interrupt
from softmpc.files import as_json

if TYPE_CHECKING:
    from softmpc.model.scene import Scene

__all__ = [
    "INTERRUPTED", "NOT_CONVERGED", "OK", "WRONG_INPUT", "Answer", "Numbers", "animation_option",
    "answering", "as_json", "is_interrupt", "load", "notice", "progress", "row", "scene_argument",
    "stages", "table", "write_text",
]  # fmt: skip

OK, WRONG_INPUT, NOT_CONVERGED, INTERRUPTED = 0, 2, 3, 130
Progress = Callable[[float, float], None]
Stage = Callable[[str, str], Progress]
log = logging.getLogger(__name__)
_bars: list[Any] = []  # on the screen now


@dataclass(frozen=True)
class Answer:
    """What a command found: `data` for programs, `text` for people, and how it ended."""

    data: dict[str, Any]
    text: str
    status: int = OK
    problem: str = ""  # one line for stderr where the status is not OK


def answering(name: str) -> Callable[[Callable[..., Answer]], Callable[..., int]]:
    """Give a command function --json, --out and --verbose; it gets `out`, a folder or None."""
    folder = click.Path(path_type=Path)
    options = (
        click.option("--json", "as_object", is_flag=True, help="Print one JSON object."),
        click.option("--out", type=folder, metavar="DIR", help="Write all results to this folder."),
        click.option("-v", "--verbose", count=True, help="Say what is done; -vv: all of it."),
    )

    def decorate(function: Callable[..., Answer]) -> Callable[..., int]:
        @wraps(function)
        def run(as_object: bool, verbose: int, **given: Any) -> int:
            _log_to_stderr(verbose)
            answer = _answer(name, function, **given)
            click.echo(as_json(answer.data) if as_object else answer.text)
            if answer.problem:
                notice(f"error: {answer.problem}")
            return answer.status

        for option in reversed(options):
            option(run)
        return run

    return decorate


def _answer(name: str, function: Callable[..., Answer], out: Path | None, **given: Any) -> Answer:
    """Call a command function; with `out`, what it finds is written there as well."""
    started = time.perf_counter()
    fresh = out is not None and not out.exists()
    if out:
        _make_folder(out)
    try:
        with redirect_stdout(sys.stderr):  # libraries that print do not spoil the answer
            answer = function(out=out, **given)
    except BaseException:
        if out and fresh:
            with suppress(OSError):  # it stays where something was written
                out.rmdir()
        raise
    if out:
        write_text(out / f"{name}.json", as_json(answer.data, indent=2))
    log.info("took %.2f s", time.perf_counter() - started)
    return answer


scene_argument = click.argument("scene", type=click.Path(path_type=Path), metavar="SCENE")
animation_option = click.option(
    "--animate/--no-animate", default=True, show_default=True,
    help="Whether --out gets a GIF of the motion, and an MP4 where ffmpeg is installed.",
)  # fmt: skip


class Numbers(click.ParamType):
    """Finite numbers separated by commas."""

    name = "numbers"

    def convert(self, value: Any, param: Any, ctx: Any) -> list[float]:
        """The numbers of a text such as 0.6,0,0."""
        numbers = []
        for position, item in enumerate(value.split(","), 1):
            try:
                numbers.append(float(item))
            except ValueError:
                self.fail(f"{item.strip()!r} (value {position}) is not a number", param, ctx)
            if not math.isfinite(numbers[-1]):
                self.fail(f"{item.strip()} (value {position}) is not a finite number", param, ctx)
        return numbers


def load(path: Path) -> tuple[str, Scene]:
    """Title and scene of a scene file; the title is the file's name where it has none."""
    from softmpc.errors import errors_in
    from softmpc.model.scene_file import read_document, scene_from_dict

    log.info("reading %s", path)
    document = read_document(path)
    with errors_in(path):
        return document.get("title") or path.stem, scene_from_dict(document)


def notice(line: str) -> None:
    """One line on stderr; a progress bar there makes room for it."""
    for bar in _bars:
        bar.clear()
    click.echo(line, err=True)
    for bar in _bars:
        if sys.stderr.isatty():
            bar.refresh()


@contextmanager
def progress(what: str, unit: str = "step") -> Iterator[Progress]:
    """A progress bar on stderr; call what is yielded with how much is done, and of how much.

    It is gone after an error, so that the error's line stands alone.
    """
    with stages(what, unit) as stage:
        yield stage(what, unit)


@contextmanager
def stages(first: str, unit: str) -> Iterator[Stage]:
    """The same for what is done one after the other: call what is yielded for each stage."""
    from tqdm import tqdm

    person = sys.stderr.isatty()  # a log gets a line now and then, and none for what is quick
    pace: dict[str, Any] = {"mininterval": 0.1 if person else 5.0, "delay": 0.0 if person else 1.0}
    with tqdm(desc=first, unit=unit, file=sys.stderr, **pace) as bar:

        def stage(what: str, unit: str) -> Progress:
            def report(done: float, total: float) -> None:
                if bar.desc not in (what, f"{what}: "):
                    bar.unit = unit
                    bar.set_description(what, refresh=False)
                    bar.reset(total)
                    bar.delay = 0.0  # that has shown it, so its line is to be ended
                bar.total = total
                bar.update(done - bar.n)

            return report

        _bars.append(bar)
        try:
            yield stage
        except BaseException:
            bar.leave = False
            raise
        finally:
            _bars.remove(bar)


def table(rows: Sequence[tuple[str, object]]) -> str:
    """Names and values in two columns."""
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}".rstrip() for name, value in rows)


def row(values: Sequence[float], digits: int = 5) -> str:
    """Numbers side by side; what rounds to zero has no sign."""
    return "  ".join(f"{round(value, digits) + 0.0:{digits + 4}.{digits}f}" for value in values)


def write_text(path: Path, text: str) -> None:
    """Write a text file; a crash leaves the last good one."""
    from softmpc.files import replacing

    with replacing(path) as beside:
        beside.write_text(text + "\n", encoding="utf-8")
    log.info("wrote %s", path)


def _make_folder(path: Path) -> None:
    if path.exists() and not path.is_dir():
        raise click.BadParameter(f"{path} is a file; give a folder", param_hint="--out")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise click.BadParameter(
            f"cannot make the folder {path}: {error.strerror}", param_hint="--out"
        ) from None
    if not os.access(path, os.W_OK):
        raise click.BadParameter(f"cannot write to the folder {path}", param_hint="--out")


class _Stderr(logging.Handler):
    """Log lines go to stderr as it is at that moment."""

    def emit(self, record: logging.LogRecord) -> None:
        notice(self.format(record))


def _log_to_stderr(verbose: int) -> None:
    handler = _Stderr()
    handler.setFormatter(logging.Formatter("%(levelname)s %(name)s: %(message)s"))
    package = logging.getLogger("softmpc")
    package.handlers = [handler]
    package.setLevel((logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)])
