"""sizes.h: sizes, sample time, tolerances and identity of a controller, as macros."""

from __future__ import annotations

from dataclasses import dataclass

from softmpc.codegen import c_text
from softmpc.codegen.condition import Conditioning
from softmpc.codegen.data import ControllerData
from softmpc.control.mpc import RESTART_AFTER
from softmpc.control.real_time import DAMPING, ROUNDING
from softmpc.control.rollout import TOLERANCE
from softmpc.control.solver import FEASIBLE

__all__ = ["Tolerances", "sizes_header"]


@dataclass(frozen=True)
class Tolerances:
    """Numbers that depend on the precision; those of the quadratic program are DAQP's settings."""

    damping: float  # of each diagonal entry of the Hessian
    rounding: float = ROUNDING  # of the merit function
    feasible: float = FEASIBLE
    broken: float = 1e-8  # by how much a scaled row that was left out may be
    rolled: float = TOLERANCE  # of the scaled residual of a stage
    slope: float = 1e-6  # of the largest g, that may be left in a solution
    primal: float = 1e-6
    dual: float = 1e-12
    zero: float = 1e-11
    pivot: float = 1e-8
    progress: float = 1e-14
    singular_pivot: float = 3.7e-11
    refactor: float = 1e-9

    @classmethod
    def double(cls) -> Tolerances:
        return cls(DAMPING)

    @classmethod
    def single(cls, damping: float) -> Tolerances:
        """What seven digits allow.

        Squares of a soft limit's slack reach 1e-8 of its row: `zero` and `singular_pivot` stay
        below, or limits that hold only softly count as contradictions.
        """
        return cls(
            damping, rounding=1e-5, feasible=1e-3, broken=1e-5, rolled=1e-4, slope=1e-2,
            primal=1e-5, dual=1e-6, zero=1e-9, pivot=1e-4, progress=1e-7, singular_pivot=1e-9,
            refactor=1e-5,
        )  # fmt: skip

    def text(self) -> str:
        qp = ("slope", "primal", "dual", "zero", "pivot", "progress", "singular_pivot", "refactor")
        own = ("damping", "rounding", "feasible", "broken", "rolled")
        lines = [
            f"#define SMPC_{name.upper()} ((smpc_real){c_text.number(getattr(self, name))})\n"
            for name in own
        ]
        return "".join(lines) + "".join(
            c_text.define(f"SMPC_QP_{name.upper()}", getattr(self, name)) for name in qp
        )


def sizes_header(
    data: ControllerData, identity: dict[str, str], iterations: int, conditioning: Conditioning
) -> str:
    """The whole file."""
    t = data.t
    references = ", ".join(f"{name}[{size}]" for name, size in t.objective.references.items())
    body = "".join(c_text.define(f"SMPC_{name}", text) for name, text in identity.items())
    body += c_text.define("SMPC_STEP", float(t.ocp.step), "s")
    body += c_text.define("SMPC_REFERENCES", references, "of each node, in this order")
    body += c_text.define("SMPC_QP_ITERATIONS", iterations, "the most of a step")
    body += c_text.define("SMPC_RESTART_AFTER", RESTART_AFTER, "failures in a row")
    body += "".join(c_text.define(f"SMPC_{name}", size) for name, size in data.sizes.items())
    refused = conditioning.refused
    single = f'#error "{refused}"\n' if refused else ""
    single += Tolerances.single(conditioning.damping).text()
    body += f"\n#ifdef SMPC_FLOAT\n{single}#else\n{Tolerances.double().text()}#endif\n"
    return c_text.guard("sizes.h", body)
