"""Linear algebra with one thread while a controller works.

The matrices of a step are small: BLAS threads cost more than they bring, and several times the step
where other programs want the cores. Most libraries have one pool for the whole process. All that
work at one time share its limit: the first sets it, the last takes it back. OpenMP counts for each
thread apart, so there each sets its own.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import ContextDecorator
from typing import Any

import threadpoolctl

__all__ = ["OneThread", "one_thread"]

Counts = list[tuple[Any, int]]  # libraries and their numbers of threads


class _CasadiBlas(threadpoolctl.OpenBLASController):
    """The library that CasADi's wheels bring for IPOPT; threadpoolctl does not know its name."""

    filename_prefixes = ("libcasadi-tp-openblas",)


threadpoolctl.register(_CasadiBlas)


class OneThread(ContextDecorator):
    """Around work, or above a function that does it; any number at one time, in any threads."""

    def __init__(self) -> None:
        self._lock, self._working, self._before = threading.Lock(), 0, Counts()
        self._here = threading.local()  # the counts of each thread, one list for each entry
        self._known = False
        self._shared: list[Any] = []
        self._own: list[Any] = []

    def look(self) -> None:
        """Find the libraries that are loaded by now; takes some milliseconds."""
        found = threadpoolctl.ThreadpoolController().lib_controllers
        layers = [getattr(one, "threading_layer", one.user_api) for one in found]
        own = [layer == "openmp" for layer in layers]
        with self._lock:
            self._shared = [one for one, apart in zip(found, own, strict=True) if not apart]
            self._own = [one for one, apart in zip(found, own, strict=True) if apart]
            self._known = True

    def __enter__(self) -> OneThread:
        if not self._known:
            self.look()
        with self._lock:
            if not self._working:
                self._before = _limited(self._shared)
            self._working += 1
        entries = self._here.__dict__.setdefault("entries", [])
        entries.append(_limited(self._own))
        return self

    def __exit__(self, *_: object) -> None:
        _set(self._here.entries.pop())
        with self._lock:
            self._working -= 1
            if not self._working:
                _set(self._before)


def _limited(libraries: Sequence[Any]) -> Counts:
    """Limit those to one thread that have more; their counts before."""
    before = [(one, one.num_threads) for one in libraries]
    before = [(one, count) for one, count in before if count > 1]
    _set([(one, 1) for one, _ in before])
    return before


def _set(counts: Counts) -> None:
    for library, count in counts:
        release = getattr(library, "clear_controlling_thread", None)
        if release is not None:  # of OpenBLAS: else it obeys the thread alone that came first
            release(force=True)
        library.set_num_threads(count)
        if release is not None:
            release()


one_thread = OneThread()
