"""The C of a controller: no warnings, nothing undefined, no memory but its own, a bounded stack."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import codegen_small as small
import numpy as np
import pytest
from codegen_small import COMPILERS, SANITIZERS, SINGLE, STRICT, needs
from codegen_stack import FLAGS, Stack

from softmpc.codegen.emulate import read_sizes

# Of the C library: memory is copied and set, never asked for, and of the rest only mathematics.
MEMORY = {"memcpy", "memset", "memmove", "memcmp", "strlen"}
MATHEMATICS = {
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "expm1",
    "log", "log1p", "sqrt", "fabs", "floor", "ceil", "fmin", "fmax", "pow", "fmod", "hypot",
    "sincos",
}  # fmt: skip
LIBRARY = MEMORY | MATHEMATICS | {f"{name}f" for name in MATHEMATICS} | {"_GLOBAL_OFFSET_TABLE_"}
ENTRIES = (
    "smpc_init", "smpc_set_reference", "smpc_set_limits", "smpc_prepare", "smpc_feedback",
    "smpc_step",
)  # fmt: skip
STACK = 64 * 1024  # bytes that a call may take
STEPS, COUNT, RANDOM = 60, 40, 10_000


@pytest.fixture(scope="module")
def recorded() -> tuple[np.ndarray, np.ndarray]:
    return small.closed_loop(STEPS)


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """All of the controller, with what the compiler says of frames and calls."""
    into = tmp_path_factory.mktemp("objects")
    flags = ["-O1", "-ffp-contract=off", *FLAGS]
    return small.compile_objects(small.sources(small.folder()), into, flags)


@pytest.fixture(scope="module")
def checked(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, tuple[Path, ...]], str]:
    """A program with sanitizers by compiler and files; the controller is compiled once for each."""
    flags = ["-O1", "-ffp-contract=off", *SANITIZERS]
    controllers: dict[str, list[Path]] = {}

    def program(cc: str, files: tuple[Path, ...]) -> str:
        into = tmp_path_factory.mktemp(f"checked-{cc}")
        if cc not in controllers:
            controllers[cc] = small.compile_objects(
                small.sources(small.folder()), into / "controller", flags, cc
            )
        return str(small.program(small.folder(), files, into, flags, controllers[cc], cc))

    return program


def by_compiler(slow: tuple[str, ...] = ()) -> list:
    return [
        pytest.param(cc, marks=[needs(cc), *([pytest.mark.slow] if cc in slow else [])])
        for cc in COMPILERS
    ]


# ---------------------------------------------------------------- what the compilers say


@pytest.mark.sampled
@pytest.mark.parametrize(
    "cc, precision",
    [
        pytest.param("gcc", "double", marks=needs("gcc")),
        pytest.param("clang", "float", marks=needs("clang")),
        pytest.param("gcc", "float", marks=[needs("gcc"), pytest.mark.slow]),
        pytest.param("clang", "double", marks=[needs("clang"), pytest.mark.slow]),
    ],
)
def test_no_warnings(cc: str, precision: str, tmp_path: Path) -> None:
    own = [*filter(small.is_own, small.sources(small.folder()))]
    assert len(own) > 20
    flags = ["-O1", *STRICT, *(SINGLE[cc] if precision == "float" else ())]
    files = small.compile_objects(own, tmp_path, flags, cc)
    if precision == "float":  # and no arithmetic of doubles slips in by its functions
        others = {name for name in symbols(files)[1] if not name.startswith("smpc_")}
        assert {"memcpy", "memset"} <= others and not others & MATHEMATICS


@needs("gcc")
def test_the_header_is_c_plus_plus_too(tmp_path: Path) -> None:
    file = tmp_path / "user.cpp"
    file.write_text(
        '#include "controller.h"\nstatic smpc_controller c;\n'
        "int main() { smpc_init(&c); return smpc_last(&c)->status; }\n"
    )
    words = ["-x", "c++", *STRICT, f"-I{small.folder()}", "-c", str(file)]
    small.run(["gcc", *words, "-o", str(tmp_path / "user.o")])


# ---------------------------------------------------------------- nothing undefined


def spoilt(given: np.ndarray) -> np.ndarray:
    """The same steps, with numbers that no arm and no path has."""
    rows = given.copy()
    for k, value in enumerate([np.nan, np.inf, -np.inf, 1e300, 1e30, 1e9, 5e-324, -1e12]):
        rows[6 * k + 3, k::8] = value
        rows[6 * k + 4, -17:] = value  # the state
    return rows


def replayed(program: list[str], given: np.ndarray) -> np.ndarray:
    """Inputs and status of each step."""
    answers = np.frombuffer(small.run(program, given.tobytes()), "<f8")
    return answers.reshape(len(given), -1)[:, :4]


def require_kept(answers: np.ndarray) -> None:
    """Solved, failed or not finite, with inputs within their limits."""
    assert np.all(np.isfinite(answers)) and len(np.unique(answers[:, 3])) == 3
    assert answers[:, :3].min() >= 0 and answers[:, :3].max() <= small.HIGHEST


@pytest.mark.slow
@pytest.mark.parametrize("cc", by_compiler(slow=("clang",)))
def test_sanitizers_find_nothing_in_a_closed_loop(
    cc: str, recorded: tuple[np.ndarray, np.ndarray], checked: Callable
) -> None:
    given, wanted = recorded
    program = checked(cc, small.REPLAY)
    answers = replayed([program], given)
    assert np.all(answers[:, 3] == 0)
    np.testing.assert_allclose(answers[:, :3], wanted, rtol=0, atol=1e-9)
    require_kept(replayed([program], spoilt(given)))


@pytest.mark.slow
@needs("gcc", "valgrind")
def test_valgrind_finds_nothing_in_a_closed_loop(
    recorded: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    given, wanted = recorded
    flags = ["-O1", "-ffp-contract=off", "-g"]
    program = small.program(small.folder(), small.REPLAY, tmp_path, flags)
    check = ["valgrind", "-q", "--error-exitcode=9", "--leak-check=full", str(program)]
    answers = replayed(check, given[:COUNT])
    np.testing.assert_allclose(answers[:, :3], wanted[:COUNT], rtol=0, atol=1e-9)
    require_kept(replayed(check, spoilt(given)[:COUNT]))


@pytest.mark.slow
@pytest.mark.parametrize("cc", by_compiler(slow=("clang",)))
def test_any_input_has_an_answer(cc: str, checked: Callable) -> None:
    """Ten thousand steps with random inputs under sanitizers; `fuzz.c` says what is checked."""
    said = small.run([checked(cc, small.FUZZ), str(RANDOM), "1"]).decode()
    print(said)
    counts = {
        name.strip(): int(count) for name, count in re.findall(r"^  (\D+) +(\d+)$", said, re.M)
    }
    assert counts["wrong"] == 0
    # Enough of them get as far as the quadratic program, and all kinds of ends are met.
    assert counts["QP optimal"] > RANDOM / 4 and counts["from a plan"] > RANDOM / 4
    assert counts["limits active"] > RANDOM / 10
    met = (
        "input not finite", "iteration cap", "budget overrun", "failed", "QP infeasible",
        "QP not finite", "QP singular", "QP time limit",
    )  # fmt: skip
    assert all(counts[name] > 0 for name in met), counts


# ---------------------------------------------------------------- no memory but its own


def symbols(objects: list[Path]) -> tuple[set[str], set[str]]:
    """Names that are defined in them, and names that are not."""
    lines = small.run(["nm", *map(str, objects)]).decode().splitlines()
    words = [line.split() for line in lines if line and not line.endswith(":")]
    undefined = {word[-1] for word in words if word[-2] == "U"}
    return {word[-1] for word in words if word[-2] != "U"}, undefined


@needs("gcc", "nm")
def test_of_the_system_it_needs_mathematics_and_copying(objects: list[Path]) -> None:
    """No memory is asked for, no file opened, nothing printed; DAQP and CasADi's code included."""
    defined, undefined = symbols(objects)
    assert set(ENTRIES) <= defined
    assert {"memcpy", "sqrt"} <= undefined - defined <= LIBRARY


