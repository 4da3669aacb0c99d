"""Benchmarks: all with `python -m tests.benchmarks`, one and its table with `… .NAME`.

Each has `numbers(quick)`, what it measured as plain numbers. Linear algebra has one thread, which
must be said before NumPy is loaded: times of small matrices then do not depend on other work.
"""

import os

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
for name in THREADS:
    os.environ.setdefault(name, "1")
