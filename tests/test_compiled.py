"""Compiled functions against CasADi's virtual machine, and every way not to get one."""

from __future__ import annotations

import json
import logging
import os
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from arms import model_of
from click.testing import CliRunner
from test_package import ROOT, run_python

import softmpc.compiled
import softmpc.compiler
from softmpc import library_cache
from softmpc.cli.main import main
from softmpc.compiled import _key, c_code, compiled, default_mode, instructions, kept
from softmpc.compiler import compiler
from softmpc.errors import BuildError, InputError

REAL = compiler()
pytestmark = pytest.mark.skipif(REAL is None or os.name != "posix", reason="no C compiler")
SX, MX, Function = ca.SX.sym, ca.MX.sym, ca.Function


@pytest.fixture(autouse=True)
def fresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """An empty cache, and nothing said or found yet."""
    monkeypatch.setenv("SOFTMPC_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("SOFTMPC_COMPILE", raising=False)
    forget()
    yield
    forget()


def forget() -> None:
    softmpc.compiled._tell_once.cache_clear()
    softmpc.compiler._search.cache_clear()
    library_cache._substitute.cache_clear()
    library_cache._made.clear()


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[str], Path]:
    """Set CC to the real compiler, but with a script of mine where it would build; count builds."""

    def set_cc(script: str) -> Path:
        assert REAL is not None
        count, cc = tmp_path / "builds", tmp_path / "cc"
        count.touch()
        real = shlex.join(REAL.command)
        building = f'case "$*" in *-shared*) echo >> {count}; {script};; esac'
        cc.write_text(f'#!/bin/sh\n{building}\nexec {real} "$@"\n')
        cc.chmod(0o755)
        monkeypatch.setenv("CC", str(cc))
        return count

    return set_cc


def builds(count: Path) -> int:
    return len(count.read_text())


def simple(name: str = "simple", factor: float = 2.0) -> ca.Function:
    x = SX("x", 3)
    return Function(name, [x], [factor * ca.sin(x) / x, ca.sumsqr(x)], ["x"], ["y", "s"])


def warned(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING]


def works(function: ca.Function) -> bool:
    """Whether it gives what `simple` must give, by NumPy."""
    x = np.array([0.3, -1.2, 2.5])
    y, s = (np.array(value.nonzeros()) for value in function(x))
    return np.allclose(y, 2 * np.sin(x) / x, rtol=1e-14) and np.isclose(s[0], x @ x)


# ---------------------------------------------------------------- the same numbers


def scalar() -> ca.Function:
    x = SX("x", 4)
    terms = [ca.exp(x[0]), ca.atan2(x[1], x[2]), ca.fabs(x[3]), ca.sqrt(x[0] ** 2 + 1)]
    terms += [ca.if_else(x[1] > 0, ca.log1p(x[1] ** 2), x[0] ** 3), ca.fmin(x[2], x[3])]
    return Function("scalar", [x], [ca.vertcat(*terms), ca.tanh(x) * ca.floor(10 * x)])


def mapped() -> ca.Function:
    x, p = MX("x", 3, 5), MX("p", 3)
    y, s = simple("inner").map(5)(x)
    return Function("mapped", [x, p], [y + ca.repmat(p, 1, 5), s])


def accumulated() -> ca.Function:
    x, u = MX("x", 2), MX("u", 2)
    step = Function("step", [x, u], [ca.sin(x) + 0.1 * u[::-1]])
    start, inputs = MX("start", 2), MX("inputs", 2, 30)
    return Function("accumulated", [start, inputs], [step.mapaccum("all_steps", 30)(start, inputs)])


def branches() -> ca.Function:
    x = MX("x", 3)
    two, three = simple("two", 2.0), simple("three", 3.0)
    choice = Function.if_else("choice", two, three)
    many = Function.conditional("many", [two, three], two)
    return Function("branches", [x], [choice(x[0] > 0, x)[0], many(ca.floor(3 * x[1]), x)[0]])


