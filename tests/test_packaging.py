"""Packaging: notices of others' licences, the workflow of CI, what goes into wheel and sdist."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import conftest
import pytest
import yaml
from pages import ROOT, blocks

from softmpc.cli.common import INTERRUPTED, NOT_CONVERGED, OK, WRONG_INPUT
from softmpc.cli.main import UNEXPECTED
from softmpc.cli.replay import DIFFERENT
from softmpc.codegen import flight_format
from softmpc.codegen.targets import TARGETS
from softmpc.control import planned, track_result
from softmpc.model import scene
from softmpc.planning import plan_files
from softmpc.rig import result as rig_result
from softmpc.simulation import result_files
from softmpc.statics import workspace_files

PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
NOTICES = ROOT / "THIRD_PARTY_NOTICES.md"
WORKFLOW = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
JOBS = WORKFLOW["jobs"]
RUN = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
PARTS = re.search(r"^parts=\((.+)\)$", RUN, re.MULTILINE)[1].split()  # type: ignore[index]


@cache
def script(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


# ---------------------------------------------------------------- notices


def test_notices_name_all() -> None:
    command = [sys.executable, str(ROOT / ".ci" / "notices.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("there", "instead", "said"),
    [
        ("| scipy | >=1.11 |", "| skipy | >=1.11 |", "scipy: a dependency without an entry"),
        ("| numpy | >=1.26 |", "| numpy | >=1.20 |", "numpy: the page has >=1.20"),
        ("| tqdm | >=4.66 | MPL-2.0", "| tqdm | >=4.66 | EPL-2.0", "tqdm: its metadata say"),
        ("| pyparsing | MIT |", "| parsing | MIT |", "pyparsing: installed with softmpc"),
        ("| DAQP | 0.11.0 |", "| DAQP | 0.10.0 |", "VERSION is not 0.10.0"),
        ("`softmpc/codegen/c/daqp` |", "`softmpc/daqp` |", "softmpc/codegen/c/daqp: carried"),
        ("| PIQP |", "| QP |", "piqp: a plug-in of CasADi that softmpc runs"),
        ("| SUNDIALS", "| SUN", "idas: a plug-in of CasADi that softmpc runs"),
    ],
)
def test_notices_find_what_is_missing(
    there: str, instead: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    notices = script("notices")
    text = NOTICES.read_text(encoding="utf-8")
    assert there in text
    other = tmp_path / "notices.md"
    other.write_text(text.replace(there, instead), encoding="utf-8")
    monkeypatch.setattr(notices, "PAGE", other)
    with pytest.raises(SystemExit, match=re.escape(said)):
        notices.main()


# ---------------------------------------------------------------- the workflow


def lines_of(job: str) -> list[str]:
    return [step["run"].strip() for step in JOBS[job]["steps"] if "run" in step]


def test_workflow_has_all_systems_and_versions() -> None:
    versions = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if ":: 3." in c]
    systems = ["ubuntu-latest", "macos-latest", "windows-latest"]
    assert JOBS["tests"]["strategy"]["matrix"] == {"os": systems, "python": versions}
    assert JOBS["installed"]["strategy"]["matrix"] == {"os": systems}
    assert PROJECT["requires-python"] == f">={versions[0]}"
    for job in JOBS.values():
        assert job["runs-on"] in ("ubuntu-latest", "${{ matrix.os }}")
        assert [step["uses"].partition("@")[0] for step in job["steps"] if "uses" in step] == [
            "actions/checkout", "actions/setup-python",
        ]  # fmt: skip
        assert job["timeout-minutes"] > 0


def test_workflow_runs_commands_of_the_project() -> None:
    """What it installs and runs is what README and .ci have."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    tests = [block.body for block in blocks(readme) if block.kind == "bash"][1].strip()
    environment, test = tests.rsplit(" && ", 1)
    for job in ("tests", "oldest"):
        install, run = lines_of(job)
        assert run == test.replace(".venv/bin/", "")
        assert install.startswith('python -m pip install --quiet -e ".[test]"')
    oldest = next(one for one in PROJECT["dependencies"] if one.startswith("casadi"))
    assert lines_of("oldest")[0].endswith(f'"{oldest.replace(">=", "==")}"')
    for job in ("checks", "slow"):
        first, *_, last = lines_of(job)
        assert first == environment
        assert last.startswith(".ci/run ")
    assert lines_of("installed")[1] == "python .ci/installed.py"


def test_workflow_runs_all_parts() -> None:
    called = [word for job in ("checks", "slow") for word in lines_of(job)[-1].split()[1:]]
    assert sorted([*called, "tests", "installed"]) == sorted(PARTS)
    cases = re.findall(r"^        ([a-z]+)\) ", RUN.replace(")\n", ") \n"), re.MULTILINE)
    assert cases == PARTS
    packages = {
        name for target in TARGETS.values() if target.name != "host" for name in target.packages
    }
    assert packages <= set(lines_of("slow")[1].split())


def test_tests_for_linux_alone_are_there() -> None:
    for name, tests in conftest.ON_LINUX.items():
        text = (ROOT / "tests" / f"{name}.py").read_text(encoding="utf-8")
        assert [test for test in tests if f"def {test}(" not in text] == []


