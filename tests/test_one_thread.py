"""Linear algebra has one thread while a controller works, and as many as before afterwards."""

import threading

import numpy as np
import pytest
import scipy.linalg.lapack  # noqa: F401 (its BLAS is another library than NumPy's)
from threadpoolctl import threadpool_info, threadpool_limits

from softmpc.control.ipopt import Ipopt
from softmpc.control.mpc import Mpc
from softmpc.control.ocp import tracking_problem
from softmpc.control.one_thread import OneThread, one_thread
from softmpc.control.real_time import RealTime
from softmpc.control.transcription import Transcription
from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.equilibrium import find_equilibrium, pressures_from_torques

MANY = 2
TORQUE = np.full(6, 0.8)


def counts() -> set[int]:
    """Threads of the BLAS libraries of this process."""
    return {library["num_threads"] for library in threadpool_info()}


@pytest.fixture(autouse=True)
def _many():
    with threadpool_limits(MANY):
        assert counts() == {MANY}  # or there is nothing to see here
        yield


def test_one_inside_as_many_as_before_outside() -> None:
    with one_thread:
        assert counts() == {1}
        with one_thread:
            assert counts() == {1}
        assert counts() == {1}
    assert counts() == {MANY}
    with pytest.raises(ValueError), one_thread:
        raise ValueError
    assert counts() == {MANY}


def test_work_that_overlaps_in_two_threads() -> None:
    """The one that began first ends first: the other still has one thread, then all is back."""
    first_is_in, second_is_in, seen = threading.Event(), threading.Event(), []
    pin = OneThread()

    def first() -> None:
        with pin:
            first_is_in.set()
            assert second_is_in.wait(10)

    def second() -> None:
        assert first_is_in.wait(10)
        with pin:
            second_is_in.set()
            threads[0].join(10)
            seen.append(counts())

    threads = [threading.Thread(target=work) for work in (first, second)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    assert seen == [{1}] and counts() == {MANY}


@pytest.fixture(scope="module")
def problem() -> tuple[Transcription, np.ndarray, np.ndarray]:
    """A small problem, a state and references."""
    model = build(Scene(chen2022()))
    posture = find_equilibrium(model, pressures_from_torques(model, TORQUE))
    x = np.concatenate([posture.q, np.zeros(8), model.drive.at_rest(TORQUE)])
    return Transcription(tracking_problem(model, 2, 0.025)), x, np.tile(posture.tips[-1], (2, 1))


def test_controllers_work_with_one_thread(problem) -> None:
    """Whether all at once or in two halves, and solvers without a controller."""
    transcription, x, tips = problem
    seen = []

    class Seen(RealTime):
        def _feedback(self, x, time_limit):
            seen.append(counts())
            return super()._feedback(x, time_limit)

    solver = Seen(transcription, mode="never")
    mpc = Mpc(transcription, solver)
    mpc.step(x, TORQUE, tips)
    mpc.prepare(tips)
    mpc.feedback(x)
    solver.solve(transcription.parameters(x, TORQUE, tips), transcription.resting(x, TORQUE))
    assert seen == [{1}] * 3 and counts() == {MANY}


def test_the_library_of_ipopt_too(problem) -> None:
    """CasADi brings its own; it is loaded with the solver, after all others."""
    transcription, x, tips = problem
    seen = []

    class Seen(Ipopt):
        def solve(self, *given, **named):
            seen.append(counts())
            return super().solve(*given, **named)

    mpc = Mpc(transcription, Seen(transcription))
    assert mpc.step(x, TORQUE, tips).solved and seen == [{1}]