def solved() -> ca.Function:
    A, b = MX("A", 4, 4), MX("b", 4)
    return Function("solved", [A, b], [ca.solve(A + 4 * ca.MX.eye(4), b, "qr"), A[:, ::2].T])


def sparse() -> ca.Function:
    x, y = MX("x", ca.Sparsity.lower(4)), MX("y", ca.Sparsity.diag(4))
    names = ["lower", "diagonal"], ["product", "part", "nothing"]
    return Function("sparse", [x, y], [x @ y, x[1:3, :], ca.MX(3, 2)], *names)


def empty() -> ca.Function:
    x, none, row = MX("x", 2), MX("none", 0), MX("row", 1, 0)
    return Function(
        "empty", [none, x, row], [2 * x, none, ca.MX(0, 3)], ["e", "x", "r"], list("abc")
    )


def same_names() -> ca.Function:
    """Two functions inside that share a name, also with the one outside."""
    x = MX("x", 3)
    a, b = simple("same", 2.0), simple("same", 5.0)
    return Function("same", [x], [a(x)[0] - b(x)[0]])


def residual() -> ca.Function:
    return model_of(segments=1).residual


FUNCTIONS = [scalar, mapped, accumulated, branches, solved, sparse, empty, same_names, residual]


def at_random(function: ca.Function, seed: int) -> list[ca.DM]:
    random = np.random.default_rng(seed)
    given = (function.sparsity_in(k) for k in range(function.n_in()))
    return [ca.DM(pattern, random.uniform(-0.9, 0.9, pattern.nnz())) for pattern in given]


@pytest.mark.parametrize("make", FUNCTIONS, ids=lambda make: make.__name__)
def test_same_function(make: Callable[[], ca.Function]) -> None:
    function = make()
    fast = compiled(function, "require")
    assert fast.class_name() == "External"
    assert str(fast).replace(" External", "") == str(function).rpartition(" ")[0]
    for one in (function, fast):
        assert one.name() == function.name()
    assert (fast.name_in(), fast.name_out()) == (function.name_in(), function.name_out())
    for k in range(function.n_in()):
        assert fast.sparsity_in(k) == function.sparsity_in(k)
    for k in range(function.n_out()):
        assert fast.sparsity_out(k) == function.sparsity_out(k)
    for seed in range(5):
        given = at_random(function, seed)
        for got, expected in zip(fast.call(given), function.call(given), strict=True):
            a, b = np.array(got.nonzeros()), np.array(expected.nonzeros())
            assert np.all(np.abs(a - b) <= 1e-12 * np.abs(b))


@pytest.mark.parametrize("make", [scalar, mapped, accumulated, solved, residual])
def test_nan_stays_nan(make: Callable[[], ca.Function]) -> None:
    """Fast arithmetic would drop it, and with it every check of a solver."""
    function = make()
    given = [ca.DM(pattern.sparsity(), np.nan) for pattern in at_random(function, 0)]
    for got, expected in zip(
        compiled(function, "require").call(given), function.call(given), strict=True
    ):
        nan = np.isnan(np.array(got.nonzeros()))
        assert np.array_equal(nan, np.isnan(np.array(expected.nonzeros())))
    assert nan.any()


def test_functions_of_one_name_at_once() -> None:
    double, triple = compiled(simple(factor=2.0)), compiled(simple(factor=3.0))
    assert works(double)
    assert np.allclose((triple(1)[0] / double(1)[0]).nonzeros(), 3 / 2, rtol=1e-14)


def test_a_failed_call_raises() -> None:
    x = MX("x")
    fast = compiled(Function("positive", [x], [x.attachAssert(x > 0, "not positive")]), "require")
    assert float(fast(1)) == 1
    with pytest.raises(RuntimeError):
        fast(-1)


def test_compiled_stays_as_it_is() -> None:
    fast = compiled(simple())
    assert compiled(fast, "require") is fast


