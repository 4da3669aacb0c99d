"""Draw the pictures of the workspace page: `python docs/make_workspace_images.py [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

from make_motion_images import ROOT, save

from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.workspace import find_workspace
from softmpc.view.workspace import workspace_figure
from softmpc.view.workspace_cut import limit_postures, workspace_cut_figure


def main() -> None:
    """Write them to a folder, by default docs/images."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    model = build(Scene(chen2022()))
    space = find_workspace(model)
    save(workspace_figure(model, space, "Two sections, hanging"), folder / "workspace.png")
    sides = {name: q for name, q in limit_postures(space).items() if name.endswith("x")}
    title = "Two sections, hanging: the xz plane"
    save(workspace_cut_figure(model, space, sides, title), folder / "workspace_cut.png")


if __name__ == "__main__":
    main()
