"""Compare THIRD_PARTY_NOTICES.md with what softmpc depends on, carries and runs.

python .ci/notices.py         fails and says what is missing, or has another licence
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib.metadata import Distribution, PackageNotFoundError, distribution, version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "softmpc"
PAGE = ROOT / "THIRD_PARTY_NOTICES.md"
OWN = "The softmpc authors"
PLUGINS = ("nlpsol", "conic", "integrator")  # CasADi's calls that name a plug-in second
BY_CASADI = {"idas": "SUNDIALS", "cvodes": "SUNDIALS", "ipopt": "IPOPT"}
# What a package calls the licences that the page names by their SPDX identifiers.
OTHER_WORDS = {"PSF": "Python Software Foundation", "Apache": "Apache"}

Rows = dict[str, list[str]]


def rows(heading: str) -> Rows:
    """First cell -> the cells of each table row below a heading (## …) of the page."""
    part = PAGE.read_text(encoding="utf-8").partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in part.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {row[0]: row for row in cells if row[0] not in ("name", "---")}


def names_of(requirement: str) -> tuple[str, str]:
    """The name of a requirement, as on the page, and its range of versions."""
    match = re.match(r"([\w.-]+)\s*([^;\[ ]*)", requirement)
    assert match is not None
    return re.sub(r"[-_.]+", "-", match[1]).lower(), match[2]


def brought(name: str, seen: set[str]) -> set[str]:
    """All that a package brings, of what is installed here."""
    try:
        needed = distribution(name).requires or []
    except PackageNotFoundError:
        return seen
    for requirement in needed:
        below = names_of(requirement)[0]
        if "extra ==" not in requirement and below not in seen:
            seen.add(below)
            brought(below, seen)
    return seen


def said(found: Distribution) -> str:
    """What a package's metadata say of its licence."""
    about = found.metadata
    words = [
        about.get("License-Expression"),
        about.get("License"),
        *about.get_all("Classifier", []),
    ]
    return " ".join(word for word in words if word)


def other_licence(name: str, licence: str) -> str | None:
    """What the metadata of an installed package say where the page says something else."""
    family = re.split(r"[-\s]", licence)[0]
    try:
        words = said(distribution(name))
    except PackageNotFoundError:
        return None
    known = re.sub(r"Public Licen[sc]e", "", words)
    return None if OTHER_WORDS.get(family, family) in known else words[:80]


def missing_packages() -> Iterator[str]:
    """Dependencies, and what these bring, that the page has not, or has otherwise."""
    table = rows("What is installed with softmpc")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    optional = project["optional-dependencies"]["dask"]
    direct = dict(names_of(one) for one in project["dependencies"] + optional)
    for name, span in direct.items():
        if name not in table:
            yield f"{name}: a dependency without an entry"
        elif table[name][1] != span:
            yield f"{name}: the page has {table[name][1]}, pyproject.toml {span}"
    below = set().union(*(brought(names_of(one)[0], set()) for one in project["dependencies"]))
    yield from (f"{name}: installed with softmpc, no entry" for name in sorted(below - set(table)))
    for name, cells in table.items():
        words = other_licence(name, cells[2] if name in direct else cells[1])
        if words:
            yield f"{name}: its metadata say {words!r}"


def missing_folders() -> Iterator[str]:
    """Folders of the package with a licence of others, and licence files, not named as they are."""
    table = {row[2].strip("`"): row for row in rows("What softmpc carries").values()}
    kept = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for file in sorted(PACKAGE.rglob("*")):
        if not re.fullmatch(r"(LICEN[CS]E|COPYING|NOTICE)\S*", file.name):
            continue
        if OWN in file.read_text(encoding="utf-8"):
            continue
        folder, name = (path.relative_to(ROOT).as_posix() for path in (file.parent, file))
        if folder not in table:
            yield f"{folder}: carried, no entry"
        elif table[folder][1] != (file.parent / "VERSION").read_text(encoding="utf-8").strip():
            yield f"{folder}: its VERSION is not {table[folder][1]}"
        if name not in kept["license-files"]:
            yield f"{name}: not among license-files of pyproject.toml"


@cache
def plugins() -> set[str]:
    """Plug-ins of CasADi that the sources name."""
    found = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                second = node.args[1] if len(node.args) > 1 else None
                if node.func.attr in PLUGINS and isinstance(second, ast.Constant):
                    found.add(str(second.value))
    return found


def missing_in_wheel() -> Iterator[str]:
    """Plug-ins in use, libraries and licences of CasADi's wheel without an entry."""
    table = rows("What CasADi's wheel carries")
    used = [name for name, row in table.items() if len(row) == 5]
    for plugin in sorted(plugins()):
        wanted = BY_CASADI.get(plugin, plugin).lower()
        if not any(name.lower().startswith(wanted) for name in used):
            yield f"{plugin}: a plug-in of CasADi that softmpc runs, no entry"
    text = PAGE.read_text(encoding="utf-8")
    if f"Of CasADi {version('casadi')};" not in text:
        return  # another version may carry other libraries
    import casadi

    wheel = Path(casadi.__file__).parent
    names = set(re.findall(r"`([\w.-]+)`", text))
    folders = {path.name for path in (wheel / "include" / "licenses").iterdir()}
    yield from (f"{name}: licence folder of CasADi's wheel, no entry" for name in folders - names)
    if sys.platform == "linux":
        files = [path.name for path in wheel.glob("lib*") if re.search(r"\.(so|a)\b", path.name)]
        libraries = {re.sub(r"^lib|(-[0-9a-f]{8})?\..*", "", name) for name in files}
        for name in libraries - names:
            if not name.startswith("casadi_"):
                yield f"{name}: library of CasADi's wheel, no entry"


def main() -> None:
    wrong = [*missing_packages(), *missing_folders(), *missing_in_wheel()]
    if wrong:
        sys.exit(f"{PAGE.name}:\n  " + "\n  ".join(wrong))
    print(f"{PAGE.name} names all that is carried, installed and run")


if __name__ == "__main__":
    main()
