"""Worker processes on this machine: made anew when one is killed, gone when this process is."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from concurrent.futures.process import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from softmpc.errors import SweepError, WorkerKilledError
from softmpc.interrupts import InterruptLater
from softmpc.sweep_chunks import Chunk, Outcome, packed, run_packed

__all__ = ["ATTEMPTS", "Processes", "Rest", "finished_in", "finished_in_processes", "in_worker"]

ATTEMPTS = 3  # how often a chunk is sent before it is blamed for the deaths of its workers
MOST = 61  # processes that Windows can wait for
NOBODY = -1
NO_GUARD = (
    'a script that sweeps needs `if __name__ == "__main__":` around what it does, for each worker '
    "imports it; in a session use executor=1"
)
# Workers share the cores; a pool of threads in each would make them slower, not faster.
ONE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)

Call = Callable[[bytes], Outcome]
Dumps = Callable[[Any], bytes]


class Processes(ProcessPoolExecutor):
    """A pool of spawned processes; `begun` is what the latest of them is at.

    Spawned, not forked: a fork in a process with threads (BLAS, a debugger, Dask) may hang.
    """

    def __init__(self, workers: int) -> None:
        if getattr(multiprocessing.current_process(), "_inheriting", False):
            raise SweepError(NO_GUARD)  # this is a worker that imports the script
        context = multiprocessing.get_context("spawn")
        self.begun = context.RawValue("q", NOBODY)  # no lock that a killed worker could hold
        super().__init__(min(workers, MOST), context, _begin, (self.begun,))

    def submit(self, *args: Any, **kwargs: Any) -> Future:
        """As of any pool; this is where processes are started."""
        with InterruptLater() as interrupt, _quiet_start():  # none that is started by half
            future = super().submit(*args, **kwargs)
        if interrupt.asked:
            raise KeyboardInterrupt
        return future

    def kill(self) -> None:
        """End the workers at once, whatever they do; a solver would keep `shutdown` waiting."""
        for process in list((self._processes or {}).values()):  # from 3.14 on: kill_workers()
            process.kill()
        self.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _quiet_start() -> Iterator[None]:
    """What a process inherits that is started here: one BLAS thread, and no Ctrl-C.

    A terminal sends Ctrl-C to all, and only this process has to act on it.
    """
    block = getattr(signal, "pthread_sigmask", None)  # not on Windows
    before = block(signal.SIG_BLOCK, {signal.SIGINT}) if block else None
    added = [name for name in ONE_THREAD if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
        if block:
            block(signal.SIG_SETMASK, before)


_begun: Any = None  # in a worker, the value that it shares with the process that started it


def _begin(begun: Any) -> None:
    """The first thing a worker does."""
    global _begun
    _begun = begun
    _tell(0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.stdout = sys.stderr  # stdout is for the answer of the command
    threading.Thread(target=_end_with_parent, daemon=True).start()


def in_worker() -> bool:
    """Whether this is a worker process of a sweep."""
    return _begun is not None


def _tell(position: int) -> None:
    _begun.value = position


def _end_with_parent() -> None:
    """Workers of a process that was killed would wait for ever."""
    parent = multiprocessing.parent_process()
    if parent:
        parent.join()
        os._exit(1)


def _run_here(work: bytes, cases: bytes) -> Outcome:
    return run_packed(work, cases, _tell)


# ---------------------------------------------------------------- chunks on executors


@dataclass(frozen=True)
class Rest:
    """What a broken pool leaves: chunks that were begun, or about to be, and all others."""

    begun: list[Chunk]
    waiting: list[Chunk]


def finished_in(
    pool: Executor, call: Call, chunks: Sequence[Chunk], dumps: Dumps, most: int
) -> Generator[tuple[Chunk, Outcome], None, Rest]:
    """Each chunk as it finishes, `most` sent at a time; returns what a broken pool leaves.

    Raises `SweepError` for any other trouble that the executor reports.
    """
    waiting = deque(chunks)
    running: dict[Future[Outcome], Chunk] = {}
    try:
        while waiting or running:
            while waiting and len(running) < most:
                cases = packed(waiting[0].cases, str(waiting[0]), dumps)
                running[pool.submit(call, cases)] = waiting.popleft()
            done, _ = wait(running, timeout=1.0, return_when=FIRST_COMPLETED)
            for future in sorted(done, key=_has_failed):  # first what is good
                yield running[future], _outcome(future, running[future])
                del running[future]
    except BrokenExecutor:
        pass
    finally:
        for future in running:
            future.cancel()
    return Rest([*running.values()], [*waiting])


def _has_failed(future: Future[Outcome]) -> bool:
    return future.cancelled() or future.exception() is not None


def _outcome(future: Future[Outcome], chunk: Chunk) -> Outcome:
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except Exception as error:  # Dask's KilledWorker, a scheduler that is gone
        name = type(error).__name__
        # Dask counts a death against every task its worker had, those that only waited as well.
        others = " (or cases that waited at the same worker)" if name == "KilledWorker" else ""
        raise SweepError(f"{chunk}{others}: {name}: {error}") from error


def finished_in_processes(
    work: bytes, chunks: Sequence[Chunk], workers: int
) -> Iterator[tuple[Chunk, Outcome]]:
    """Each chunk as it finishes, in processes of this machine.

    When a worker dies the pool is lost, and nobody knows which chunk it was at: all that were
    begun are sent again. A chunk that was there twice is then sent alone, so that a third death
    is its own. Raises `SweepError` for that.
    """
    call = partial(_run_here, work)
    deaths: Counter[int] = Counter()
    left = list(chunks)
    while left:
        suspect = next((chunk for chunk in left if deaths[chunk.number] == ATTEMPTS - 1), None)
        some = [suspect] if suspect else left
        others = [chunk for chunk in left if chunk is not suspect] if suspect else []
        pool = Processes(min(workers, len(some)))
        try:
            rest = yield from finished_in(pool, call, some, pickle.dumps, workers + 1)
            if not rest.begun:
                pool.shutdown()
        finally:
            pool.kill()
        if rest.begun:
            _check_death(pool, suspect)
        deaths.update(chunk.number for chunk in rest.begun)
        left = rest.begun + rest.waiting + others


def _check_death(pool: Processes, suspect: Chunk | None) -> None:
    """Raise `SweepError` where trying again makes no sense."""
    if pool.begun.value == NOBODY:
        raise SweepError(f"the worker processes end before they begin: {NO_GUARD}")
    if suspect:
        raise WorkerKilledError(
            f"{suspect.case(pool.begun.value)}: its worker was killed {ATTEMPTS} times, the last "
            "time with nothing else running; is there too little memory, or does a library crash?",
            suspect.first + pool.begun.value,
        )
