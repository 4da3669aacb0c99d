"""Draw the pictures of the planning page: `python docs/make_plan_images.py [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

from make_motion_images import ROOT, save
from PIL import Image

from softmpc.cli.common import progress
from softmpc.planning.scene_table import plan_file
from softmpc.view.plan import animate_plan, draw_plan, draw_refinement


def main() -> None:
    """Write them to a folder, by default docs/images."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    with progress("plan_swing") as report:
        result = plan_file(ROOT / "examples" / "plan_swing.toml", progress=report)
    error = 100 * result.cost_error / result.time
    print(f"{result.status}: {result.time:.4f} s, changed by {error:.2g} % on the last mesh")
    # Median cut leaves the colours of time too few.
    save(draw_plan(result), folder / "plan_swing.png", 256, Image.Quantize.FASTOCTREE)
    save(draw_refinement(result), folder / "plan_refinement.png")
    for path in animate_plan(result, folder / "plan_swing.gif"):
        print(path)


if __name__ == "__main__":
    main()
