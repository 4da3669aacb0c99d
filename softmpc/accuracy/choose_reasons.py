"""Why nothing can be chosen, in the order in which people can do something about it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from softmpc.accuracy.bound import CALIBRATED
from softmpc.accuracy.choose_rate import rate_text
from softmpc.accuracy.choose_result import Evidence, Goal
from softmpc.study.lengths import length_text

__all__ = ["reasons"]

ADVICE = {
    "rest": "give a larger tolerance",
    "motion": "give a larger tolerance, or inputs that move the arm less",
    "loop": "give a larger tolerance or a slower path (lap_time in [track]), or let the controller "
    "know more: a shorter step, a longer horizon or a smaller tip_deviation in [track.controller]",
}
SLOWER = "give a lower rate or a larger tolerance, or a faster machine"


def reasons(goal: Goal, evidence: Sequence[Evidence]) -> tuple[str, ...]:
    """Lines for people; what to try comes last."""
    bounded = [one for one in evidence if one.bound_m is not None]
    if not bounded:
        failed = {one.point.error.get("status", "not measured") for one in evidence}
        return ("no candidate could be run: " + "; ".join(sorted(failed)),)
    if not any(one.within for one in bounded):
        return (*_inexact(goal, bounded), ADVICE[goal.family])
    return (*_slow(goal, [one for one in bounded if one.within]), SLOWER)


def _inexact(goal: Goal, bounded: Sequence[Evidence]) -> Iterator[str]:
    best = min(bounded, key=lambda one: one.bound_m or 0.0)
    assert best.bound_m is not None and best.point.error_m is not None
    yield (
        f"the most accurate candidate ({best.point.name}) has an error below "
        f"{length_text(best.bound_m)}, not {length_text(goal.tolerance_m)}; "
        f"{length_text(best.point.error_m)} was measured"
    )
    doubt = CALIBRATED[goal.family].factor * (best.point.doubt_m or 0.0)
    if doubt > best.point.error_m or doubt > goal.tolerance_m:
        yield (
            f"the reference itself is in doubt by {length_text(best.point.doubt_m or 0.0)}, which "
            f"is {length_text(doubt)} of the bound"
        )


def _slow(goal: Goal, within: Sequence[Evidence]) -> Iterator[str]:
    timed = [one for one in within if one.step_s is not None]
    if timed and goal.deadline_s is not None and goal.rate_hz is not None:
        best = min(timed, key=lambda one: one.step_s or 0.0)
        yield (
            f"the fastest candidate within the tolerance ({best.point.name}) takes "
            f"{1e3 * (best.step_s or 0.0):.3g} ms, and {rate_text(goal.rate_hz)} leaves "
            f"{1e3 * goal.deadline_s:.3g} ms"
        )
        return
    states = {one.point.cost["status"] for one in within if "status" in one.point.cost}
    yield "no candidate within the tolerance could be timed: " + "; ".join(sorted(states))
