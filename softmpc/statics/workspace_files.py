"""Files of a workspace: NPZ with all of it, CSV with its surfaces and limits, and its numbers."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.files import reading_npz, replacing
from softmpc.statics.workspace_limits import Extreme
from softmpc.statics.workspace_rays import Place
from softmpc.statics.workspace_result import Surface, Workspace
from softmpc.statics.workspace_samples import Samples

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["load", "save", "summary"]

SCHEMA = 1
ABOUT = ("title", "section", "dimension", "wall_s")
GRID = ("frame", "azimuths", "rims", "nodes")
SURFACE = ("radii", "tips", "pressures", "q", "smallest_stiffness", "flags")
SAMPLES = ("pressures", "q", "tips")


def summary(space: Workspace) -> dict[str, Any]:
    """The workspace in m, degrees and MPa, as plain data."""
    counts = {
        side: {
            "confirmed": int(np.sum(surface.flags > 0)),
            "beyond": int(np.sum(surface.flags == 2)),
            "missing": int(np.sum(surface.flags == 0)),
            "all_stable": bool(np.all(surface.stable[surface.flags > 0])),
        }
        for side, surface in (("outer", space.outer), ("inner", space.inner))
        if surface is not None
    }
    area = space.shell.area if space.shell else None
    return {
        "section": space.section,
        "held_mpa": {str(unit): p / 1e6 for unit, p in space.held.items()},
        "dimension": space.dimension,
        "volume_m3": space.volume,
        "volume_error_m3": space.volume_error,
        **({} if area is None else {"area_m2": area}),
        "extents_m": dict(zip("xyz", space.extents.tolist(), strict=True)),
        "polar_deg": _range(np.degrees(space.rims)),
        "radius_m": _range(space.shell.outer, space.shell.inner) if space.shell else None,
        "points": counts,
        "grid_error_mm": space.grid_error * 1e3,
        "limits": [_extreme(e) for e in space.extremes],
        "samples": len(space.samples),
        "wall_s": space.wall_s,
    }


def _range(*values: Any) -> list[float] | None:
    every = np.concatenate([np.ravel(v) for v in values])
    every = every[np.isfinite(every)]
    return [float(every.min()), float(every.max())] if len(every) else None


def _extreme(e: Extreme) -> dict[str, Any]:
    unit, factor = ("_deg", 180 / np.pi) if e.quantity == "bending_angle" else ("_m", 1.0)
    place = e.place
    return {
        "quantity": e.quantity + unit,
        "section": e.section,
        "sense": e.sense,
        "value": e.value * factor,
        "found": place is not None,
        "pressures_mpa": None if place is None else (place.pressures / 1e6).tolist(),
        "tip_m": None if place is None else place.tip.tolist(),
    }


# ---------------------------------------------------------------- files


def save(space: Workspace, folder: Path) -> list[Path]:
    """Write workspace.npz, workspace.csv (surfaces) and limits.csv; a crash leaves good files."""
    paths = [folder / name for name in ("workspace.npz", "workspace.csv", "limits.csv")]
    with replacing(paths[0]) as beside, open(beside, "wb") as file:
        np.savez_compressed(file, allow_pickle=False, **_content(space))
    _write_rows(paths[1], _surface_rows(space))
    _write_rows(paths[2], _limit_rows(space))
    return paths


def _write_rows(path: Path, rows: Iterable[Sequence[Any]]) -> None:
    with replacing(path) as beside, open(beside, "w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def _surface_rows(space: Workspace) -> Iterator[Sequence[Any]]:
    """A row a node; where there is no shell, one a sample."""
    units = space.samples.pressures.shape[1]
    head = ["surface", "azimuth [deg]", "polar [deg]", "radius [m]", "x [m]", "y [m]", "z [m]"]
    yield [*head, *(f"P_{j} [Pa]" for j in range(1, units + 1)), "smallest_stiffness [J]", "flag"]
    if space.shell is None or space.outer is None or space.inner is None:
        samples = space.samples
        for tip, p in zip(samples.tips.tolist(), samples.pressures.tolist(), strict=True):
            yield ["sample", "", "", float(np.linalg.norm(tip)), *tip, *p, "", 1]
        return
    polars = np.degrees(space.shell.polars)
    azimuths = np.degrees(space.azimuths)
    for name, side in (("outer", space.outer), ("inner", space.inner)):
        for i, j in np.ndindex(*side.radii.shape):
            yield [
                name, azimuths[i], polars[i, j], side.radii[i, j], *side.tips[i, j],
                *side.pressures[i, j], side.smallest_stiffness[i, j], side.flags[i, j],
            ]  # fmt: skip


def _limit_rows(space: Workspace) -> Iterator[Sequence[Any]]:
    units = space.samples.pressures.shape[1]
    pressures = [f"P_{j} [Pa]" for j in range(1, units + 1)]
    yield ["quantity", "section", "sense", "value", "unit", "x [m]", "y [m]", "z [m]", *pressures]
    for e in space.extremes:
        unit = "rad" if e.quantity == "bending_angle" else "m"
        place = [] if e.place is None else [*e.place.tip.tolist(), *e.place.pressures.tolist()]
        yield [e.quantity, e.section, e.sense, e.value, unit, *place]


def _content(space: Workspace) -> dict[str, Any]:
    about = {"schema": SCHEMA, **{name: getattr(space, name) for name in ABOUT}}
    about["held"] = {str(unit): p for unit, p in space.held.items()}
    about["extremes"] = [
        {"quantity": e.quantity, "section": e.section, "sense": e.sense, "value": e.value,
         "place": e.place and e.place.plain()}
        for e in space.extremes
    ]  # fmt: skip
    content = {name: getattr(space, name) for name in GRID}
    content |= {f"samples_{name}": getattr(space.samples, name) for name in SAMPLES}
    for side, surface in (("outer", space.outer), ("inner", space.inner)):
        if surface is not None:
            content |= {f"{side}_{name}": getattr(surface, name) for name in SURFACE}
    return {"about": json.dumps(about), **content}


def load(path: Path) -> Workspace:
    """Read a workspace.npz, or that of a folder; raises `InputError` for a file that is none."""
    path = path / "workspace.npz" if path.is_dir() else path
    with reading_npz(path, "workspace", (SCHEMA,)) as (about, content):
        grid = {name: content[name] for name in GRID}
        samples = Samples(*(content[f"samples_{name}"] for name in SAMPLES))
        sides: dict[str, Any] = {
            side: Surface(*(content[f"{side}_{name}"] for name in SURFACE))
            if f"{side}_radii" in content
            else None
            for side in ("outer", "inner")
        }
        extremes = tuple(
            Extreme(**{**found, "place": Place.of(found["place"])})
            for found in about.pop("extremes")
        )
        held = {int(unit): p for unit, p in about.pop("held").items()}
        return Workspace(**about, **grid, **sides, held=held, extremes=extremes, samples=samples)
