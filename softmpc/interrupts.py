"""Ctrl-C while CasADi runs: noted, and acted on between two calls."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Any

__all__ = ["InterruptLater"]


class InterruptLater:
    """Within this context Ctrl-C only sets `asked`; a second one interrupts at once.

    CasADi turns a KeyboardInterrupt that arrives inside one of its calls into other errors, or
    into nothing at all. Inside another such context, it is the outer one that notes and acts.
    """

    def __init__(self) -> None:
        self.asked = False
        self._before: Any = None

    def __enter__(self) -> InterruptLater:
        now = getattr(signal.getsignal(signal.SIGINT), "__self__", None)
        inside = isinstance(now, InterruptLater)
        main = threading.current_thread() is threading.main_thread()  # others set no handlers
        if main and not inside:
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
