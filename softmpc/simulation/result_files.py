"""Files of a simulation: NPZ with all of it, and CSV with its numbers, for other programs."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from softmpc.errors import InputError
from softmpc.files import reading_npz, replacing
from softmpc.simulation.columns import name_of, read_titled
from softmpc.simulation.inputs import Curve, InputProfile
from softmpc.simulation.validity import MotionWarning

__all__ = ["SCHEMA_VERSION", "read_csv", "read_npz", "write_npz"]

SCHEMA_VERSION = 2  # 1 had no inputs
ABOUT = ("title", "status", "setup_s", "wall_s", "titles")
ARRAYS = ("time", "q", "dq", "z", "u", "p", "tips", "tip_speeds")
Fields = dict[str, Any]


def write_npz(path: Path, fields: Fields) -> None:
    """Write the fields of a simulation; a crash leaves the last good file."""
    about = {"schema": SCHEMA_VERSION, **{name: fields[name] for name in ABOUT}}
    about["warnings"] = [vars(warning) for warning in fields["warnings"]]
    content = {name: fields[name] for name in ARRAYS}
    content |= {f"energy_{name}": e for name, e in fields["energies"].items()}
    if fields["profile"] is not None:
        for unit, curve in enumerate(fields["profile"].curves, 1):
            content[f"input_{unit}"] = np.stack([curve.times, curve.values])
    with replacing(path) as beside, open(beside, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, about=json.dumps(about), **content)


def read_npz(path: Path) -> Fields:
    """Fields of a saved simulation; raises `InputError` for a file that is none."""
    with reading_npz(path, "simulation", (1, SCHEMA_VERSION)) as (about, content):
        fields = {name: content.pop(name) for name in ARRAYS}
        about["titles"] = {name: tuple(titles) for name, titles in about["titles"].items()}
        about["warnings"] = tuple(MotionWarning(**found) for found in about.get("warnings", ()))
        inputs = [
            Curve(*content.pop(f"input_{j}")) for j in range(1, _count(content, "input_{}") + 1)
        ]
        profile = InputProfile(tuple(inputs)) if inputs else None
        energies = {name.removeprefix("energy_"): e for name, e in content.items()}
        return {**about, **fields, "energies": energies, "profile": profile}


def read_csv(path: Path) -> Fields:
    """Fields of a simulation from its CSV file, told apart by the names of its columns.

    Raises `InputError` where columns of a simulation are missing.
    """
    titled = read_titled(path)
    by_name = {name_of(title): title for title in titled}
    sections = _count(by_name, "tip_speed_{}")
    places = [f"{axis}_{s + 1}" for s in range(sections) for axis in "xyz"]
    speeds = [f"tip_speed_{s + 1}" for s in range(sections)]
    names = _sorted_names(set(by_name) - {"t", *places, *speeds}, list(by_name))
    missing = [name for name in places if name not in by_name]
    if missing or not (sections and names["q"] and names["p"]):
        lacks = f" {', '.join(missing)}" if missing else "s of a simulation: strains, rates, tips"
        raise InputError(f"{path}: is not a saved simulation: has no column{lacks}")

    def columns(some: list[str]) -> np.ndarray:
        found = [titled[by_name[name]] for name in some]
        return np.stack(found, axis=1) if found else np.zeros((len(titled[by_name["t"]]), 0))

    energies = {n.removesuffix("_energy"): titled[by_name[n]] for n in names.pop("energies")}
    return {
        "title": path.stem,
        "status": "unknown",
        "wall_s": float("nan"),
        "time": titled[by_name["t"]],
        "tips": columns(places).reshape(-1, sections, 3),
        "tip_speeds": columns(speeds),
        "energies": energies,
        "titles": {kind: tuple(by_name[name] for name in some) for kind, some in names.items()},
        **{kind: columns(some) for kind, some in names.items()},
    }


def _sorted_names(some: set[str], order: list[str]) -> dict[str, list[str]]:
    """Names of q, dq, z, u, p and energies; a drive state is what is nothing else."""
    kinds: dict[str, list[str]] = {k: [] for k in ("q", "dq", "z", "u", "p", "energies")}
    for name in (name for name in order if name in some):
        if name.endswith("_energy"):
            kind = "energies"
        elif f"d_{name}" in some:
            kind = "q"
        elif name.startswith("d_") and name[2:] in some:
            kind = "dq"
        else:
            kind = "u" if re.fullmatch(r"T_\d+", name) else "z"
            kind = "p" if re.fullmatch(r"P_\d+", name) else kind
        kinds[kind].append(name)
    kinds["u"] = kinds["u"] or kinds["p"]  # pressures as inputs have one column for both
    return kinds


def _count(names: Any, pattern: str) -> int:
    """How many of pattern 1, 2, … there are."""
    count = 0
    while pattern.format(count + 1) in names:
        count += 1
    return count
