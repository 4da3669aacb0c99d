"""Tests do not compile unless they say so, and keep what they compile out of the user's cache."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator

import pytest

_made: list[str] = []
LOG_LEVEL = logging.getLogger("softmpc").level
LOG_HANDLERS = logging.getLogger("softmpc").handlers[:]
# What needs signals, shells or GNU's tools (nm, size, flags of GCC) as Linux has them; by file, all
# tests or those named.
ON_LINUX: dict[str, tuple[str, ...]] = {
    "test_codegen_clean": (),
    "test_codegen_embedded": (),
    "test_codegen_functions": (),
    "test_codegen_on_arm": (),
    "test_codegen_estimator": ("test_no_memory_is_allocated_and_no_global_changes",),
    "test_codegen_pilot": (
        "test_no_memory_is_allocated_and_no_global_changes",
        "test_random_readings_under_sanitizers",
    ),
    "test_codegen_plant": ("test_the_loop_is_clean_under_sanitizers",),
    "test_docs": ("test_ci_runs_the_readme",),
    "test_inverse_cli": ("test_ctrl_c_keeps_what_is_done",),
    "test_sweeps": (
        "test_dask",
        "test_a_killed_worker_loses_nothing",
        "test_a_case_that_always_kills_its_worker_is_named",
        "test_a_given_executor_that_breaks",
        "test_ctrl_c_keeps_what_is_done",
        "test_workers_end_with_their_parent",
        "test_ctrl_c_inside_casadi",
        "test_file_goes_on_after_half_a_line",
    ),
}

# What CasADi 3.7 cannot: plan, for its wheel has no PIQP, and count instructions as the pages say.
OF_PLANS = (
    "test_plan", "test_plan_cli", "test_plan_files", "test_plan_limits", "test_plan_sensitivity",
)  # fmt: skip
PRINTED = tuple(f"test_python_blocks[{page}]" for page in ("hydraulics", "model", "planning"))


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


@pytest.hookimpl(tryfirst=True)  # before what is slow is left out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    import casadi as ca

    leave_first_cases(items)
    old = ca.CasadiMeta.version().startswith("3.7.")
    for item in items:
        name, file = item.name.partition("[")[0], item.path.stem
        if sys.platform != "linux" and (file in ON_LINUX and name in (ON_LINUX[file] or [name])):
            item.add_marker(pytest.mark.skip(reason="needs signals or tools as on Linux"))
        if old and (file in OF_PLANS or item.name in PRINTED):
            item.add_marker(pytest.mark.skip(reason="needs CasADi 3.8"))


def leave_first_cases(items: list[pytest.Item]) -> None:
    """Mark all but the first case of tests that are `sampled` as slow."""
    seen: set[tuple[str, str]] = set()
    for item in items:
        if item.get_closest_marker("sampled") and not item.get_closest_marker("slow"):
            one = str(item.path), item.name.partition("[")[0]
            if one in seen:
                item.add_marker(pytest.mark.slow)
            seen.add(one)


def _hear_interrupts() -> None:
    """In the background of a script Ctrl-C is ignored, and what tests start inherits that."""
    ignored = signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    if ignored and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_unconfigure() -> None:
    for folder in _made:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture(autouse=True)
def log_as_at_first() -> Iterator[None]:
    """A command sets what the package's log lets through, for the process that it is.

    Also one that a fixture of a module runs, which is before this one begins.
    """
    _set_log()
    yield
    _set_log()


def _set_log() -> None:
    package = logging.getLogger("softmpc")
    package.setLevel(LOG_LEVEL)
    package.handlers[:] = LOG_HANDLERS