def test_instructions_count_called_functions_once() -> None:
    inner = simple("inner")
    n = inner.n_instructions()
    for k in (2, 50):
        x = MX("x", 3, k)
        loop = Function("loop", [x], list(inner.map(k)(x)))
        assert instructions(loop) == n + loop.n_instructions() < n + 10
    both = branches()
    inside = simple("two", 2.0).n_instructions() + simple("three", 3.0).n_instructions()
    assert instructions(both) == both.n_instructions() + inside, "both branches, once"


# ---------------------------------------------------------------- the cache


def test_compiled_once(fake: Callable[[str], Path]) -> None:
    count = fake(":")
    for _ in range(2):
        assert works(compiled(simple(), "require"))
    assert builds(count) == 1
    code = "import test_compiled as t; print(t.works(t.compiled(t.simple(), 'require')))"
    other = f"import sys; sys.path.insert(0, 'tests'); {code}"
    assert run_python(other).strip() == "True"
    assert builds(count) == 1, "another process finds it"
    compiled(simple(factor=3.0), "require")
    assert builds(count) == 2
    assert [p.suffix for p in library_cache.folder().iterdir()] == [".so", ".so"]


def test_kept(fake: Callable[[str], Path]) -> None:
    """What is in the cache is found without compiling anything."""
    count = fake(":")
    assert kept(simple()) is None and builds(count) == 0
    compiled(simple(), "require")
    found = kept(simple())
    assert found is not None and works(found)
    assert kept(by_lapack()) is None and kept(simple("other")) is None
    assert builds(count) == 1


def race(go: str) -> None:
    """Build when the file appears, and say whether all results are right."""
    slow = residual()
    given = at_random(slow, 1)
    print("ready", flush=True)
    while not os.path.exists(go):
        time.sleep(1e-3)
    fast = [compiled(slow, "require") for _ in range(3)]
    expected = slow.call(given)[0].nonzeros()
    print(
        works(compiled(simple(), "require")),
        *(f.call(given)[0].nonzeros() == expected for f in fast),
    )


@pytest.mark.slow
def test_processes_that_build_at_once(tmp_path: Path) -> None:
    """They start together; each gets a whole library, and nothing else is left behind."""
    go = tmp_path / "go"
    code = (
        f"import sys; sys.path.insert(0, 'tests'); import test_compiled as t; t.race({str(go)!r})"
    )
    command = [sys.executable, "-W", "error", "-c", code]
    processes = [
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) for _ in range(3)
    ]
    for process in processes:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
    go.touch()
    for process in processes:
        assert process.communicate(timeout=60)[0] == "True True True True\n"
        assert process.returncode == 0
    left = sorted(p.name.partition("-")[0] for p in library_cache.folder().iterdir())
    assert left == ["residual", "simple"]


def test_key() -> None:
    """Everything that makes other code makes another key; never fast-math."""
    assert REAL is not None
    key = _key("code", REAL)
    assert key == _key("code", replace(REAL))
    others = [
        replace(REAL, command=("/usr/bin/other-cc",)),
        replace(REAL, command=(*REAL.command, "-DX")),
        replace(REAL, version=REAL.version + ".1"),
        replace(REAL, processor=REAL.processor + "#define __AVX99__ 1"),
        replace(REAL, flags=("-O0",)),
    ]
    assert len({key, _key("other code", REAL), *(_key("code", other) for other in others)}) == 7
    assert "#define" in REAL.processor and REAL.version
    assert not [flag for flag in REAL.flags if "fast" in flag]


def test_key_holds_casadi(monkeypatch: pytest.MonkeyPatch) -> None:
    assert REAL is not None
    before = _key("code", REAL)
    monkeypatch.setattr(ca.CasadiMeta, "version", lambda: "0.0.0")
    assert _key("code", REAL) != before


def test_arguments_of_the_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    assert REAL is not None
    monkeypatch.setenv("CC", shlex.join([*REAL.command, "-DSOME=1"]))
    found = compiler()
    assert found is not None and found.command == (*REAL.command, "-DSOME=1")
    assert works(compiled(simple(), "require"))


