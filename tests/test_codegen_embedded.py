"""Generated controllers on Arm: a small stand-in runs on all targets, its footprint is known."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softmpc.codegen import targets
from softmpc.codegen.emulate import Answers, Steps, read_sizes, run_steps
from softmpc.codegen.footprint import footprint, footprint_table
from softmpc.codegen.stack_bound import read_code, read_frames
from softmpc.codegen.targets import ARM_LINUX, CORTEX_M7, HOST, PRECISIONS, TARGETS, build, run_tool
from softmpc.errors import BuildError, InputError

C = Path(targets.__file__).parent / "c"
STAND_IN = Path(__file__).parent / "stand_in"
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")
COUNT = 5
EPSILON = {"double": 2.3e-16, "float": 1.2e-7}
LEAST = {"double": 256 * 8, "float": 256 * 4}  # bytes of an array of the stand-in on the stack


def needs(*wanted: targets.Target) -> pytest.MarkDecorator:
    reasons = [target.missing for target in wanted if target.missing]
    return pytest.mark.skipif(bool(reasons), reason="; ".join(reasons) or "all is there")


on_board = needs(HOST, CORTEX_M7)


def stand_in(folder: Path, change: Callable[[str], str] = str, memory: str = "") -> Path:
    """A directory like a generated one; `change` of the text of its controller.c."""
    folder.mkdir()
    for name in ("controller.h", "linear.c", "linear.h", "real.h", "scalar.h"):
        shutil.copy(C / name, folder)
    shutil.copytree(C / "board", folder / "board")
    for path in STAND_IN.iterdir():
        shutil.copy(path, folder)
    source = (folder / "controller.c").read_text(encoding="utf-8")
    changed = change(source)
    assert change is str or changed != source
    (folder / "controller.c").write_text(changed, encoding="utf-8")
    if memory:
        path = folder / "memory.h"
        path.write_text(path.read_text(encoding="utf-8").replace("spare[20000]", memory))
    return folder


@pytest.fixture(scope="module")
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return stand_in(tmp_path_factory.mktemp("embedded") / "controller")


@pytest.fixture(scope="module")
def steps() -> Steps:
    rng = np.random.default_rng(7)
    shapes = ((COUNT, 4, 3), (COUNT, 2), (COUNT, 5))
    return Steps(*(rng.normal(size=shape) for shape in shapes))


@pytest.fixture(scope="module")
def answers(directory: Path, steps: Steps) -> Callable[[str, str], Answers]:
    found: dict[tuple[str, str], Answers] = {}

    def answer(target: str, precision: str) -> Answers:
        if (target, precision) not in found:
            found[target, precision] = run_steps(directory, steps, target, precision)
        return found[target, precision]

    return answer


@pytest.fixture(scope="module")
def figures(directory: Path) -> dict:
    return footprint(directory)


# ---------------------------------------------------------------- the same answers everywhere


@needs(HOST, ARM_LINUX)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_arm_linux_answers_bit_by_bit(answers: Callable, precision: str) -> None:
    host, there = answers("host", precision), answers("arm-linux", precision)
    assert np.all(np.abs(host.u).max(axis=0) > 0)
    assert host.u.tobytes() == there.u.tobytes()
    assert list(there.iterations) == [1, 2, 3, 4, 5]  # nothing is forgotten between steps


@on_board
@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_board_answers_as_the_host(answers: Callable, precision: str) -> None:
    """Its C library has other sines: not bit by bit."""
    host, board = answers("host", precision), answers("cortex-m7", precision)
    np.testing.assert_allclose(board.u, host.u, rtol=0, atol=20 * EPSILON[precision])
    for name in ("status", "qp", "iterations"):
        np.testing.assert_array_equal(getattr(board, name), getattr(host, name))
    assert board.told["steps"] == COUNT
    assert board.u.astype(np.float32).tobytes() != board.u.tobytes()


@on_board
def test_floats_differ_from_doubles(answers: Callable) -> None:
    double, single = (answers("cortex-m7", p).u for p in PRECISIONS)
    assert 0 < np.abs(double - single).max() < 1e-5
    assert np.array_equal(single.astype(np.float32), single)


@needs(CORTEX_M7)
def test_the_board_counts_instructions(tmp_path: Path, steps: Steps) -> None:
    """A loop of two instructions a turn, a million turns."""
    loop = (
        "    int turns = 1000000;\n"
        '    __asm__ volatile("1: subs %0, %0, #1\\n\\tbne 1b" : "+r"(turns) : : "cc");\n'
        "    c->report.qp = 1;"
    )
    slower = stand_in(tmp_path / "slow", lambda text: text.replace("    c->report.qp = 1;", loop))
    found = run_steps(slower, steps).told
    quick = run_steps(stand_in(tmp_path / "quick"), steps).told
    took = found["feedback_most_instructions"] - quick["feedback_most_instructions"]
    assert took == pytest.approx(2_000_000, abs=200)
    assert found["feedback_instructions"] >= COUNT * 2_000_000
    assert abs(found["prepare_instructions"] - quick["prepare_instructions"]) <= 100 * COUNT


# ---------------------------------------------------------------- what it takes


@on_board
@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_stack_of_the_board_is_within_the_bound(
    answers: Callable, figures: dict, precision: str
) -> None:
    used, bound = answers("cortex-m7", precision).told["stack_bytes"], figures[precision]["stack"]
    assert LEAST[precision] < used <= bound["bytes"] <= used + 64
    assert bound["fits"] and bound["budget"] == 128 * 1024
    feedback = figures[precision]["calls"]["smpc_feedback"]
    assert feedback["path"][:2] == ["smpc_feedback", "smpc_lu_solve"]


@on_board
@pytest.mark.parametrize("precision", PRECISIONS)
def test_sizes_of_the_board(answers: Callable, figures: dict, precision: str) -> None:
    one = figures[precision]
    assert one["controller"] == answers("host", precision).told["controller_bytes"]
    assert one["controller"] > 20000 * (8 if precision == "double" else 4)
    parts = one["parts"].values()
    stored = sum(part["code"] + part["constants"] for part in parts)
    kept = sum(part["variables"] for part in parts)
    assert kept == pytest.approx(one["ram"]["bytes"], abs=64)  # but for what aligns them
    assert stored <= one["flash"]["bytes"] <= stored + 2048
    assert one["allocators"] == [] and one["software_double"] == [] and one["why"] == ""


@needs(CORTEX_M7)
def test_table(figures: dict) -> None:
    text = footprint_table(figures)
    assert "STM32H743" in text and text.count("fits") == 6
    assert f"{figures['float']['ram']['bytes'] / 1024:.1f} KiB fits" in text


@needs(CORTEX_M7)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_frames_in_the_code_are_those_of_the_compiler(
    directory: Path, tmp_path: Path, precision: str
) -> None:
    program = build(directory, CORTEX_M7, precision, tmp_path, ("-fstack-usage", *STRICT))
    listing = run_tool(["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", str(program)])
    told = read_frames(tmp_path)
    seen = {f.name: f.frame for f in read_code(listing, {}, {}).functions.values()}
    both = seen.keys() & told.keys()
    assert {"smpc_feedback", "smpc_lu", "main", "smpc_say"} <= both
    assert {name: seen[name] for name in both} == {name: told[name] for name in both}


@needs(CORTEX_M7)
def test_what_does_not_fit_does_not_link(tmp_path: Path) -> None:
    directory = stand_in(tmp_path / "large", memory="spare[70000]")
    found = footprint(directory)
    assert not found["double"]["ram"]["fits"] and found["float"]["ram"]["fits"]
    assert "too much" in footprint_table(found)
    script = "stm32h743.ld"
    with pytest.raises(BuildError, match="RAM"):
        build(directory, CORTEX_M7, "double", tmp_path / "double", memory_map=script)
    assert build(directory, CORTEX_M7, "float", tmp_path / "float", memory_map=script).is_file()


# ---------------------------------------------------------------- what must not be there

BEFORE = "void smpc_init("
RECURSION = """
static real __attribute__((noinline)) deeper(real x) { return x > 1 ? 1 + deeper(x / 2) * x : x; }
"""
HEAP = """
#include <stdlib.h>
char *_sbrk(int more);
static char heap[4096];
char *_sbrk(int more) { static int used; used += more; return heap + used - more; }
"""
POINTER = "\nreal (*volatile smpc_other)(real);\n"


def planted(folder: Path, before: str, statement: str) -> Path:
    """The stand-in with something at the beginning of its feedback."""

    def change(text: str) -> str:
        text = text.replace(BEFORE, f"{before}\n{BEFORE}", 1)
        return text.replace("    c->report.qp = 1;", f"{statement}\n    c->report.qp = 1;")

    return stand_in(folder, change)


@needs(CORTEX_M7)
@pytest.mark.parametrize(
    "before, statement, why",
    [
        pytest.param(RECURSION, "u[0] = deeper(u[0]);", "recursion: deeper", id="itself"),
        pytest.param(
            "", "volatile char held[(int)x[0] + 8]; held[0] = 1;", "no fixed size", id="array"
        ),
    ],
)
def test_stack_without_a_bound(tmp_path: Path, before: str, statement: str, why: str) -> None:
    found = footprint(planted(tmp_path / "planted", before, statement), precisions=["double"])
    one = found["double"]
    assert one["stack"] == {"bytes": None, "budget": 128 * 1024, "fits": False}
    assert why in one["why"] and "no bound" in footprint_table(found)
    assert one["calls"]["smpc_prepare"]["bytes"] > 0


@needs(CORTEX_M7)
def test_a_recursion_of_known_depth(tmp_path: Path) -> None:
    """DAQP's is counted once for each row that there may be: none here, and two."""
    before, statement = RECURSION.replace("deeper", "daqp_pivot_last"), "u[0] = daqp_pivot_last(1);"
    one = footprint(planted(tmp_path / "planted", before, statement), precisions=["double"])[
        "double"
    ]
    plain = footprint(stand_in(tmp_path / "plain"), precisions=["double"])["double"]
    assert one["nested"] == {"daqp_pivot_last": 2} and plain["nested"] == {}
    assert one["stack"]["fits"] and one["stack"]["bytes"] >= plain["stack"]["bytes"]


