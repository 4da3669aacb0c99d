"""Every function of a generated directory against CasADi's own answers at a thousand states."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import codegen_small as small
import numpy as np
import pytest
from arms import PAPER
from codegen_small import needs

from softmpc.codegen.arm_functions import arm_files, arm_functions
from softmpc.codegen.directory import c_source
from softmpc.codegen.model_functions import Wrapped, controller_functions, sources
from softmpc.control.linearisation import Linearisation
from softmpc.control.ocp import Ocp
from softmpc.control.transcription import Transcription
from softmpc.model.actuation import PressureDrive
from softmpc.model.effects import Gravity, MaterialDamping
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene

pytestmark = needs("gcc")

COUNT, SAME = 1000, 1e-10
STRAIGHT = 20  # states of these are of a straight arm
REST = 10  # and of these at rest
Array = np.ndarray


class Library:
    """Compiled files, whose functions are called with arrays: one row a state."""

    def __init__(self, texts: dict[str, str], real: Any = ctypes.c_double) -> None:
        folder = Path(tempfile.mkdtemp(dir=small.scratch()))
        for name, text in (
            {name: c_source(name) for name in ("real.h", "scalar.h")} | texts
        ).items():
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
        made = folder / "functions.so"
        single = small.SINGLE["gcc"] if real is ctypes.c_float else ()
        files = [str(path) for path in folder.rglob("*.c")]
        flags = ["-std=c99", "-O0", "-ffp-contract=off", *single, "-shared", "-fPIC", f"-I{folder}"]
        small.run(["gcc", *flags, *files, "-o", str(made), "-lm"])
        self.library, self.real = ctypes.CDLL(str(made)), real

    def __call__(self, one: Wrapped, given: dict[str, Array]) -> dict[str, Array]:
        """Results by name, of the shape that CasADi's have; NaN where nothing is written."""
        f, call, pointer = one.function, getattr(self.library, f"smpc_{one.name}"), ctypes.POINTER
        names = f.name_in()
        inputs = [np.ascontiguousarray(given[name], self.real) for name in names]
        shapes = [f.size_out(i)[::-1] for i in range(f.n_out())]  # written row by row
        outputs = [np.full((COUNT, *shape), np.nan, self.real) for shape in shapes]
        call.argtypes, call.restype = [pointer(self.real)] * (len(inputs) + len(outputs)), None
        for k in range(COUNT):
            call(*(part[k].ctypes.data_as(pointer(self.real)) for part in (*inputs, *outputs)))
        return dict(zip(f.name_out(), outputs, strict=True))


def states(model: Model) -> dict[str, Array]:
    """Strains and rates as large as full pressure makes them, all drive states and inputs."""
    random, layout = np.random.default_rng(1), model.layout
    found = {
        name: random.uniform(-1, 1, (COUNT, len(part))) * part.scale
        for name, part in vars(layout).items()
    }
    found["q"][:STRAIGHT] = 0.0
    found["q"][STRAIGHT : 2 * STRAIGHT] *= 1e-9
    for name in ("dq", "ddq"):
        found[name][:REST] = 0.0
    return found


def by_casadi(function: ca.Function, given: list[Array]) -> list[Array]:
    """All states at once in CasADi's virtual machine: results of shape (count, rows, columns)."""
    columns = [part.T if part.ndim == 2 else part for part in given]
    found = function.map(COUNT)(*columns)
    results = [found] if function.n_out() == 1 else found
    sizes = [function.size_out(i) for i in range(function.n_out())]
    return [
        np.asarray(value.full()).reshape(rows, COUNT, columns).swapaxes(0, 1)
        for value, (rows, columns) in zip(results, sizes, strict=True)
    ]


def require_same(found: Array, wanted: Array, within: float = SAME) -> None:
    """Relative to the largest entry of each result."""
    assert np.all(np.isfinite(wanted)) and found.size == wanted.size
    size = np.abs(wanted).reshape(COUNT, -1).max(axis=1)
    error = np.abs(found.reshape(wanted.shape) - wanted).reshape(COUNT, -1).max(axis=1)
    assert np.all(error <= within * size + 1e-300), (
        f"{(error / np.maximum(size, 1e-300)).max():.1e}"
    )


