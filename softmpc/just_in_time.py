"""Functions that are compiled once they have worked long enough to pay for it.

A short run never waits for a compiler; a long one, or the tenth short one in a process, gets
machine code. What another process has compiled already is used much earlier.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from softmpc.compiled import compiled, default_mode, instructions, kept

if TYPE_CHECKING:
    import casadi as ca

__all__ = ["JustInTime"]

# Seconds an instruction, measured by `python -m tests.benchmarks.compiling`: to look into the cache
# (C code is written and hashed) and to compile.
LOOKING, COMPILING = 5e-6, 1e-4


class JustInTime:
    """A CasADi function to be called; `compiled` tells which form does the work.

    It works in CasADi's virtual machine until the time spent there exceeds what the next step
    would cost: first a look into the cache, then the compiler. So it is never slower than twice
    the better of both. With SOFTMPC_COMPILE=require it is compiled at once, with never not at all.
    """

    def __init__(self, function: ca.Function) -> None:
        self.function, self.worked = function, 0.0
        self._mode = default_mode()
        self._looked = self._done = self._mode == "never"
        size = instructions(function)
        self._to_look, self._to_compile = LOOKING * size, COMPILING * size
        if self._mode == "require":
            self._compile()

    def __call__(self, *arguments: Any) -> Any:
        if self._done:
            return self.function(*arguments)
        began = time.perf_counter()
        result = self.function(*arguments)
        self.worked += time.perf_counter() - began
        if not self._looked and self.worked > self._to_look:
            self._looked, found = True, kept(self.function)
            self._done = found is not None
            self.function = found or self.function
        elif self.worked > self._to_compile:
            self._compile()
        return result

    @property
    def compiled(self) -> bool:
        """Whether machine code does the work."""
        return bool(self.function.class_name() == "External")

    def _compile(self) -> None:
        self.function, self._done = compiled(self.function, self._mode), True
