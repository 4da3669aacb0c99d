"""Draw the picture of the inverse statics page: `python docs/make_inverse_image.py [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

from make_motion_images import ROOT, save

from softmpc.model.model import build
from softmpc.model.presets import chen2022
from softmpc.model.scene import Scene
from softmpc.statics.inverse import InverseStatics
from softmpc.statics.targets import Direction, Position
from softmpc.view.inverse import inverse_figure


def main() -> None:
    """Write it to a folder, by default docs/images."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    inverse = InverseStatics(build(Scene(chen2022())))
    wanted = [Position((0.45, 0.1, 0.45)), Direction((1.0, 0.0, 0.0))]
    found = inverse.solve(wanted, compare=5)
    save(inverse_figure(inverse.model, found, "A place and a direction"), folder / "inverse.png")


if __name__ == "__main__":
    main()
