"""The package as a whole: import direction, public names, what is loaded when, sizes."""

from __future__ import annotations

import ast
import importlib
import os
import pkgutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

import softmpc

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = Path(softmpc.__file__).parent
SOURCES = [*sorted(PACKAGE.rglob("*.py")), *sorted((ROOT / "docs").glob("*.py"))]
MODULES = [
    m.name
    for m in pkgutil.walk_packages(softmpc.__path__, "softmpc.")
    if not m.ispkg and not m.name.endswith("__main__")
]
HEAVY = ("casadi", "matplotlib", "control", "scipy")
MOST_PUBLIC_NAMES, MOST_LINES, MOST_LINES_OF_A_FUNCTION = 40, 350, 60


def run_python(code: str) -> str:
    """Output of a fresh interpreter in the project's folder, warnings being errors."""
    command = [sys.executable, "-W", "error", "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_direction() -> None:
    code = "from importlinter.cli import lint_imports; print('exit', lint_imports(no_cache=True))"
    output = run_python(code)
    assert output.rstrip().endswith("exit 0"), output


# ---------------------------------------------------------------- names


@pytest.mark.parametrize("name", MODULES)
def test_all_names_exist(name: str) -> None:
    module = importlib.import_module(name)
    names = module.__all__
    assert [public for public in names if not hasattr(module, public)] == []
    assert [public for public, count in Counter(names).items() if count > 1] == []


def test_public_names() -> None:
    assert len(softmpc.__all__) <= MOST_PUBLIC_NAMES
    assert softmpc.__all__ == sorted(softmpc.__all__)
    assert set(softmpc.__all__) == set(softmpc._HOME)
    assert set(softmpc.__all__) <= set(dir(softmpc))
    for name in softmpc.__all__:
        home = importlib.import_module(f"softmpc.{softmpc._HOME[name]}")
        assert name in home.__all__
        assert getattr(softmpc, name) is getattr(home, name)


def test_public_names_are_typed() -> None:
    """Type checkers see the imports below TYPE_CHECKING; they agree with what is loaded."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    (typed,) = (node for node in tree.body if isinstance(node, ast.If))
    imports = [node for node in typed.body if isinstance(node, ast.ImportFrom)]
    found = {alias.name: str(node.module) for node in imports for alias in node.names}
    assert found == {name: f"softmpc.{home}" for name, home in softmpc._HOME.items()}
    assert (PACKAGE / "py.typed").is_file()


def test_unknown_public_name() -> None:
    with pytest.raises(AttributeError, match="'softmpc' has no attribute 'scene'"):
        softmpc.scene  # noqa: B018


# ---------------------------------------------------------------- what is loaded when


@pytest.mark.parametrize(
    "code",
    [
        pytest.param("import softmpc", id="import softmpc"),
        pytest.param(
            "import contextlib, softmpc.cli.main as cli\n"
            "with contextlib.suppress(SystemExit): cli.main(['--help'])",
            id="softmpc --help",
        ),
    ],
)
def test_heavy_modules_wait(code: str) -> None:
    report = f"import sys; print('loaded:', *(m for m in {HEAVY} if m in sys.modules))"
    assert run_python(f"{code}\n{report}").splitlines()[-1] == "loaded:"


# ---------------------------------------------------------------- sizes


def functions(path: Path) -> Iterator[tuple[str, int]]:
    """(name, lines) of every function of a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            assert node.end_lineno is not None
            yield node.name, node.end_lineno - node.lineno + 1


def test_files_are_short() -> None:
    lines = {str(p.relative_to(ROOT)): len(p.read_bytes().splitlines()) for p in SOURCES}
    assert {name: count for name, count in lines.items() if count > MOST_LINES} == {}


def test_functions_are_short() -> None:
    long = {
        f"{path.relative_to(ROOT)}:{name}": count
        for path in SOURCES
        for name, count in functions(path)
        if count > MOST_LINES_OF_A_FUNCTION
    }
    assert long == {}


def test_benchmarks_start_as_their_pages_say() -> None:
    """`python -m tests.benchmarks.…` from the folder of the project, without what pytest adds."""
    names = sorted(path.stem for path in (ROOT / "tests" / "benchmarks").glob("[!_]*.py"))
    assert "tracking" in names
    code = "import importlib, sys\nfor n in sys.argv[1:]: importlib.import_module(n)"
    modules = [f"tests.benchmarks.{name}" for name in names]
    plain = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-c", code, *modules], cwd=ROOT, env=plain, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