# ---------------------------------------------------------------- the arm

ARMS = {
    "paper": Scene(PAPER),
    "quasi-static, by pressures": Scene(
        PAPER, effects=(Gravity(), MaterialDamping()), actuation=PressureDrive()
    ),
    "five segments": Scene(replace(PAPER, sections=PAPER.sections[:1]), segments=5),
}


def own_functions(model: Model) -> dict[str, Callable[[dict[str, Array]], list[Array]]]:
    """What each function in C is in Python, from states to results."""

    def of(function: ca.Function) -> Callable[[dict[str, Array]], list[Array]]:
        return lambda s: by_casadi(function, [s[name] for name in function.name_in()])

    def pressures(s: dict[str, Array]) -> list[Array]:
        return [s["z"] @ model.drive.C.T + s["u"] @ model.drive.D.T]

    def frames(s: dict[str, Array]) -> list[Array]:
        tips, rotations = by_casadi(model.frames, [s["q"]])
        count = tips.shape[2]
        side_by_side = rotations.reshape(COUNT, 3, count, 3)
        return [tips.swapaxes(1, 2), side_by_side.swapaxes(1, 2).reshape(COUNT, 3 * count, 3)]

    own = {
        name: of(getattr(model, name))
        for name in ("residual", "residual_jacobian", "M", "C", "N", "tau", "tip", "tip_jacobian",
                     "drive_rate", "drive_jacobian")
    }  # fmt: skip
    more = {"pistons": of(model.piston_places), "flows": of(model.tube_flows)}
    return own | more | {"pressures": pressures, "frames": frames}


@cache
def paper() -> tuple[Model, Library]:
    model = build(ARMS["paper"])
    return model, Library(arm_files(model))


def other(name: str) -> tuple[Model, Library]:
    model = build(ARMS[name])
    return model, Library(arm_files(model))


@pytest.mark.parametrize(
    "name", [*ARMS][:1] + [pytest.param(name, marks=pytest.mark.slow) for name in [*ARMS][1:]]
)
def test_functions_of_the_arm(name: str) -> None:
    model, library = paper() if name == "paper" else other(name)
    functions, given, own = arm_functions(model), states(model), own_functions(model)
    assert {"residual", "M", "C", "N", "tau", "tip"} <= {one.name[4:] for one in functions}
    assert len(functions) == (10 if "pressures" in name else 14)
    for one in functions:
        found, wanted = library(one, given), own[one.name[4:]](given)
        wanted = [part for part in wanted if part.size]
        assert len(found) == len(wanted)
        for part, expected in zip(found.values(), wanted, strict=True):
            require_same(part, expected)


def test_the_parts_make_the_residual_and_its_slope() -> None:
    """In C alone: r = M ddq + C dq + N - tau, and finite differences of the tip."""
    model, library = paper()
    given = states(model)
    by_name = {one.name[4:]: one for one in arm_functions(model)}
    r, M, C, N, tau = (
        next(iter(library(by_name[n], given).values())) for n in ("residual", "M", "C", "N", "tau")
    )
    forces = np.einsum("kij,kj->ki", M.reshape(COUNT, 8, 8), given["ddq"])
    forces += np.einsum("kij,kj->ki", C.reshape(COUNT, 8, 8), given["dq"])
    scale = model.layout.r.scale
    left = (r.reshape(COUNT, 8) - forces - N.reshape(COUNT, 8) + tau.reshape(COUNT, 8)) / scale
    assert np.abs(left).max() < 1e-12 * np.abs(forces / scale).max()
    J = library(by_name["tip_jacobian"], given)["J"].reshape(COUNT, 6, 8)
    step = 1e-6 * model.layout.q.scale
    for j in range(8):
        ends = [
            library(by_name["frames"], given | {"q": given["q"] + sign * step[j] * np.eye(8)[j]})
            for sign in (1, -1)
        ]
        slope = (ends[0]["tips"] - ends[1]["tips"]).reshape(COUNT, 6) / (2 * step[j])
        assert np.abs(slope - J[:, :, j]).max() < 1e-7 * np.abs(J[:, :, j]).max()


