"""The motions of the paper's Figs 6 to 8 and 12 to 14: motor torques over time."""

from __future__ import annotations

from dataclasses import dataclass

from softmpc.simulation.inputs import InputProfile, Ramp, Step

__all__ = ["MOTIONS", "UNITS", "PaperMotion"]

UNITS = 6  # of the paper's arm
SAMPLE_TIME = 0.01  # s: section 4.1 records 100 times a second


@dataclass(frozen=True)
class PaperMotion:
    """Torques in N·m on the units 1 to 6, from hanging at rest; times in s."""

    title: str
    duration: float
    moves: tuple[Step | Ramp, ...]

    @property
    def profile(self) -> InputProfile:
        return InputProfile.of(UNITS, self.moves)


# Steps start at once in Figs 6 and 7, where the paper gives no time; ramps are held at their end.
MOTIONS = {
    "fig6": PaperMotion("step on 1, 5, 6", 3.0, tuple(Step(unit, 0.0, 1.5) for unit in (1, 5, 6))),
    "fig7": PaperMotion("step on 1 and 4", 3.0, (Step(1, 0.0, 1.5), Step(4, 0.0, 1.5))),
    "fig8": PaperMotion(
        "ramps on 5 and 6, then 1",
        10.0,
        (Ramp(5, 2.0, 3.0, 1.5), Ramp(6, 2.0, 3.0, 1.5), Ramp(1, 6.0, 7.0, 1.5)),
    ),
    "fig13": PaperMotion("steps on 4, then 1", 10.0, (Step(4, 2.0, 1.5), Step(1, 6.0, 1.5))),
    "fig14": PaperMotion(
        "ramps on 4, then 1", 10.0, (Ramp(4, 2.0, 4.0, 0.75), Ramp(1, 6.0, 8.0, 0.75))
    ),
}
