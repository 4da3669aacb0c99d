"""Studies in a process of their own, to be killed, and because Dask has threads and warnings.

`python tests/study_runs.py run LOG KEEP N`: of the pretended family in N processes;
`… dask LOG KEEP`: of the other one on Dask workers of this machine; both print points as JSON.
`… command LOG WORDS…`: the command `softmpc` with these words.
"""

from __future__ import annotations

import json
import logging
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import study_work

from softmpc.accuracy import study
from softmpc.accuracy.configuration import Task
from softmpc.cli.main import main
from softmpc.cli.sweep_options import executor_for

SECONDS = 0.15  # of a measurement that is to be killed


def run(log: str, keep: str, workers: str) -> None:
    task = Task({"title": "Arm", "log": log, "seconds": SECONDS})
    show(task, families=["pretended"], keep=keep, executor=int(workers))


def dask(log: str, keep: str) -> None:
    from distributed import LocalCluster

    warnings.simplefilter("ignore")
    cluster = LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
    )
    with cluster, executor_for(None, cluster.scheduler_address) as executor:
        show(Task({"title": "Arm", "log": log}), families=["other"], keep=keep, executor=executor)


def command(log: str, *words: str) -> None:
    read = study.read_task

    def slow(*given: Any) -> Task:
        task = read(*given)
        return replace(task, document={**task.document, "log": log, "seconds": SECONDS})

    study.read_task = slow
    main([*words])


def show(task: Task, **options: Any) -> None:
    print(json.dumps(study.run_study(task, **options).summary()["families"]))


if __name__ == "__main__":
    study_work.only_fakes(pytest.MonkeyPatch())
    modes: dict[str, Callable[..., None]] = {"run": run, "dask": dask, "command": command}
    modes[sys.argv[1]](*sys.argv[2:])
