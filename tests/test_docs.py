"""README and docs: code blocks run and print what the page says, commands and links exist."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest
from pages import PAGES, ROOT, Block, blocks, links, run, tidy, workplace

import softmpc
from softmpc.model.scene_file import scene_from_dict
from softmpc.model.scene_reference import reference_page

README = (ROOT / "README.md").read_text(encoding="utf-8")
CI = ROOT / ".ci" / "run"
MARKERS = ("<!-- main job -->", "<!-- test command -->")

any_page = pytest.mark.parametrize("page", PAGES, ids=[page.stem for page in PAGES])


def blocks_of(page: Path, *kinds: str) -> list[Block]:
    return [block for block in blocks(page.read_text(encoding="utf-8")) if block.kind in kinds]


@pytest.mark.sampled
@any_page
def test_python_blocks(page: Path) -> None:
    with workplace():
        done = run(page)
    for block, expected, printed in done:
        if expected is not None:
            assert tidy(printed) == tidy(expected.body), f"{page.name}, line {block.line}"


@any_page
def test_scene_file_blocks(page: Path) -> None:
    for block in blocks_of(page, "toml"):
        scene_from_dict(tomllib.loads(block.body))


@any_page
def test_links(page: Path) -> None:
    missing = [
        target
        for target in links(page.read_text(encoding="utf-8"))
        if not target.startswith("#") and not (page.parent / target.partition("#")[0]).exists()
    ]
    assert missing == []


# ---------------------------------------------------------------- commands


def softmpc_commands(page: Path) -> list[list[str]]:
    """Arguments of every call of `softmpc` in the shell blocks of a page."""
    lines = [line for b in blocks_of(page, "bash", "console") for line in b.body.splitlines()]
    calls = [call for line in lines for call in line.removeprefix("$ ").split(" && ")]
    words = [shlex.split(call) for call in calls]
    return [call[1:] for call in words if Path(call[0]).name == "softmpc"]


@any_page
def test_commands_exist(page: Path) -> None:
    calls = softmpc_commands(page)
    if not calls:
        return
    from softmpc.cli.main import main

    context = click.Context(main)
    for name, *arguments in calls:
        command = main.get_command(context, name)
        assert command is not None, f"softmpc {name}"
        options = {option for parameter in command.params for option in parameter.opts}
        assert {word for word in arguments if word.startswith("--")} <= options
        scenes = [word for word in arguments if word.endswith(".toml")]
        assert [scene for scene in scenes if not (ROOT / scene).is_file()] == []


def test_readme_commands() -> None:
    """The README has two commands, each under its marker."""
    after = [README.partition(f"{marker}\n```bash\n")[2].partition("```")[0] for marker in MARKERS]
    assert after == [block.body for block in blocks(README) if block.kind == "bash"]
    main_job, tests = after
    assert "softmpc track examples/figure_eight.toml" in main_job
    assert tests.rstrip().endswith(".venv/bin/python -m pytest")


def test_ci_runs_the_readme() -> None:
    assert os.access(CI, os.X_OK)
    function = re.search(r"^test_command\(\) \{.*?^\}$", CI.read_text(), re.MULTILINE | re.DOTALL)
    assert function is not None
    script = f"{function[0]}\ntest_command"
    found = subprocess.run(
        ["bash", "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert found.stdout == [b.body for b in blocks(README) if b.kind == "bash"][1]


# ---------------------------------------------------------------- generated pages and pictures


def test_scene_reference_is_current() -> None:
    page = (ROOT / "docs" / "scene_reference.md").read_text(encoding="utf-8")
    assert page == reference_page(), "run python docs/make_scene_reference.py"


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("script", "page"),
    [
        ("make_images.py", "conventions.md"),
        ("make_inverse_image.py", "inverse.md"),
        ("make_motion_images.py", "simulation.md"),
    ],
)
def test_pictures_are_made(script: str, page: str, tmp_path: Path) -> None:
    command = [sys.executable, "-W", "error", str(ROOT / "docs" / script), str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    subprocess.run(command, env=environment, check=True, capture_output=True)
    made = {path.name for path in tmp_path.iterdir()}
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    assert made == {Path(target).name for target in links(text) if target.endswith(".png")}
    assert made <= {path.name for path in (ROOT / "docs" / "images").iterdir()}


def test_api_page_has_all_public_names() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"automodule:: softmpc\.(\S+)", page))
    assert set(softmpc._HOME.values()) - shown == set()
    architecture = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    extended = re.findall(r"`softmpc/((?!view|__init__)[\w/]+)\.py`", architecture)
    assert {name.replace("/", ".") for name in extended} - shown == set()
    assert len(extended) > 10


# ---------------------------------------------------------------- the tools above


def test_blocks_and_links_are_found() -> None:
    text = "[a](b.md#c) `[no](x.md)`\n\n```python\nprint('[no](y.md)')\n```\n\n```text\n[no]\n```\n"
    python, output = blocks(text)
    assert (python.kind, python.body, python.line) == ("python", "print('[no](y.md)')\n", 4)
    assert output.body == "[no]\n"
    assert links(text) == ["b.md#c"]
