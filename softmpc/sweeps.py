"""Many independent cases on any `concurrent.futures` executor: processes here, or Dask elsewhere.

Results depend on neither the executor nor the number of workers: cases are cut into chunks by
their number alone, and results travel as JSON, whose numbers come back to the last digit.
"""

from __future__ import annotations

import json
import os
import pickle
from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING, Any

from softmpc.errors import InputError, SweepError
from softmpc.sweep_chunks import Chunk, Failure, Outcome, cut, packed, run, run_packed
from softmpc.sweep_file import SweepFile, what_is_asked

if TYPE_CHECKING:
    from concurrent.futures import Executor

__all__ = ["sweep", "usable_cores"]

Progress = Callable[[float, float], None]
LARGEST, FEWEST = 32, 64  # cases of a chunk at most, chunks of a sweep that has enough cases


def sweep(
    work: Callable[[Any], Any] | Any,
    cases: Iterable[Any],
    *,
    executor: Executor | int | None = None,
    chunk: int | None = None,
    keep: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
    arrived: Callable[[int, Any], None] | None = None,
) -> list[Any]:
    """Results of `work(case)` for each case, in the order of the cases.

    `work` is a function at the top level of a module, or a dataclass with `__call__`, which may
    keep what it builds in a `functools.cached_property`: once a process. Where it has a method
    `begin`, that is asked once a chunk for the function to call, which may remember its last
    result as a warm start. A result is a number, text, None, or a list, dict or NumPy array of
    these, and comes back as JSON has it: arrays and tuples as lists, keys as text.

    `executor`: a number of processes on this machine, 1 to stay in this one, None for one a usable
    core (but none in the worker of another sweep); or any executor, such as
    `dask.distributed.Client(…).get_executor()`. A killed process is replaced, and what it was at is
    done again, up to 3 times.
    `chunk`: how many cases a worker does at once, by default a 64th of them, 1 to 32.
    `keep`: a file for the results of finished chunks; the same sweep, with the same file, goes on
    from there. `progress(cases done, cases)` is called as chunks finish, and before it
    `arrived(i, result)` for each of their cases: all that there is when the sweep is interrupted.

    The first error of `work` ends the sweep: an `InputError` where it is one, else a `SweepError`,
    both with the case in front; so does a case that kills its worker every time. Raises
    `InputError` for a `keep` file of another sweep, and for what cannot be sent to a worker.
    Ctrl-C ends the workers at once and is passed on as `KeyboardInterrupt`.
    """
    _check_executor(executor)
    given = list(cases)
    size = _chunk_size(chunk, len(given))
    chunks = cut(given, size)
    file = SweepFile(keep, what_is_asked(work, given, size), chunks) if keep else None
    results = file.results if file else {}
    left = [one for one in chunks if one.number not in results]
    done = len(given) - sum(len(one.cases) for one in left)
    report, tell = progress or _nobody, partial(_each, arrived or _nobody)
    for one in chunks:
        tell(one.first, results.get(one.number, []))
    report(done, len(given))
    with closing(_finished(work, left, executor)) as finished:
        for one, outcome in finished:
            if isinstance(outcome, Failure):
                raise outcome.error(one)
            if file:
                file.add(one, outcome)
            results[one.number] = [json.loads(text) for text in outcome]
            tell(one.first, results[one.number])
            done += len(one.cases)
            report(done, len(given))
    return [result for one in chunks for result in results[one.number]]


def usable_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _nobody(*_: Any) -> None:
    """Progress that nobody wants to see."""


def _each(arrived: Callable[[int, Any], None], first: int, results: Sequence[Any]) -> None:
    """Tell of the results of a chunk."""
    for i, result in enumerate(results, first):
        arrived(i, result)


def _check_executor(executor: Any) -> None:
    whole = isinstance(executor, int) and not isinstance(executor, bool)
    if (whole and executor >= 1) or executor is None or hasattr(executor, "submit"):
        return
    raise InputError(
        f"executor = {executor!r}: must be a number of processes from 1, None for one a core, or "
        "an executor of concurrent.futures; of Dask that is Client(…).get_executor()"
    )


def _chunk_size(chunk: int | None, cases: int) -> int:
    """Never by the number of workers: warm starts, and so results, depend on the chunks."""
    if chunk is None:
        return min(max(cases // FEWEST, 1), LARGEST)
    if isinstance(chunk, bool) or not isinstance(chunk, int) or chunk < 1:
        raise InputError(f"chunk = {chunk!r}: must be a whole number of cases from 1")
    return chunk


def _finished(
    work: Any, chunks: Sequence[Chunk], executor: Executor | int | None
) -> Generator[tuple[Chunk, Outcome], None, None]:
    """Each chunk with what came of it, as it finishes."""
    if executor == 1 or not chunks:
        for chunk in chunks:
            yield chunk, run(work, chunk.cases)
        return
    from softmpc.sweep_processes import finished_in, finished_in_processes, in_worker

    if executor is None and in_worker():  # its neighbours have the other cores
        yield from _finished(work, chunks, 1)
        return
    if executor is None or isinstance(executor, int):
        here = packed(work, "work", pickle.dumps)
        yield from finished_in_processes(here, chunks, executor or usable_cores())
        return
    dumps = _dumps()
    call = partial(run_packed, packed(work, "work", dumps))
    rest = yield from finished_in(executor, call, chunks, dumps, len(chunks))
    if rest.begun:
        raise SweepError(
            "the executor is broken, one of its workers was killed; it cannot be used again. "
            "With keep=… a new one goes on from what is finished; executor=None replaces workers"
        )


def _dumps() -> Callable[[Any], bytes]:
    """Dask and Loky bring cloudpickle, which also sends what a script defines."""
    try:
        from cloudpickle import dumps
    except ImportError:
        return pickle.dumps
    return dumps
