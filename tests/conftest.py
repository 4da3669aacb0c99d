"""Tests do not compile unless they say so, and keep what they compile out of the user's cache."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator

import pytest

_made: list[str] = []


def pytest_configure(config: pytest.Config) -> None:
    """Workers of pytest-xdist get the variables from the process that starts them."""
    _hear_interrupts()
    if not hasattr(config, "workerinput"):
        _made.append(tempfile.mkdtemp(prefix="softmpc-tests-"))
        os.environ["SOFTMPC_CACHE"] = _made[0]
        # Models differ from test to test: compiling them would take longer than it saves.
        os.environ["SOFTMPC_COMPILE"] = "never"
        # Workers share the cores: threads of BLAS beside them make small matrices ten times slower.
        for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
            os.environ.setdefault(name, "1")


def _hear_interrupts() -> None:
    """In the background of a script Ctrl-C is ignored, and what tests start inherits that."""
    ignored = signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    if ignored and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_unconfigure() -> None:
    for folder in _made:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(autouse=True)
def log_as_before() -> Iterator[None]:
    """A command sets what the package's log lets through, for the process that it is."""
    package = logging.getLogger("softmpc")
    level, handlers = package.level, package.handlers[:]
    yield
    package.setLevel(level)
    package.handlers[:] = handlers
