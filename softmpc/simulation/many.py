"""CasADi functions at many arguments at once, as NumPy arrays with the cases in front."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["matrices", "solve", "values"]

Array = np.ndarray


def values(function: Any, *arguments: Array, output: int = 0) -> Array:
    """One output that is a vector (N×size), at N arguments (N×size each)."""
    return matrices(function, *arguments, output=output)[..., 0]


def matrices(function: Any, *arguments: Array, output: int = 0) -> Array:
    """One output (N×rows×columns), at N arguments (N×size each)."""
    count = len(arguments[0])
    found = function.map(count).call([argument.T for argument in arguments])[output]
    rows, columns = function.size_out(output)
    return np.moveaxis(np.asarray(found).reshape(rows, count, columns), 1, 0)


def solve(matrix: Array, vector: Array) -> Array:
    """Solutions (N×n) of N systems (N×n×n) for vectors (N×n)."""
    return np.asarray(np.linalg.solve(matrix, vector[..., None])[..., 0])