@pytest.mark.parametrize("damage", [b"", b"half", b"rubbish"])
def test_damaged_library_is_built_again(damage: bytes, caplog: pytest.LogCaptureFixture) -> None:
    compiled(simple(), "require")
    (library,) = library_cache.libraries()
    whole = library.read_bytes()
    other = library.with_name("other")  # a new file: this process has the old one in memory
    other.write_bytes(whole[: len(whole) // 2] if damage == b"half" else damage)
    other.replace(library)
    assert works(compiled(simple(), "require"))
    (line,) = warned(caplog)
    assert "is damaged and will be built again" in line
    assert library_cache.libraries() == [library]
    assert library.read_bytes() == whole


def test_library_that_does_not_load_is_built_again(caplog: pytest.LogCaptureFixture) -> None:
    """Whole as it was written, but for another system, say."""
    fast = compiled(simple(), "require")
    (library,) = library_cache.libraries()
    library.unlink()
    key = library.stem.split("-")[1]
    with library_cache.workshop() as folder:
        (folder / "built").write_bytes(b"no library")
        library_cache.publish(folder / "built", "simple", key)
    again = compiled(simple(), "require")
    assert works(again) and works(fast)
    (line,) = warned(caplog)
    assert "cannot be loaded and will be built again" in line


def test_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SOFTMPC_CACHE", "~/mine")
    assert library_cache.folder() == tmp_path / "mine"
    monkeypatch.setenv("SOFTMPC_CACHE", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert library_cache.folder() == tmp_path / "xdg" / "softmpc"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored, says the standard
    assert library_cache.folder() == tmp_path / ".cache" / "softmpc"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert library_cache.folder() == tmp_path / "Library" / "Caches" / "softmpc"


def test_clear_leaves_what_is_not_ours(tmp_path: Path) -> None:
    assert library_cache.clear() == 0, "no folder yet"
    fast = compiled(simple(), "require")
    folder = library_cache.folder()
    names = {"libc.so", "notes.txt", "simple.so", ".build-now", ".build-long-ago"}
    for name in names:
        (folder / name).mkdir() if name.startswith(".") else (folder / name).touch()
    os.utime(folder / ".build-long-ago", (0, 0))
    assert library_cache.clear() == 1
    assert {p.name for p in folder.iterdir()} == names - {".build-long-ago"}
    assert works(fast)


# ---------------------------------------------------------------- ways not to get one


FAILURES = {
    "error": ("echo 'x.c:1: error: no luck' >&2; exit 1", "failed: x.c:1: error: no luck"),
    "silent": ("exit 3", "failed: no message"),
    "nothing": ("exit 0", "wrote no library"),
    "rubbish": (
        'while [ "$1" != -o ]; do shift; done; echo rubbish > "$2"; exit 0',
        "its library cannot be loaded",
    ),
    "killed": ("kill -9 $$", "failed: no message"),
}


@pytest.mark.parametrize("name", FAILURES)
def test_failing_compiler(
    name: str, fake: Callable[[str], Path], caplog: pytest.LogCaptureFixture
) -> None:
    script, message = FAILURES[name]
    fake(script)
    function = simple()
    assert compiled(function) is function
    (line,) = warned(caplog)
    assert message in line and "function 'simple'" in line and "virtual machine" in line
    with pytest.raises(BuildError, match=message):
        compiled(function, "require")
    assert not list(library_cache.folder().glob(".build-*"))


def test_hanging_compiler(
    fake: Callable[[str], Path],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    tmp_path: Path,
) -> None:
    """It is ended with all that it started."""
    fake(f"(sleep 1; touch {tmp_path / 'survived'}) & wait")
    monkeypatch.setattr(softmpc.compiler, "COMPILE_SECONDS", 0.3)
    function = simple()
    began = time.monotonic()
    assert compiled(function) is function
    assert time.monotonic() - began < 0.9
    (line,) = warned(caplog)
    assert "did not end within 0.3 s" in line
    time.sleep(1.0)
    assert not (tmp_path / "survived").exists()


@pytest.mark.parametrize(
    "cc, reason",
    [
        ("no-such-compiler -O9", "CC is set, but no-such-compiler is not found"),
        ("true", "is no C compiler like GCC or Clang"),
        ("false", "failed: no message"),
        ("gcc '", "No closing quotation"),
        (None, "cc is not found, gcc is not found, clang is not found"),
    ],
)
def test_no_compiler(
    cc: str | None,
    reason: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    tmp_path: Path,
) -> None:
    """Said once, and what it costs."""
    if cc is None:
        monkeypatch.delenv("CC", raising=False)
        monkeypatch.setenv("PATH", str(tmp_path))
    else:
        monkeypatch.setenv("CC", cc)
    assert compiler() is None
    for function in (simple("one"), simple("two")):
        assert compiled(function) is function
    (line,) = warned(caplog)
    assert reason in line and "times slower" in line and "install gcc or clang" in line
    with pytest.raises(BuildError, match="install gcc or clang, or name one in the variable CC"):
        compiled(function, "require")
    assert not library_cache.folder().exists()


@pytest.mark.parametrize("place", ["below a file", "read-only home", "/proc"])
def test_cache_that_cannot_be_written(
    place: str,
    fake: Callable[[str], Path],
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    tmp_path: Path,
) -> None:
    """A folder for this process takes its place, and is a cache as well."""
    count = fake(":")
    (tmp_path / "file").touch()
    folder = "/proc/softmpc" if place == "/proc" else str(tmp_path / "file" / "cache")
    monkeypatch.setenv("SOFTMPC_CACHE", folder)
    if place == "read-only home":
        monkeypatch.delenv("SOFTMPC_CACHE")
        monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
        monkeypatch.setenv("HOME", str(tmp_path / "file"))
    for _ in range(2):
        fast = compiled(simple())
        assert fast.class_name() == "External" and works(fast)
    compiled(simple("other"))
    (line,) = warned(caplog)
    assert "cannot be written" in line and "SOFTMPC_CACHE" in line
    assert builds(count) == 2


class Callback(ca.Callback):
    def __init__(self) -> None:
        super().__init__()
        self.construct("callback")

    def eval(self, arg: list[ca.DM]) -> list[ca.DM]:
        return [2 * arg[0]]


def calling(inner: ca.Function) -> ca.Function:
    x, others = MX("x", *inner.size_in(0)), range(1, inner.n_in())
    return Function("outer", [x], inner.call([x, *map(ca.MX, map(inner.default_in, others))])[:1])


def adaptive() -> ca.Function:
    x = SX("x")
    return ca.integrator("motion", "cvodes", {"x": x, "ode": -x}, 0, 1)


def optimiser() -> ca.Function:
    x = SX("x")
    options = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    return ca.nlpsol("best", "ipopt", {"x": x, "f": (x - 3) ** 2}, options)


def by_lapack() -> ca.Function:
    A = MX("A", 2, 2)
    return Function("lapack", [A], [ca.solve(A, ca.DM([1, 2]), "lapackqr")])


def mapping_a_compiled_one() -> ca.Function:
    x = MX("x", 3, 4)
    return Function("outer", [x], [compiled(simple()).map(4)(x)[0]])


HOPELESS = {
    "callback": (lambda: calling(Callback()), "CallbackInternal"),
    "integrator": (lambda: calling(adaptive()), "CvodesInterface"),
    "optimiser": (lambda: calling(optimiser()), "needs other libraries: coin-or"),
    "lapack": (by_lapack, "LapackQr does not support code generation"),
    "compiled inside": (lambda: calling(compiled(simple())), "calls compiled ones .simple."),
    "compiled in a map": (mapping_a_compiled_one, "calls compiled ones .simple."),
}


@pytest.mark.parametrize("name", HOPELESS)
def test_what_casadi_cannot_write(
    name: str,
    fake: Callable[[str], Path],
    caplog: pytest.LogCaptureFixture,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Found before the compiler runs, and CasADi's own warnings stay away."""
    caplog.set_level(logging.INFO)
    make, message = HOPELESS[name]
    function = make()
    count = fake(":")
    forget()
    caplog.clear()
    capfd.readouterr()
    assert compiled(function) is function
    (record,) = caplog.records
    assert record.levelno == logging.INFO
    assert f"no C code for function {function.name()!r}" in record.getMessage()
    for attempt in (lambda: compiled(function, "require"), lambda: c_code(function)):
        with pytest.raises(BuildError, match=message):
            attempt()
    assert builds(count) == 0
    assert "WARNING" not in "".join(capfd.readouterr())


def test_large_functions_are_left(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    function = simple()
    monkeypatch.setattr(softmpc.compiled, "LARGEST", instructions(function) - 1)
    assert compiled(function) is function
    (record,) = caplog.records
    assert f"has {instructions(function)} instructions" in record.getMessage()
    assert works(compiled(function, "require")), "asked for"
    monkeypatch.setattr(softmpc.compiled, "LARGEST", instructions(function))
    assert compiled(function).class_name() == "External"


def test_a_step_of_the_default_arm_is_within_the_limit() -> None:
    model = model_of(segments=2)
    assert instructions(model.residual) + instructions(model.residual_jacobian) < 100_000
    assert softmpc.compiled.LARGEST >= 100_000


# ---------------------------------------------------------------- modes


def test_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    function = simple()
    assert compiled(function, "never") is function
    assert compiled(function).class_name() == "External"
    monkeypatch.setenv("SOFTMPC_COMPILE", "never")
    assert compiled(function) is function
    assert compiled(function, "require").class_name() == "External"
    monkeypatch.setenv("SOFTMPC_COMPILE", "require")
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(BuildError, match="no C compiler"):
        compiled(function)
    monkeypatch.setenv("SOFTMPC_COMPILE", "")
    assert default_mode() == "auto"


def test_wrong_modes(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"unknown mode: 'alway'; .*allowed: auto, never, require"):
        compiled(simple(), "alway")
    monkeypatch.setenv("SOFTMPC_COMPILE", "no")
    with pytest.raises(InputError, match=r"unknown SOFTMPC_COMPILE: 'no'; .*allowed: auto"):
        compiled(simple())


def test_import_is_light() -> None:
    code = "import sys, softmpc.compiled; print({'casadi', 'numpy'} & {*sys.modules})"
    assert run_python(code).strip() == "set()"


# ---------------------------------------------------------------- the command


def cache_command(*words: str) -> dict[str, Any]:
    result = CliRunner().invoke(main, ["cache", "--json", *words])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_cache_command() -> None:
    assert REAL is not None
    folder = str(library_cache.folder())
    assert cache_command()["functions"] == 0
    compiled(simple("one"), "require")
    compiled(simple("two"), "require")
    (data, size) = cache_command(), sum(p.stat().st_size for p in library_cache.libraries())
    assert (data["folder"], data["functions"], data["bytes"]) == (folder, 2, size)
    assert data["compiler"] == str(REAL) and data["flags"] == list(REAL.flags)
    cleared = cache_command("--clear")
    assert (cleared["removed"], cleared["functions"]) == (2, 0)
    assert library_cache.libraries() == []


@pytest.mark.parametrize("below", ["", "cache"])
def test_cache_command_without_a_folder(
    below: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("SOFTMPC_CACHE", str(tmp_path / "file" / below))
    for words in ([], ["--clear"]):
        result = CliRunner().invoke(main, ["cache", *words])
        assert result.exit_code == 2
        assert f"cannot be used, {tmp_path / 'file'} is not a folder" in result.stderr


def test_cache_command_without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    text = CliRunner().invoke(main, ["cache"]).stdout
    assert "none (CC is set, but no-such-compiler is not found)" in text
