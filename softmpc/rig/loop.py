"""The closed loop of a rig: machine and pilot in turn, and all that was seen on the way."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from softmpc.control.closed_loop import Start
from softmpc.control.daqp import Daqp
from softmpc.errors import InputError
from softmpc.estimation.sensors import TICK
from softmpc.interrupts import InterruptLater
from softmpc.rig.faults import BudgetOverrun, Fault, Jitter, SolverCap
from softmpc.rig.machine import Machine
from softmpc.rig.pilot import Act, Pilot
from softmpc.simulation.integrator import IntegrationError

__all__ = ["Flight", "check_cap", "fly"]

Array = np.ndarray
Progress = Callable[[int, int], None]
NO_TIME = 1e-9  # s, a budget that nothing keeps


@dataclass
class Flight:
    """A run as it went: N acts, K ticks."""

    acts: list[Act] = field(default_factory=list)
    states: list[Array] = field(default_factory=list)  # of the plant, pieces of K×nx
    inputs: list[Array] = field(default_factory=list)  # that acted, pieces of K×k
    status: str = "finished"


def fly(
    machine: Machine,
    pilot: Pilot,
    start: Start,
    believed: Array,
    duration: float,
    wait: float = 0.0,
    progress: Progress | None = None,
) -> Flight:
    """Run from `start` of the plant, which the pilot takes for the state `believed`.

    Before time 0 the arm rests for `wait` seconds, and the pilot only listens.
    """
    ticks = round(pilot.mpc.ocp.step / TICK)
    begin = -ticks * round(wait / (ticks * TICK))
    machine.reset(start.x, start.u, begin)
    pilot.reset(believed, start.u, begin)
    count = round(duration / (ticks * TICK))
    flight, random = Flight(), np.random.default_rng([machine.seed, 1 << 21])
    usual = _Usual.of(pilot, machine.faults)
    try:
        with InterruptLater() as interrupt:
            for tick in range(begin, 0, ticks):
                pilot.listen(tick, machine.arrived())
                machine.run(ticks)
            flight.states.append(machine.x[None])
            flight.inputs.append(machine.acting[None])
            for k in range(count):
                late = _late(machine.faults, k * ticks, ticks, random)
                _run(machine, k * ticks + late - machine.tick, flight)
                _interfere(pilot, machine.faults, k * ticks, usual)
                act = pilot.step(k * ticks, machine.arrived())
                machine.command(act.u)
                flight.acts.append(act)
                if progress is not None:
                    progress(k + 1, count)
                if interrupt.asked:
                    flight.status = "interrupted"
                    break
            _run(machine, len(flight.acts) * ticks - machine.tick, flight)
    except KeyboardInterrupt:
        flight.status = "interrupted"
    except IntegrationError as error:
        flight.status = f"plant stopped: {error}"
    finally:
        _interfere(pilot, (), 0, usual)
    return _whole(flight, machine, ticks)


def _whole(flight: Flight, machine: Machine, ticks: int) -> Flight:
    """Without an act whose step was not finished; with a state where there is none."""
    if not flight.states:
        flight.states.append(machine.x[None])
        flight.inputs.append(machine.acting[None])
    del flight.acts[(sum(map(len, flight.states)) - 1) // ticks :]
    return flight


def _run(machine: Machine, ticks: int, flight: Flight) -> None:
    if ticks > 0:
        states, inputs = machine.run(ticks)
        flight.states.append(states)
        flight.inputs.append(inputs)


def _late(faults: Sequence[Fault], tick: int, ticks: int, random: np.random.Generator) -> int:
    """By how many ticks the controller wakes late; less than a step."""
    most = max((f.most for f in faults if isinstance(f, Jitter) and f.active(tick)), default=0.0)
    return min(int(random.integers(0, round(most / TICK) + 1)), ticks - 1) if most else 0


def _interfere(pilot: Pilot, faults: Sequence[Fault], tick: int, usual: _Usual) -> None:
    """Let faults of the controller act, or take them away."""
    now = {type(fault) for fault in faults if fault.active(tick)}
    pilot.mpc.budget = NO_TIME if BudgetOverrun in now else usual.budget
    if usual.qp is not None:
        usual.qp.max_iterations = 1 if SolverCap in now else usual.iterations


def check_cap(quadratic: bool) -> None:
    """Raise `InputError` for a fault `SolverCap` of a solver without quadratic programs."""
    if not quadratic:
        raise InputError(
            f"fault {SolverCap.name!r}: needs a solver of quadratic programs, real-time or sqp"
        )


@dataclass(frozen=True)
class _Usual:
    """What faults of the controller change, as it is without them."""

    budget: float | None
    qp: Daqp | None
    iterations: int

    @classmethod
    def of(cls, pilot: Pilot, faults: Sequence[Fault]) -> _Usual:
        qp = pilot.mpc.qp
        if any(isinstance(fault, SolverCap) for fault in faults):
            check_cap(qp is not None)
        return cls(pilot.mpc.budget, qp, 0 if qp is None else qp.max_iterations)
