"""A chunk of a sweep: how it travels, and what a worker does with it."""

from __future__ import annotations

import json
import pickle
import threading
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, is_dataclass, replace
from typing import Any

from softmpc.errors import InputError, SweepError, is_interrupt
from softmpc.interrupts import InterruptLater

__all__ = ["Chunk", "Failure", "Outcome", "cut", "packed", "run", "run_packed", "short"]

SHOWN = 120  # characters of a case in a message


@dataclass(frozen=True, eq=False)
class Chunk:
    """Cases that one worker does one after the other; `first` is the number of the first one."""

    number: int
    first: int
    cases: Sequence[Any]

    def __str__(self) -> str:
        last = self.first + len(self.cases) - 1
        many = f"cases {self.first} to {last}, the first of them"
        return f"{many if len(self.cases) > 1 else f'case {last}'} {short(self.cases[0])}"

    def case(self, position: int) -> str:
        """One case as a message names it."""
        return f"case {self.first + position} ({short(self.cases[position])})"


@dataclass(frozen=True)
class Failure:
    """An error in a worker, as text: not every exception survives the way back.

    `position` is that of its case in the chunk, None where no case was begun.
    """

    position: int | None
    text: str
    wrong_input: bool
    trace: str

    def error(self, chunk: Chunk) -> InputError | SweepError:
        """The error to raise; it names the case."""
        kind = InputError if self.wrong_input else SweepError
        where = chunk if self.position is None else chunk.case(self.position)
        error = kind(f"{where}: {self.text}")
        error.add_note(f"In the worker:\n{self.trace}")
        return error


Outcome = list[str] | Failure  # the result of each case as JSON, or why there is none


def cut(cases: Sequence[Any], size: int) -> list[Chunk]:
    """The cases in chunks of `size`, the last one may be smaller."""
    starts = range(0, len(cases), size)
    return [Chunk(number, i, cases[i : i + size]) for number, i in enumerate(starts)]


def short(value: Any) -> str:
    """A value in a message."""
    text = " ".join(repr(value).split())
    return text if len(text) <= SHOWN else f"{text[:SHOWN]} …"


def run(work: Any, cases: Sequence[Any], begun: Callable[[int], None] | None = None) -> Outcome:
    """Do the cases; `begun` is told the position of each before it is.

    An error is an outcome, except Ctrl-C, which CasADi turns into other errors, or into nothing.
    """
    position = 0
    try:
        with InterruptLater(shared=True) as interrupt:
            one = work.begin() if hasattr(work, "begin") else work
            texts = []
            for position, case in enumerate(cases):
                if begun:
                    begun(position)
                texts.append(json.dumps(one(case), default=_plain))
                if interrupt.asked:
                    raise KeyboardInterrupt
        return texts
    except Exception as error:
        if is_interrupt(error):
            raise KeyboardInterrupt from None
        return _failure(error, position)


def _failure(error: Exception, position: int) -> Failure:
    wrong_input = isinstance(error, InputError)
    text = str(error) if wrong_input else f"{type(error).__name__}: {error}"
    return Failure(position, text, wrong_input, traceback.format_exc())


def _plain(value: Any) -> Any:
    if hasattr(value, "tolist"):  # NumPy arrays and scalars
        return value.tolist()
    raise TypeError(
        f"the result of a case has a {type(value).__name__}: allowed are numbers, text, None, "
        "lists, dicts and NumPy arrays of these"
    )


# ---------------------------------------------------------------- on the way


def packed(value: Any, what: str, dumps: Callable[[Any], bytes] = pickle.dumps) -> bytes:
    """`value` as bytes. Raises `InputError` where it cannot be pickled.

    Of a dataclass only the fields travel: what it has computed meanwhile, a model for instance,
    is large, and may refer to files of this machine.
    """
    try:
        bare = replace(value) if is_dataclass(value) and not isinstance(value, type) else value
        return dumps(bare)
    except Exception as error:  # pickle raises what it likes
        raise InputError(
            f"{what} cannot be sent to a worker: {error}; allowed are functions and dataclasses "
            "at the top level of a module (no lambda, nothing of an interactive session), or "
            "sweep in this process with executor=1"
        ) from None


_mine = threading.local()


def _unpacked(work: bytes) -> Any:
    """One object in each thread, so that what it computes for itself serves all its chunks.

    Threads do not share it: from Python 3.12 on cached properties have no lock, and two threads
    would make one model at the same time.
    """
    if getattr(_mine, "packed", None) != work:
        _mine.packed, _mine.work = work, pickle.loads(work)
    return _mine.work


def run_packed(work: bytes, cases: bytes, begun: Callable[[int], None] | None = None) -> Outcome:
    """`run` in a worker."""
    try:
        loaded, given = _unpacked(work), pickle.loads(cases)
    except Exception as error:
        text = (
            f"a worker cannot load this or the work ({type(error).__name__}: {error}); it must be "
            "able to import their modules, which what is typed into a session does not have"
        )
        return Failure(None, text, wrong_input=True, trace=traceback.format_exc())
    return run(loaded, given, begun)
