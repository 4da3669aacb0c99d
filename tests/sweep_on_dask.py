"""Sweeps on a cluster of Dask on this machine: `python tests/sweep_on_dask.py LOG LOG`.

Prints what tests/test_sweeps.py asks for as JSON. A process of its own, for Dask has threads and
warnings that are not ours.
"""

from __future__ import annotations

import json
import logging
import sys
import warnings

from sweep_work import Logged, Tips

from softmpc import Scene, chen2022
from softmpc.cli.sweep_options import executor_for
from softmpc.errors import SweepError
from softmpc.sweeps import sweep


def of_a_script(case: int) -> int:
    """Dask can send what no worker can import."""
    return case + 1


def main(once: str, always: str, pressures: list[list[float]]) -> None:
    """Print the results."""
    from distributed import LocalCluster

    cluster = LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
    )
    with cluster, executor_for(None, cluster.scheduler_address) as executor:
        tips = sweep(Tips(Scene(chen2022())), pressures, executor=executor, chunk=4)
        script = sweep(of_a_script, range(5), executor=executor)
        killed = sweep(Logged(once, die_at=5), range(12), executor=executor, chunk=2)
        try:
            sweep(Logged(always, die_at=5, always=True), range(8), executor=executor, chunk=2)
            error = ""
        except SweepError as found:
            error = str(found)
        print(json.dumps({"tips": tips, "script": script, "killed": killed, "error": error}))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    try:
        main(*sys.argv[1:], json.load(sys.stdin))
    except RuntimeError as failed:  # Dask's, while it ends beside a worker that was just killed
        if str(failed) != "ConnectionPool is closed":
            raise
