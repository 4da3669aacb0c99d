"""A plan as an animation: the arm among the obstacles, in slow motion where it is fast."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from softmpc.planning.result import PlanResult
from softmpc.view.animation import Film, Progress, write_film
from softmpc.view.plan_space import goal_marks, replay_of

__all__ = ["animate_plan", "times_slower"]

SHORTEST = 4.0  # s, of a film
PACES = (1, 2, 3, 5, 10, 20, 30, 50)
PAUSE = 1.0  # s, at the end


def animate_plan(
    result: PlanResult, path: Path, slow: float | None = None, progress: Progress | None = None
) -> list[Path]:
    """Write `path` (.gif), and .mp4 beside it if there is ffmpeg; returns what was written.

    The film is `slow` times slower than the motion, by default as much as it needs to last 4 s.
    Raises `InputError` where there is no motion to show.
    """
    replay, problem = replay_of(result), result.problem
    places = [mark.place for mark in goal_marks(result)]
    film = Film(
        result.title or f"Plan of least {problem.least}",
        goals=np.array(places) if places else None,
        obstacles=problem.obstacles,
        slow=slow or times_slower(float(replay.t[-1])),
        pause=PAUSE,
        thick=1.0,  # obstacles are kept clear of all of it
    )
    return write_film(
        problem.model, replay.t, replay.x[:, : problem.model.strains], path, film, progress
    )


def times_slower(time: float) -> float:
    """How many times slower a motion of that time (s) is shown: the least round number."""
    return float(next((pace for pace in PACES if pace * time >= SHORTEST), PACES[-1]))
