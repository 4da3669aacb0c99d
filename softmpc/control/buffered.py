"""CasADi functions that read and write NumPy arrays in place: no conversion in either direction."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from softmpc.errors import BuildError

__all__ = ["Buffered"]


class Buffered:
    """A function with dense inputs and outputs, called with arrays.

    Arrays have one row for each column of CasADi's matrices, so those of a mapped function have one
    row an interval. The results are the same arrays in each call: copy what shall outlive the next.
    Not for two threads at once; each solver has its own.
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self.inputs = [np.zeros(function.size_in(i)[::-1]) for i in range(function.n_in())]
        self.outputs = [np.zeros(function.size_out(i)[::-1]) for i in range(function.n_out())]
        buffer: Any
        buffer, self._run = function.buffer()
        self._buffer = buffer
        for i, place in enumerate(self.inputs):
            _require_dense(function, function.sparsity_in(i), place)
            buffer.set_arg(i, place.data)
        for i, place in enumerate(self.outputs):
            _require_dense(function, function.sparsity_out(i), place)
            buffer.set_res(i, place.data)

    def __call__(self, *arguments: ArrayLike) -> list[np.ndarray]:
        """Arguments of the shapes of `inputs`; the results."""
        for place, value in zip(self.inputs, arguments, strict=True):
            place[...] = value
        self._run()
        if self._buffer.ret():
            for place in self.outputs:
                place[...] = np.nan  # never the numbers of an earlier call
        return self.outputs


def _require_dense(function: ca.Function, sparsity: ca.Sparsity, place: np.ndarray) -> None:
    if sparsity.nnz() != place.size:
        raise BuildError(f"function {function.name()!r} must have dense inputs and outputs")