@needs(CORTEX_M7)
def test_heap_and_pointers_are_seen(tmp_path: Path) -> None:
    statement = "smpc_other = malloc(8) ? 0 : smpc_other; if (smpc_other) u[0] = smpc_other(u[0]);"
    one = footprint(planted(tmp_path / "planted", HEAP + POINTER, statement), precisions=["double"])
    assert {"malloc", "_malloc_r", "_sbrk"} <= set(one["double"]["allocators"])
    assert "smpc_feedback" in one["double"]["by_pointer"]
    with pytest.raises(BuildError, match="_sbrk"):  # nothing on a board has a heap to give
        footprint(planted(tmp_path / "bare", "#include <stdlib.h>", "if (malloc(8)) u[0] = 0;"))


@needs(CORTEX_M7)
def test_doubles_among_floats_are_seen(tmp_path: Path) -> None:
    directory = planted(tmp_path / "planted", "", "u[0] = (real)((double)u[0] * 1.1L);")
    found = footprint(directory)
    assert found["double"]["software_double"] == []
    assert found["float"]["software_double"] == ["smpc_feedback"]
    assert "software: smpc_feedback" in footprint_table(found)


@on_board
def test_the_commands_of_the_readme(directory: Path, steps: Steps, answers: Callable) -> None:
    """What board/README.md says to type, as it stands."""
    readme = (directory / "board" / "README.md").read_text(encoding="utf-8")
    commands = readme.partition("```bash\n")[2].partition("```")[0]
    assert "qemu-system-arm" in commands
    (directory / "steps.bin").write_bytes(steps.numbers().tobytes())
    run_tool(["bash", "-euo", "pipefail", "-c", commands], directory)
    found = np.fromfile(directory / "answers.bin").reshape(COUNT, -1)
    np.testing.assert_array_equal(found[:, :2], answers("cortex-m7", "double").u)


