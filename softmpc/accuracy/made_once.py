"""What cases of a study share, in quick mode made once a process: the scene as given, the plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from softmpc.accuracy.configuration import Task

__all__ = ["made_once"]

Made = TypeVar("Made")
_made: dict[str, tuple[Task, Any]] = {}


def made_once(name: str, task: Task, make: Callable[[], Made]) -> Made:
    """What `make` makes of a task, kept under a name for later cases of a quick study.

    In full mode it is made anew: there each cost has a process of its own, whose memory is told.
    """
    if not task.quick:
        return make()
    if name not in _made or _made[name][0] != task:
        _made[name] = task, make()
    return _made[name][1]
