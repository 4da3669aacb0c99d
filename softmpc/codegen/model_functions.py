"""The functions of a model in C: small ones, which the controller calls in loops.

CasADi writes them; one wrapper each gives them plain arguments, row by row, and the work memory
that they need on the stack.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import casadi as ca

from softmpc.codegen import c_text
from softmpc.compiled import c_code
from softmpc.control.linearisation import Linearisation
from softmpc.control.terms import Terms

__all__ = ["Wrapped", "controller_functions", "in_rows", "sources"]


@dataclass(frozen=True)
class Wrapped:
    """A CasADi function under the name `smpc_…`; its outputs are transposed to rows."""

    name: str
    function: ca.Function
    comment: str
    real: str = "smpc_real"

    @property
    def signature(self) -> str:
        f = self.function
        given = [f"const {self.real} *{f.name_in(i)}" for i in range(f.n_in())]
        found = [f"{self.real} *{f.name_out(i)}" for i in range(f.n_out())]
        return f"void smpc_{self.name}({', '.join([*given, *found])})"

    @property
    def body(self) -> str:
        """The wrapper. Memory that CasADi does not need has one element."""
        f = self.function
        inputs = ", ".join(f.name_in(i) for i in range(f.n_in()))
        outputs = ", ".join(f.name_out(i) for i in range(f.n_out()))
        return (
            f"{self.signature}\n{{\n"
            f"    const casadi_real *arg[{max(f.sz_arg(), 1)}] = {{{inputs}}};\n"
            f"    casadi_real *res[{max(f.sz_res(), 1)}] = {{{outputs}}};\n"
            f"    casadi_int iw[{max(f.sz_iw(), 1)}];\n"
            f"    casadi_real w[{max(f.sz_w(), 1)}];\n"
            "    casadi_f0(arg, res, iw, w, 0);\n}\n"
        )


def in_rows(name: str, given: dict[str, Any], found: dict[str, Any]) -> ca.Function:
    """A function with dense outputs, row by row."""
    looped = any(isinstance(value, ca.MX) for value in given.values())
    outputs = [ca.densify(value).T for value in found.values()]
    options = {} if looped else {"cse": True}
    return ca.Function(name, [*given.values()], outputs, [*given], [*found], options)


def controller_functions(linearisation: Linearisation) -> list[Wrapped]:
    """What the controller needs: stages, costs and limits, all scaled."""
    functions = [*_stage(linearisation)]
    for name, terms in (("terms", linearisation.terms), ("end", linearisation.end_terms)):
        if terms.rows:
            functions += _terms("end_terms" if name == "end" else name, name, terms)
    return functions


def _stage(linearisation: Linearisation) -> list[Wrapped]:
    t = linearisation.t
    model, n = t.model, t.n
    layout = model.layout
    kind: Any = ca.MX if model.residual_jacobian.is_a("MXFunction") else ca.SX
    sizes = {"q": n, "dq": n, "a": n, "p": len(layout.p)}
    given = {name: kind.sym(name, size) for name, size in sizes.items()}
    scale = {
        "q": t.x_scale[:n], "dq": t.x_scale[n : 2 * n], "a": t.a_scale[:n], "p": layout.p.scale
    }  # fmt: skip
    at = [given[name] * ca.DM(scale[name]) for name in sizes]
    rows = ca.diag(ca.DM(1 / layout.r.scale))
    r = ca.mtimes(rows, model.residual(*at))
    slopes = {
        name: ca.mtimes(ca.mtimes(rows, J), ca.diag(ca.DM(scale[by])))
        for (name, by), J in zip(
            {"K": "q", "D": "dq", "M": "a", "P": "p"}.items(),
            model.residual_jacobian(*at),
            strict=True,
        )
    }
    return [
        Wrapped("residual", in_rows("casadi_residual", given, {"r": r}), "equations of a stage"),
        Wrapped(
            "stage",
            in_rows("casadi_stage", given, {"r": r, **slopes}),
            "the same, and slopes in q, dq, a and p",
        ),
    ]


def _terms(name: str, short: str, terms: Terms) -> list[Wrapped]:
    names = ("u_before", "u", "x", "given", "ratio")
    given = dict(zip(names, terms.symbols, strict=True))
    function = in_rows(f"casadi_{name}", given, {"found": terms.value})
    found = [Wrapped(name, function, "costs and limits of an interval")]
    if len(terms.bent_rows):
        slopes = in_rows(f"casadi_{short}_slopes", given, {"found": terms.bent_slopes})
        found.append(Wrapped(f"{short}_slopes", slopes, "slopes of those that are not linear"))
    return found


def sources(name: str, functions: list[Wrapped]) -> dict[str, str]:
    """One header with all functions; a source file for each, so that each compiles by itself."""
    lines = [f"/* {one.comment} */\n{one.signature};\n" for one in functions]
    needed = '#include "real.h"\n\n' if any(one.real == "smpc_real" for one in functions) else ""
    files = {f"{name}.h": c_text.guard(f"{name}.h", needed + "\n".join(lines))}
    for one in functions:
        scalar = '#include "scalar.h"\n' if one.real == "smpc_real" else ""
        files[f"{name}_{one.name}.c"] = (
            "/* Written by CasADi; the wrapper at the end is softmpc's. */\n"
            f'#include "{name}.h"\n{scalar}#define casadi_real {one.real}\n#define casadi_int int\n'
            f"#define CASADI_CODEGEN_PREFIX\n#define CODEGEN_PREFIX smpc_{one.name}_\n"
            f"{_private(c_code(one.function))}\n{one.body}"
        )
    return files


def _private(code: str) -> str:
    """The static functions alone: what describes a function to others is left out."""
    one_line = r"^CASADI_SYMBOL_EXPORT[^\n]*\{[^\n]*\}\n"
    several = r"^CASADI_SYMBOL_EXPORT[^\n]*\{\n.*?^\}\n"
    code = re.sub(one_line, "", code, flags=re.MULTILINE)
    code = re.sub(several, "", code, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"\n{3,}", "\n\n", code).rstrip() + "\n"
