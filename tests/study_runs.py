"""A study of the other pretended family: `python tests/study_runs.py LOG KEEP [WORKERS]`.

On Dask workers of this machine where no number is given. Prints its points as JSON. A process of
its own, to be killed, and because Dask has threads and warnings that are not ours.
"""

from __future__ import annotations

import json
import logging
import sys
import warnings
from contextlib import ExitStack

import pytest
import study_work

from softmpc.accuracy.configuration import Task
from softmpc.accuracy.study import run_study
from softmpc.cli.sweep_options import executor_for


def main(log: str, keep: str, workers: str = "") -> None:
    """Run it."""
    family, seconds = ("pretended", 0.15) if workers else ("other", 0.0)
    task = Task({"title": "Arm", "log": log, "seconds": seconds})
    study_work.only_fakes(pytest.MonkeyPatch())
    with ExitStack() as stack:
        executor = (
            int(workers) if workers else stack.enter_context(executor_for(None, cluster(stack)))
        )
        found = run_study(task, families=[family], keep=keep, executor=executor)
    print(json.dumps(found.summary()["families"]))


def cluster(stack: ExitStack) -> str:
    """The address of two workers."""
    from distributed import LocalCluster

    made = LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
    )
    return str(stack.enter_context(made).scheduler_address)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main(*sys.argv[1:])
