"""Each equation of the paper is implemented in exactly one place, whose docstring says so.

The sentence is ``Implements Eq. (17)`` or ``Implements Eqs. (18), (19)``, in the docstring of the
class or function that does it, with the place in the paper behind ``Source:``.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

import softmpc

ROOT = Path(softmpc.__file__).parent
CLAIM = re.compile(r"Implements Eqs?\.((?:,?(?: and)?\s*\(\d+\))+)")
OWNERS = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def documented(tree: ast.AST) -> list[tuple[str, str]]:
    """(name, docstring) of every class and function."""
    nodes = [node for node in ast.walk(tree) if isinstance(node, OWNERS)]
    return [(node.name, ast.get_docstring(node) or "") for node in nodes]


def claims() -> dict[int, list[tuple[str, str]]]:
    """Equation -> (place, docstring) of all who claim it."""
    found: dict[int, list[tuple[str, str]]] = defaultdict(list)
    for path in sorted(ROOT.rglob("*.py")):
        for name, text in documented(ast.parse(path.read_text(encoding="utf-8"))):
            for claim in CLAIM.findall(text):
                for number in re.findall(r"\d+", claim):
                    found[int(number)].append((f"{path.relative_to(ROOT)}:{name}", text))
    return found


FOUND = claims()


@pytest.mark.parametrize("number", range(1, 38))
def test_equation_has_one_home(number: int) -> None:
    places = [place for place, _ in FOUND[number]]
    assert len(places) == 1, f"Eq. ({number}) is implemented in {places or 'no place'}"


def test_no_other_equation_is_claimed() -> None:
    assert sorted(number for number in FOUND if FOUND[number]) == list(range(1, 38))


def test_every_claim_says_where_it_comes_from() -> None:
    missing = {place for all_ in FOUND.values() for place, text in all_ if "Source:" not in text}
    assert not missing


def test_claims_are_found_in_any_wording() -> None:
    tree = ast.parse('def f():\n    """Implements Eqs. (1), (2) and\n    (3): that. See (4)."""\n')
    ((_, text),) = documented(tree)
    assert re.findall(r"\d+", CLAIM.findall(text)[0]) == ["1", "2", "3"]
