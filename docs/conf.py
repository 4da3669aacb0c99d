"""Sphinx: `sphinx-build -W -b html docs docs/_build/html`."""

import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # so that the docs describe this checkout

import softmpc  # noqa: E402

project = "softmpc"
author = "The softmpc authors"
copyright = "2026, The softmpc authors"
version = release = softmpc.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc"]
exclude_patterns = ["_build"]
source_suffix = {".md": "markdown"}
myst_heading_anchors = 3

html_theme = "furo"
html_title = f"softmpc {version}"

autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
autodoc_typehints = "none"  # the docstrings give shapes and units


def plain(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Turn docstrings, which are plain text with `names` and indented displays, into RST."""
    found: list[str] = []
    before = ""
    for line in lines:
        display = line.startswith("    ")
        if display and not before.strip() and found[-2:-1] != ["::"]:
            in_display = any(row.startswith("    ") for row in found[-2:])
            found += [] if in_display else ["::", ""]
        found.append(line if display else escaped(line))
        before = line
    lines[:] = found


def escaped(line: str) -> str:
    """A line of text with names as literals, and no other markup."""
    pieces = re.split(r"(``[^`]+``|`[^`]+`)", line)
    for i, piece in enumerate(pieces):
        if piece.startswith("`"):
            pieces[i] = f"``{piece.strip('`')}``"
        else:
            pieces[i] = re.sub(r"([*|\\]|_(?=\W|$))", r"\\\1", piece)
    return "".join(pieces)


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", plain)