@needs("gcc", "nm")
def test_public_names_have_the_prefix(objects: list[Path]) -> None:
    lines = small.run(["nm", "--defined-only", "-g", *map(str, objects)]).decode().splitlines()
    names = {line.split()[-1] for line in lines if line and not line.endswith(":")}
    assert set(ENTRIES) <= names
    other = {name for name in names if not name.startswith("smpc_")}
    assert all("daqp" in name or name == "ldp2qp_solution" for name in other)


@needs("gcc", "size")
def test_nothing_can_be_written_but_what_the_caller_keeps(objects: list[Path]) -> None:
    """No variables; tables of words need addresses, which the loader writes once (data.rel.ro)."""
    for file in objects:
        for line in small.run(["size", "-A", str(file)]).decode().splitlines():
            section = re.match(r"(\.data|\.bss|COMMON)(?!\.rel\.ro)\S* +(\d+)", line)
            assert section is None or int(section[2]) == 0, f"{file.name}: {line}"


@needs("gcc", "size")
def test_objects_are_small(objects: list[Path]) -> None:
    rows = small.run(["size", *map(str, objects)]).decode().splitlines()[1:]
    total = sum(int(row.split()[3]) for row in rows)
    print(f"{total} bytes")
    assert 10_000 < total < 2_000_000


# ---------------------------------------------------------------- a bounded stack


@needs("gcc")
def test_the_stack_is_bounded(objects: list[Path]) -> None:
    """DAQP reorders its active constraints by recursion, at most once for each."""
    stack = Stack(objects, read_sizes(small.folder())["MOVES"] + 2)
    found = {name: stack.of(name) for name in ENTRIES}
    print(found)
    assert 1000 < found["smpc_step"] < STACK
    assert found["smpc_set_limits"] < 1024
