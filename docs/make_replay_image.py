"""Draw the picture of the replay page: `python docs/make_replay_image.py [FOLDER]`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from make_motion_images import COLOURS, ROOT
from PIL import Image

from softmpc.cli.main import main as softmpc


def run(*words: object) -> None:
    try:
        softmpc([str(word) for word in words])
    except SystemExit as ended:
        if ended.code:
            raise


def main(folder: Path) -> None:
    scene = ROOT / "examples" / "figure_eight.toml"
    with tempfile.TemporaryDirectory() as scratch:
        log, out = Path(scratch) / "flight.log", Path(scratch) / "out"
        run("track", scene, "--controller", "c", "--record", log)
        run("replay", log, "--out", out)
        folder.mkdir(parents=True, exist_ok=True)
        Image.open(out / "replay.png").quantize(COLOURS).save(folder / "replay.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images")
