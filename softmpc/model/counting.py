"""How much work a call of a CasADi function is."""

from __future__ import annotations

import casadi as ca

__all__ = ["executed"]


def executed(function: ca.Function) -> int:
    """Instructions executed in one call.

    For an SX function that is its number of instructions. In an MX function a call counts as what
    it executes, each time; a matrix product as its multiplications and additions; anything else as
    one for each nonzero it makes. `softmpc.compiled.instructions` counts each function once
    instead: that is the size of the C code.
    """
    if not function.is_a("MXFunction"):
        return int(function.n_instructions()) if function.is_a("SXFunction") else 0
    return sum(_cost(function, k) for k in range(function.n_instructions()))


def _cost(function: ca.Function, k: int) -> int:
    operation = function.instruction_id(k)
    if operation == ca.OP_OUTPUT:
        return int(function.nnz_out(function.instruction_output(k)[0]))
    node = function.instruction_MX(k)
    if operation == ca.OP_CALL:
        return executed(node.which_function())
    if operation == ca.OP_MTIMES:
        x, y = node.dep(1), node.dep(2)
        return int(2 * x.nnz() * y.nnz() / max(x.shape[1], 1))
    return int(node.nnz())