@pytest.mark.slow
def test_functions_of_the_arm_in_float() -> None:
    model, _ = paper()
    given, own = states(model), own_functions(model)
    library = Library(arm_files(model), ctypes.c_float)
    for one in arm_functions(model):
        rounded = {name: part.astype(np.float32).astype(float) for name, part in given.items()}
        for part, wanted in zip(
            library(one, rounded).values(), own[one.name[4:]](rounded), strict=True
        ):
            require_same(part, wanted, within=1e-5)


# ---------------------------------------------------------------- the controller's own functions


def scaled(t: Transcription, given: dict[str, Array]) -> dict[str, Array]:
    return {
        "q": given["q"] / t.x_scale[: t.n], "dq": given["dq"] / t.x_scale[t.n : 2 * t.n],
        "a": given["ddq"] / t.a_scale[: t.n], "p": given["p"] / t.model.layout.p.scale,
    }  # fmt: skip


def of_the_paper() -> Transcription:
    ocp = small.transcription().ocp
    model = build(Scene(PAPER))
    return Transcription(Ocp(model, small.INTERVALS, small.STEP, ocp.costs, ocp.limits))


PROBLEMS = [
    pytest.param(small.transcription, id="one section"),
    pytest.param(of_the_paper, id="paper", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("make", PROBLEMS)
def test_functions_of_the_controller(make: Callable[[], Transcription]) -> None:
    """Scaled: the residual and its slopes against the model's, costs and limits against theirs."""
    t = make()
    lin = Linearisation(t, "never")
    functions = {one.name: one for one in controller_functions(lin)}
    assert set(functions) == {"residual", "stage", "terms", "terms_slopes"}
    library, given = Library(sources("model", [*functions.values()])), states(t.model)
    inputs, rows = scaled(t, given), t.model.layout.r.scale
    r = by_casadi(t.model.residual, [given[n] for n in ("q", "dq", "ddq", "p")])[0][:, :, 0]
    require_same(library(functions["residual"], inputs)["r"], r / rows)
    found = library(functions["stage"], inputs)
    require_same(found["r"], r / rows)
    slopes = by_casadi(t.model.residual_jacobian, [given[n] for n in ("q", "dq", "ddq", "p")])
    scales = (t.x_scale[: t.n], t.x_scale[t.n : 2 * t.n], t.a_scale[: t.n], t.model.layout.p.scale)
    for name, wanted, scale in zip("KDMP", slopes, scales, strict=True):
        require_same(found[name], wanted / rows[:, None] * scale)


@pytest.mark.parametrize("make", PROBLEMS)
def test_costs_and_limits_of_the_controller(make: Callable[[], Transcription]) -> None:
    t = make()
    lin = Linearisation(t, "never")
    random, terms = np.random.default_rng(2), lin.terms
    functions = {one.name: one for one in controller_functions(lin)}
    library = Library(sources("model", [functions["terms"], functions["terms_slopes"]]))
    names = ("u_before", "u", "x", "given", "ratio")
    given = {
        name: random.uniform(-1, 1, (COUNT, symbol.numel()))
        for name, symbol in zip(names, terms.symbols, strict=True)
    }
    given["x"][:STRAIGHT, : t.n] = 0.0
    given["ratio"] = np.ones((COUNT, 1))
    value = ca.Function("value", terms.symbols, [terms.value])
    require_same(
        library(functions["terms"], given)["found"], by_casadi(value, [*given.values()])[0]
    )
    slopes = ca.densify(ca.jacobian(terms.value, ca.vertcat(*terms.symbols[:3])))
    whole = ca.Function("slopes", terms.symbols, [slopes])
    wanted = by_casadi(whole, [*given.values()])[0]
    bent = wanted[:, terms.bent_rows][:, :, terms.bent_columns]
    assert np.abs(bent).max() > 0
    require_same(library(functions["terms_slopes"], given)["found"], bent)
