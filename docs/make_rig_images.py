"""Draw the pictures of the rig page: `python docs/make_rig_images.py [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from make_motion_images import ROOT, save
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from softmpc.cli.common import progress
from softmpc.rig.rigging import run_rig_file
from softmpc.rig.supervision import State
from softmpc.view.rig import STATE_COLOURS, estimate_figure, rig_figure
from softmpc.view.style import INK, figure, styled

PLACES = {
    State.NORMAL: (1.6, 3.4), State.DEGRADED: (6.4, 3.4), State.FALL_BACK: (6.4, 0.9),
    State.SAFE_STOP: (1.6, 0.9),
}  # fmt: skip
DOES = {
    State.NORMAL: "MPC on the estimate",
    State.DEGRADED: "MPC on what is left",
    State.FALL_BACK: "hold the place at rest",
    State.SAFE_STOP: "ramp inputs to rest",
}
# From, to, words, the bend of the arrow, where the words are.
ARROWS: tuple[tuple[State, State, str, float, tuple[float, float]], ...] = (
    (
        State.NORMAL, State.DEGRADED,
        "a sensor silent, a step failed,\nreadings contradict the estimate", -0.25, (4.0, 4.45),
    ),
    (State.DEGRADED, State.NORMAL, "all well for a while", -0.25, (4.0, 2.6)),
    (
        State.DEGRADED, State.FALL_BACK,
        "tips unseen for long,\nsolver fails for long,\ntip not known", -0.5, (8.25, 2.15),
    ),
    (
        State.FALL_BACK, State.DEGRADED,
        "better for a while\n(normal, if all is well)", -0.5, (4.65, 2.1),
    ),
    (State.FALL_BACK, State.SAFE_STOP, "too long", -0.25, (4.0, 0.12)),
    (State.SAFE_STOP, State.NORMAL, "better for a while,\nor reset by hand", -0.5, (-0.1, 2.15)),
)  # fmt: skip


@styled
def states_figure() -> Any:
    """The states of supervision and the ways between them."""
    made = figure(8.6, 4.4, "States of supervision")
    axes = made.subplots()
    axes.set_axis_off()
    axes.set_xlim(-1.3, 9.4)
    axes.set_ylim(-0.3, 4.9)
    boxes = {state: _box(axes, state) for state in PLACES}
    for one, other, words, bend, place in ARROWS:
        arrow = FancyArrowPatch(
            PLACES[one], PLACES[other], patchA=boxes[one], patchB=boxes[other], shrinkA=3,
            shrinkB=3, arrowstyle="-|>", mutation_scale=11, color=INK, linewidth=1.1,
            connectionstyle=f"arc3,rad={bend}",
        )  # fmt: skip
        axes.add_patch(arrow)
        axes.text(*place, words, ha="center", va="center", fontsize=8)
    return made


def _box(axes: Any, state: State) -> Any:
    """A box with the state's name, and what the controller does in it."""
    x, y = PLACES[state]
    box = FancyBboxPatch(
        (x - 1.15, y - 0.4), 2.3, 0.8, boxstyle="round,pad=0.08", facecolor=STATE_COLOURS[state],
        edgecolor=INK,
    )  # fmt: skip
    axes.add_patch(box)
    axes.text(x, y + 0.16, str(state), ha="center", va="center", fontsize=11, fontweight="bold")
    axes.text(x, y - 0.2, DOES[state], ha="center", va="center", fontsize=8)
    return box


def main() -> None:
    """Write them to a folder, by default docs/images."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    save(states_figure(), folder / "rig_states.png")
    if "--states" in sys.argv:
        return
    for name, stem in (("figure_eight_rig", "rig"), ("circle_faults", "rig_faults")):
        with progress(name) as report:
            result = run_rig_file(ROOT / "examples" / f"{name}.toml", report)
        save(rig_figure(result), folder / f"{stem}.png", colours=256)
        if stem == "rig":
            save(estimate_figure(result), folder / "rig_estimate.png", colours=256)


if __name__ == "__main__":
    main()