# ---------------------------------------------------------------- errors


@needs(CORTEX_M7)
def test_a_fault_ends_the_board(tmp_path: Path, steps: Steps) -> None:
    directory = planted(tmp_path / "planted", "", '    __asm__ volatile("udf #0");')
    with pytest.raises(BuildError, match="ended with 70: the processor met a fault"):
        run_steps(directory, steps)


@needs(HOST)
def test_a_program_that_hangs(tmp_path: Path, steps: Steps) -> None:
    directory = planted(tmp_path / "planted", "", "    while (c) c->report.iterations += 0;")
    with pytest.raises(BuildError, match="did not end within 1 s"):
        run_steps(directory, steps, "host", seconds=1.0)


@needs(HOST)
def test_no_steps(directory: Path, steps: Steps) -> None:
    none = Steps(steps.references[:0], steps.u_before[:0], steps.x[:0])
    assert run_steps(directory, none, "host").u.shape == (0, 2)


def test_wrong_input(directory: Path, steps: Steps, tmp_path: Path) -> None:
    assert read_sizes(directory) == {"N": 4, "NX": 5, "NR": 3, "INPUTS": 2}
    with pytest.raises(InputError, match=r"x: has shape \(5, 2\), this controller takes \(5, 5\)"):
        run_steps(directory, replace(steps, x=steps.u_before), "host")
    with pytest.raises(InputError, match=r"unknown target: 'cortex'.*did you mean 'cortex-m7'"):
        run_steps(directory, steps, "cortex")
    with pytest.raises(InputError, match="precision = 'half': must be one of double, float"):
        run_steps(directory, steps, "host", "half")
    with pytest.raises(InputError, match="softmpc codegen"):
        run_steps(tmp_path, steps, "host")
    with pytest.raises(InputError, match="softmpc codegen"):
        footprint(tmp_path)
    with pytest.raises(InputError, match=r"unknown budget: 'H743'"):
        footprint(directory, "H743")


def test_missing_tools(directory: Path, steps: Steps, monkeypatch: pytest.MonkeyPatch) -> None:
    bare = replace(CORTEX_M7, compiler="no-such-gcc")
    monkeypatch.setitem(TARGETS, "cortex-m7", bare)
    with pytest.raises(BuildError, match=r"no-such-gcc.* not found; .*apt install gcc-arm"):
        run_steps(directory, steps)


# ---------------------------------------------------------------- style


@pytest.mark.sampled
@needs(HOST, ARM_LINUX)
@pytest.mark.parametrize(
    "compiler, precision",
    [
        ("gcc", "double"), ("gcc", "float"), ("clang", "double"),
        ("arm-linux-gnueabihf-gcc", "double"), ("arm-linux-gnueabihf-gcc", "float"),
    ],
)  # fmt: skip
def test_no_warnings(directory: Path, tmp_path: Path, compiler: str, precision: str) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} not found")
    target = replace(ARM_LINUX if "arm" in compiler else HOST, compiler=compiler)
    assert build(directory, target, precision, tmp_path, STRICT).is_file()
