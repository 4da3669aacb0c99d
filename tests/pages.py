"""The Markdown pages: README and docs, their code blocks, links and printed numbers.

A ```text block right after a ```python block is what the latter prints. To rewrite these after a
change: `python tests/pages.py --write` (then read the difference before you keep it).
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```(?P<kind>[^\n`]*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\((?P<target>[^)\s]+)\)")


@dataclass(frozen=True)
class Block:
    """A fenced block; `span` is where its body is in the page's text."""

    kind: str
    body: str
    span: tuple[int, int]
    line: int  # of its first line, from 1


def blocks(text: str) -> list[Block]:
    """All fenced blocks of a page."""
    found = []
    for m in FENCE.finditer(text):
        line = text.count("\n", 0, m.start("body")) + 1
        found.append(Block(m["kind"].strip(), m["body"], m.span("body"), line))
    return found


def links(text: str) -> list[str]:
    """Targets of all links and pictures outside code, without web addresses."""
    prose = re.sub(r"`[^`\n]*`", "", FENCE.sub("", text))
    return [m["target"] for m in LINK.finditer(prose) if "://" not in m["target"]]


def outputs(text: str) -> Iterator[tuple[Block, Block | None]]:
    """Each python block with the text block right after it, if there is one."""
    all_blocks = blocks(text)
    for block, after in zip(all_blocks, [*all_blocks, None][1:], strict=True):
        if block.kind == "python":
            between = text[block.span[1] : after.span[0]] if after else ""
            adjacent = after is not None and re.fullmatch(r"```\s*```text\n", between)
            yield block, after if adjacent else None


def run(page: Path) -> list[tuple[Block, Block | None, str]]:
    """Run the python blocks of a page in one namespace, here; with what each printed."""
    namespace: dict[str, object] = {"__name__": "__main__"}
    done = []
    for block, expected in outputs(page.read_text(encoding="utf-8")):
        source = "\n" * (block.line - 1) + block.body
        code = compile(source, str(page), "exec", dont_inherit=True)
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(code, namespace)
        done.append((block, expected, printed.getvalue()))
    return done


def tidy(text: str) -> list[str]:
    """Lines without trailing blanks."""
    return [line.rstrip() for line in text.strip("\n").splitlines()]


@contextlib.contextmanager
def workplace() -> Iterator[Path]:
    """An empty folder with a copy of `examples`, as the current one."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "examples", Path(folder) / "examples")
        os.chdir(folder)
        try:
            yield Path(folder)
        finally:
            os.chdir(before)


def rewrite(page: Path) -> bool:
    """Put what the blocks print into their text blocks; whether that changed the page."""
    text = page.read_text(encoding="utf-8")
    new = text
    with workplace():
        done = run(page)
    for _, expected, printed in reversed(done):
        if expected is not None:
            start, end = expected.span
            new = new[:start] + "\n".join(tidy(printed)) + "\n" + new[end:]
    if new != text:
        page.write_text(new, encoding="utf-8")
    return new != text


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        raise SystemExit("usage: python tests/pages.py --write")
    sys.path.insert(0, str(ROOT))
    for each in PAGES:
        print(each.name, "rewritten" if rewrite(each) else "as it was")
