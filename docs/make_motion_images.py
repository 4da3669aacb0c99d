"""Draw Figures 6 to 8 of the paper: `python docs/make_motion_images.py [FOLDER]`.

Also an energy audit. What is printed are settling times, overshoots and top speeds of the tip.
"""

import io
import sys
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from softmpc.model.model import build
from softmpc.model.scene_file import read_document, scene_from_dict
from softmpc.simulation.audit import audit
from softmpc.simulation.run import simulate_file
from softmpc.simulation.settling import overshoot, settling_time
from softmpc.view.energy import energy_figure
from softmpc.view.motion import motion_figure

ROOT = Path(__file__).parents[1]
MOTIONS = ("step_fig6", "step_fig7", "ramp_fig8")
DOTS, COLOURS = 100, 64  # keep the files small


def main() -> None:
    """Write the pictures to a folder, by default docs/images."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "images"
    folder.mkdir(parents=True, exist_ok=True)
    print("motion     settling (s)  overshoot (%)  top speed of the tip (m/s)")
    for name in MOTIONS:
        scene = ROOT / "examples" / f"{name}.toml"
        motion = simulate_file(scene)
        model = build(scene_from_dict(read_document(scene)))
        save(motion_figure(model, motion, motion.title), folder / f"{name}.png")
        if name == "step_fig6":
            found = energy_figure(audit(model, motion), f"{motion.title}: energy")
            save(found, folder / "energy_fig6.png")
        numbers = settling_time(motion), 100 * overshoot(motion), motion.tip_speeds[:, -1].max()
        print(f"{name}  " + "  ".join(f"{number:12.2f}" for number in numbers))


def save(
    figure: Figure,
    path: Path,
    colours: int = COLOURS,
    method: Image.Quantize = Image.Quantize.MEDIANCUT,
) -> None:
    """A small PNG, of so many colours; `method` finds them."""
    whole = io.BytesIO()
    figure.savefig(whole, dpi=DOTS)
    with Image.open(whole) as image:
        image.convert("RGB").quantize(colours, method, dither=Image.Dither.NONE).save(
            path, optimize=True
        )
    print(path)


if __name__ == "__main__":
    main()