@pytest.mark.parametrize(
    ("system", "casadi", "expected"),
    [
        ("linux", "3.8.2", []),
        ("win32", "3.8.2", ["a", "test_ci_runs_the_readme"]),
        ("linux", "3.7.2", ["c[1]", "test_python_blocks[model]"]),
    ],
)
def test_elsewhere_they_are_skipped(
    system: str, casadi: str, expected: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    marked: list[str] = []

    def item(file: str, name: str) -> Any:
        return SimpleNamespace(
            path=Path(f"{file}.py"), name=name, add_marker=lambda mark: marked.append(name),
            get_closest_marker=lambda mark: None,
        )  # fmt: skip

    items = [item("test_codegen_clean", "a"), item("test_docs", "test_links")]
    items += [item("test_docs", "test_ci_runs_the_readme"), item("test_statics", "b")]
    items += [item("test_plan", "c[1]"), item("test_docs", "test_python_blocks[model]")]
    monkeypatch.setattr("sys.platform", system)
    monkeypatch.setattr("casadi.CasadiMeta.version", lambda: casadi)
    conftest.pytest_collection_modifyitems(items)
    assert marked == expected
    files = [*conftest.OF_PLANS, *conftest.ON_LINUX]
    assert [name for name in files if not (ROOT / "tests" / f"{name}.py").is_file()] == []


def test_of_sampled_tests_the_first_case_is_always_run() -> None:
    left: list[str] = []

    def item(name: str, *marks: str) -> Any:
        return SimpleNamespace(
            path=Path("test_a.py"), name=name, add_marker=lambda mark: left.append(name),
            get_closest_marker=lambda mark: mark if mark in marks else None,
        )  # fmt: skip

    one = [item("a[1]", "sampled", "slow"), item("a[2]", "sampled"), item("a[3]", "sampled")]
    conftest.leave_first_cases([*one, item("b[1]"), item("b[2]"), item("c", "sampled")])
    assert left == ["a[3]"]


def test_output_in_any_encoding() -> None:
    """What a console or a pipe cannot show is replaced, as in a pipe on Windows."""
    words = ["inverse", "examples/step_fig6.toml", "--tip", "0.12,0,0.57"]
    environment = os.environ | {"PYTHONIOENCODING": "iso8859-5:strict", "PYTHONUTF8": "0"}
    command = [sys.executable, "-m", "softmpc.cli", *words]
    shown = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False)
    assert shown.returncode == 0, shown.stderr
    assert b"torques (N?m)" in shown.stdout


# ---------------------------------------------------------------- wheel and sdist


def test_named_files_exist() -> None:
    """`.ci/installed.py` builds and installs; here, that nothing named has moved."""
    installed = script("installed")
    assert PROJECT["license-files"] == list(installed.LICENCES)
    sdist = PYPROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    names = [*PROJECT["license-files"], *installed.IN_SDIST, *(name.strip("/") for name in sdist)]
    assert [name for name in names if not (ROOT / name).exists()] == []
    parts = {Path(name).parts[0] for name in installed.IN_SDIST}
    assert parts <= {name.strip("/") for name in sdist}


# ---------------------------------------------------------------- versions


def test_schemas_are_those_of_the_page() -> None:
    page = (ROOT / "docs" / "versioning.md").read_text(encoding="utf-8")
    table = re.findall(r"^\| ([\w -]+) \| (\d) \| ([\d, ]+) \|$", page, re.MULTILINE)
    found = {name: (int(w), tuple(map(int, r.split(",")))) for name, w, r in table}
    assert found == {
        "scene file": (scene.SCHEMA_VERSION, (scene.SCHEMA_VERSION,)),
        "simulation": (result_files.SCHEMA_VERSION, (1, result_files.SCHEMA_VERSION)),
        "closed-loop run": (track_result.RESULT_SCHEMA, track_result.READS),
        "run of a rig": (rig_result.SCHEMA, (rig_result.SCHEMA,)),
        "plan": (plan_files.SCHEMA, planned.PLAN_SCHEMAS),
        "workspace": (workspace_files.SCHEMA, (workspace_files.SCHEMA,)),
        "flight log": (flight_format.FORMAT, (flight_format.FORMAT,)),
    }


def test_exit_statuses_are_those_of_the_page() -> None:
    page = (ROOT / "docs" / "versioning.md").read_text(encoding="utf-8")
    said = [f"{UNEXPECTED} an unexpected", f"{OK} well", f"{WRONG_INPUT} wrong input"]
    said += [
        f"{NOT_CONVERGED} no convergence",
        f"{DIFFERENT} a replay",
        f"{INTERRUPTED} interrupted",
    ]
    assert [words for words in said if words not in page] == []


def test_supported_versions_are_those_of_the_page() -> None:
    page = (ROOT / "docs" / "versioning.md").read_text(encoding="utf-8")
    versions = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if ":: 3." in c]
    oldest = next(one for one in PROJECT["dependencies"] if one.startswith("casadi"))
    assert (
        f"Python {versions[0]} to {versions[-1]}; CasADi from {oldest.partition('>=')[2]}" in page
    )
