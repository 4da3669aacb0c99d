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
    into nothing at all. Inside another such context, it is the outer one that notes and acts;
    one that is `shared` lets those inside it know, so that a long one stops early.
    """

    def __init__(self, shared: bool = False) -> None:
        self._shared = shared
        self._asked = False
        self._outer: InterruptLater | None = None
        self._before: Any = None

    @property
    def asked(self) -> bool:
        """Whether Ctrl-C was pressed."""
        return self._asked or (self._outer is not None and self._outer.asked)

    def ask(self) -> None:
        """As if Ctrl-C were pressed: it came inside of a call."""
        self._asked = True

    def __enter__(self) -> InterruptLater:
        now = signal.getsignal(signal.SIGINT)
        outer = getattr(now, "__self__", None)
        main = threading.current_thread() is threading.main_thread()  # others set no handlers
        if isinstance(outer, InterruptLater):
            self._outer = outer if outer._shared else None
        elif main and now is not signal.SIG_IGN:
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True
