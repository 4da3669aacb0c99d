"""`softmpc inverse SCENE --targets FILE`: many targets at once."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from softmpc.cli.common import NOT_CONVERGED, OK, Answer, notice, progress, table, write_text
from softmpc.cli.inverse import summary, warnings
from softmpc.cli.sweep_options import executor_for

if TYPE_CHECKING:
    import numpy as np

    from softmpc.statics.inverse import InverseStatics
    from softmpc.statics.inverse_result import InverseResult
    from softmpc.statics.targets import Target

__all__ = ["many"]

KEPT = "inverse_targets.jsonl"  # what is done, until all of it is


def many(
    inverse: InverseStatics,
    cases: list[list[Target]],
    title: str,
    path: bool,
    compare: int,
    workers: int | None,
    dask: str | None,
    out: Path | None,
) -> Answer:
    """Solve all of them; interrupted, what is done stays in the folder `out` for the next time."""
    from softmpc.statics.inverse_batch import solve_many

    keep = out / KEPT if out else None
    with executor_for(workers, dask) as executor, progress("inverse statics", "target") as tell:
        try:
            found = solve_many(
                inverse, cases, executor=executor, path=path, compare=compare, keep=keep,
                progress=tell,
            )  # fmt: skip
        except KeyboardInterrupt:
            if keep:
                notice(f"what is done is kept in {keep}: the same command goes on from there")
            raise
    counts = Counter(result.status for result in found)
    data = {
        "title": title, "cost": inverse.cost.name, "targets": len(found),
        "solved": counts["solved"], "unreachable": counts["unreachable"],
        "no_convergence": counts["no convergence"],
        "results": [{**summary(r), "warnings": warnings(r)} for r in found],
    }  # fmt: skip
    if out:
        _write(out, inverse, found, title)
        (out / KEPT).unlink(missing_ok=True)
    missed = len(found) - counts["solved"]
    problem = f"{missed} of {len(found)} targets are not held" if missed else ""
    return Answer(data, _text(data, found), NOT_CONVERGED if missed else OK, problem)


def _text(data: dict[str, Any], found: list[InverseResult]) -> str:
    from math import degrees

    import numpy as np

    turned = any(target.turns for r in found for target in r.targets)
    angle = [("largest angle", f"{degrees(max(r.angle for r in found)):.4g} deg")] * turned
    rows: list[tuple[str, object]] = [
        ("targets", len(found)),
        ("solved", data["solved"]),
        ("unreachable", data["unreachable"]),
        ("no convergence", data["no_convergence"]),
        ("not stable", sum(not r.stable for r in found)),
        ("not reached from rest", sum(r.stable and not r.on_rest_branch for r in found)),
        ("largest distance", f"{1e3 * max(r.distance for r in found):.4g} mm"),
        *angle,
        ("median time a target", f"{1e3 * float(np.median([r.seconds for r in found])):.1f} ms"),
    ]
    return "\n".join([data["title"], table(rows)])


def _write(out: Path, inverse: InverseStatics, found: list[InverseResult], title: str) -> None:
    import numpy as np

    from softmpc.files import replacing
    from softmpc.view.inverse import batch_figure
    from softmpc.view.style import save_figure

    arrays: dict[str, np.ndarray] = {
        "q": np.array([r.q for r in found]),
        "p": np.array([r.pressures for r in found]),
        "tips": np.array([r.tips for r in found]),
        "rotations": np.array([r.posture.rotations for r in found]),
        "distance": np.array([r.distance for r in found]),
        "angle": np.array([r.angle for r in found]),
        "solved": np.array([r.solved for r in found]),
        "stable": np.array([r.stable for r in found]),
    }
    if found[0].torques is not None:
        arrays["torques"] = np.array([r.torques for r in found])
    with replacing(out / "inverse.npz") as beside:
        np.savez(beside, allow_pickle=False, **arrays)
    write_text(out / "inverse.csv", _csv(inverse, found))
    save_figure(batch_figure(inverse.model, found, title), out / "inverse.png")


def _csv(inverse: InverseStatics, found: list[InverseResult]) -> str:
    """One row a target, in the order of the file."""
    from math import degrees

    layout = inverse.model.layout
    torques = layout.u.names if found[0].torques is not None else ()
    names = ["status", "distance_mm", "angle_deg", "stable", "on_rest_branch", "x", "y", "z"]
    names += [f"{name}_mpa" for name in layout.p.names] + [f"{name}_nm" for name in torques]
    lines = [",".join(names)]
    for r in found:
        cells: list[Any] = [r.status, r.distance * 1e3, degrees(r.angle), r.stable]
        cells += [r.on_rest_branch, *r.tips[-1].tolist(), *(r.pressures / 1e6).tolist()]
        cells += [] if r.torques is None else r.torques.tolist()
        lines.append(",".join(str(cell) for cell in cells))
    return "\n".join(lines)
