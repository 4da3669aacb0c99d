"""The chosen scene as a file, with the evidence at its top."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from textwrap import wrap
from typing import Any

from softmpc.accuracy.bound import CALIBRATED, SHARE
from softmpc.accuracy.choose_families import GOALS
from softmpc.accuracy.choose_rate import rate_text
from softmpc.accuracy.choose_result import Choice
from softmpc.errors import InputError
from softmpc.files import replacing
from softmpc.study.lengths import length_text

__all__ = ["check_place", "clear_place", "evidence_lines", "time_text", "write_choice"]

NAME = "chosen.toml"
CHOSEN_BY = "Chosen by:"
WIDTH = 100


def check_place(scene: Path, out: Path) -> None:
    """Raise `InputError` where the scene is itself in the place of the answer."""
    target = out / NAME
    if target.exists() and target.samefile(scene):
        raise InputError(
            f"{scene}: would be replaced by what is chosen; name another folder (--out)"
        )


def clear_place(out: Path) -> None:
    """Take away what an earlier choice has written there: it is not what the latest one found."""
    target = out / NAME
    if target.exists() and target.read_bytes().startswith(f"# {CHOSEN_BY}".encode()):
        target.unlink()


def write_choice(choice: Choice, folder: Path, out: Path, command: str = "") -> Path:
    """Write chosen.toml to `out`: the whole scene file with its changes, the evidence in comments.

    Files that the scene names are looked for in `folder`, that of the original, and copied beside
    it. `command` is said to be what chose it. Raises `InputError` where nothing can be written.
    """
    import tomli_w  # here, because reading does not need it

    told = f"{choice.title}, within {length_text(choice.goal.tolerance_m)}"
    if choice.goal.rate_hz is not None:
        told += f" at {rate_text(choice.goal.rate_hz)}"
    own = {name: _moved(part, folder, out) for name, part in choice.document.items()}
    text = tomli_w.dumps({"schema": 1, **own, "title": told})
    lines = [line for one in evidence_lines(choice, command) for line in wrap(one, WIDTH - 2)]
    target = out / NAME
    with replacing(target) as beside:
        beside.write_text("".join(f"# {line}\n" for line in lines) + "\n" + text, encoding="utf-8")
    return target


def evidence_lines(choice: Choice, command: str = "") -> Iterator[str]:
    """What the choice rests on, for people."""
    chosen, goal = choice.chosen, choice.goal
    assert chosen is not None and chosen.bound_m is not None
    error, calibrated = chosen.point.error, CALIBRATED[goal.family]
    if command:
        yield f"{CHOSEN_BY} {command}"
    yield f"Changed: {chosen.point.name}."
    label = _without_unit(GOALS[goal.family].error_label)
    yield f"Measured: {label}: {length_text(error['error_m'])}."
    share = f"in {100 * SHARE:.0f} % of scenes"
    rests = f"calibrated on {_counted(calibrated.scenes)}"
    if not calibrated.enough:
        share, rests = "as far as is known", f"{rests}, too few to say in how many others it holds"
    yield (
        f"Bound: below {length_text(chosen.bound_m)} {share}, which is the measured error and "
        f"{calibrated.factor:.3g} times the reference's doubt of {length_text(error['doubt_m'])} "
        f"({rests})."
    )
    for about in dict.fromkeys(choice.references.values()):
        yield f"Reference: {about}."
    label = _without_unit(GOALS[goal.family].cost_label)
    yield f"Cost: {time_text(chosen.point.cost)}: {label}."
    if goal.rate_hz is not None and chosen.step_s is not None:
        takes, has = 1e3 * chosen.step_s, 1e3 / goal.rate_hz
        yield f"Rate: a step takes {takes:.3g} ms of {has:.3g} ms (95 % of steps)."
    machine = choice.machine
    compiler = machine["compiler"] or "not compiled: no compiler was found"
    yield f"Machine: {machine['processor']}, {machine['cores']} cores; {compiler}."


def _without_unit(label: str) -> str:
    return label.rpartition(" (")[0]


def _counted(scenes: int) -> str:
    return "1 scene" if scenes == 1 else f"{scenes or 'no'} scenes"


def time_text(cost: Mapping[str, Any]) -> str:
    """A time and how it compares with the scene as given."""
    size, unit = next(
        (size, unit) for size, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (0.0, "µs"))
        if cost["time_s"] >= size
    )  # fmt: skip
    told = f"{cost['time_s'] / (size or 1e-6):.3g} {unit}"
    return told + (f" ({cost['ratio']:.2f} of the scene as given)" if "ratio" in cost else "")


def _moved(value: Any, folder: Path, out: Path) -> Any:
    """The same value; files that it names, which are in `folder`, are copied to `out`."""
    if isinstance(value, Mapping):
        return {key: _moved(item, folder, out) for key, item in value.items()}
    if isinstance(value, list):
        return [_moved(item, folder, out) for item in value]
    if not isinstance(value, str) or not Path(value).suffix or not (folder / value).is_file():
        return value
    source, target = folder / value, out / Path(value).name
    if source.resolve() != target.resolve():
        with replacing(target) as beside:
            beside.write_bytes(source.read_bytes())
    return target.name
