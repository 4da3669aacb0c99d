"""The arm in motion, as GIF, and as MP4 where ffmpeg is installed."""

from __future__ import annotations

import logging
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, log10
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import numpy as np

from softmpc.files import replacing
from softmpc.view.arm import Arm, box_of, draw_base, draw_tube, space
from softmpc.view.motion import MOST_POINTS, draw_traces
from softmpc.view.obstacles import NEAR, draw_obstacles, obstacle_key, widened
from softmpc.view.style import GOAL, REFERENCE, figure, styled

if TYPE_CHECKING:
    from softmpc.model.model import Model
    from softmpc.model.obstacles import Obstacle

__all__ = ["Film", "animate", "write_film"]

STEP = 0.08  # s between frames; GIF counts in hundredths, many viewers take none below 0.02
MOST_FRAMES = 300
PIXELS, DOTS = 480, 120  # and dots per inch
COLOURS = 64
log = logging.getLogger(__name__)
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Film:
    """What an animation shows beside the arm, and at what pace.

    `reference` (K×3, m) is the path of the tip, `goals` (N×3, m) are places, `obstacles` are those
    besides what the arm may touch. A film is `slow` times slower than the motion, and stays at its
    end for `pause` seconds; the arm is drawn `thick` times as thick as its envelope.
    """

    title: str = ""
    reference: np.ndarray | None = None
    goals: np.ndarray | None = None
    obstacles: tuple[Obstacle, ...] = ()
    slow: float = 1.0
    pause: float = 0.0
    thick: float = 0.6

    def words(self, time: float) -> str:
        """The title, the clock, and how slow it is."""
        head = shorten(self.title, 54).replace("$", r"\$")
        pace = "" if self.slow == 1 else f", {self.slow:g} times slower"
        return f"{head}\nt = {time:.{1 + ceil(log10(self.slow))}f} s{pace}".strip()

    @property
    def places(self) -> list[np.ndarray]:
        """All that must be in the picture."""
        return [one for one in (self.reference, self.goals) if one is not None]


def animate(
    model: Model,
    time: np.ndarray,
    q: np.ndarray,
    path: Path,
    reference: np.ndarray | None = None,
    title: str = "",
    progress: Progress | None = None,
) -> list[Path]:
    """Write `path` (.gif), and .mp4 beside it if there is ffmpeg; returns what was written.

    Strains `q` (K×n) over `time` (K, s); `reference` (K×3, m) is the path of the tip. Frames are
    in real time, further apart in long motions only.
    """
    return write_film(model, time, q, path, Film(title, reference), progress)


def write_film(
    model: Model,
    time: np.ndarray,
    q: np.ndarray,
    path: Path,
    film: Film,
    progress: Progress | None = None,
) -> list[Path]:
    """As `animate`, with all that a `Film` may have."""
    lasts = film.slow * (time[-1] - time[0])
    count = int(np.clip(lasts / STEP, 1, MOST_FRAMES)) + 1
    picks = np.searchsorted(time, np.linspace(time[0], time[-1], count)).clip(0, len(time) - 1)
    frames = _render(model, time, q, picks, film, progress or (lambda *_: None))
    seconds = lasts / max(count - 1, 1)
    if film.pause:
        frames += frames[-1:] * round(film.pause / max(seconds, STEP / 2))
    with replacing(path) as beside:
        _write_gif(frames, beside, seconds)
    log.info("wrote %s", path)
    if not shutil.which("ffmpeg"):
        return [path]
    movie = path.with_suffix(".mp4")
    with replacing(movie) as beside:
        _write_mp4(frames, beside, seconds)
    log.info("wrote %s", movie)
    return [path, movie]


@styled
def _render(
    model: Model,
    time: np.ndarray,
    q: np.ndarray,
    picks: np.ndarray,
    film: Film,
    progress: Progress,
) -> list[np.ndarray]:
    """The moments `picks` as images (height × width × 3)."""
    arm = Arm(model)
    traces = np.asarray(model.frames.map(len(q))(q.T)[0]).T.reshape(len(q), -1, 3)
    traced = np.union1d(np.linspace(0, len(q) - 1, MOST_POINTS).round().astype(int), picks)
    shapes = [arm.sections(q[k]) for k in picks]
    lines = [line for shape in shapes for line in shape]
    box = box_of(*lines, *film.places, margin=1.5 * max(arm.radii))
    box = widened(box, film.obstacles, NEAR * model.scene.manipulator.length)
    made, axes = _stage(arm, box, film)
    ways = draw_traces(axes, traces[:1])
    clock = made.text(0.03, 0.98, "", fontsize=9, va="top")
    frames = []
    for done, (k, shape) in enumerate(zip(picks, shapes, strict=True), 1):
        gone = traces[traced[traced <= k]]
        for section, way in enumerate(ways):
            way.set_data_3d(*gone[:, section].T)
        clock.set_text(film.words(time[k]))
        frames.append(_snapshot(made, axes, shape, [film.thick * radius for radius in arm.radii]))
        progress(done, len(picks))
    return frames


def _snapshot(made: Any, axes: Any, shape: list[np.ndarray], radii: list[float]) -> np.ndarray:
    """The picture with the arm in that shape, which is taken away again."""
    moving = draw_tube(axes, shape, radii)
    made.canvas.draw()
    for artist in moving:
        artist.remove()
    return np.asarray(made.canvas.buffer_rgba())[..., :3].copy()


def _stage(arm: Arm, box: np.ndarray, film: Film) -> tuple[Any, Any]:
    """A square figure with all that does not move."""
    made = figure(PIXELS / DOTS, PIXELS / DOTS, layout="none")
    made.set_dpi(DOTS)
    axes = space(made, 111, box, arm.hangs, view=(18, -64), zoom=0.94)
    axes.set_position((0.0, 0.1, 0.98, 0.87))
    more = tuple(one for one in film.obstacles if one not in arm.obstacles)
    key = [obstacle_key()] if draw_obstacles(axes, arm.obstacles + more, box) else []
    draw_base(axes, 1.8 * max(arm.radii))
    if film.reference is not None:
        axes.plot(*film.reference.T, **REFERENCE, zorder=8)
    if film.goals is not None:
        key += axes.plot(*film.goals.T, **GOAL, zorder=8, label="goal")
    if key:
        made.legend(handles=key, loc="lower left", borderaxespad=0.2)
    return made, axes


def _write_gif(frames: list[np.ndarray], path: Path, seconds: float) -> None:
    """One palette for all frames, which keeps the file small and the colours still."""
    from PIL import Image

    middle = Image.fromarray(frames[len(frames) // 2])
    palette = middle.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    images = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    ]
    hundredths = max(2, round(100 * seconds))
    images[0].save(
        path, format="GIF", save_all=True, append_images=images[1:],
        duration=10 * hundredths, loop=0, optimize=False,
    )  # fmt: skip


def _write_mp4(frames: list[np.ndarray], path: Path, seconds: float) -> None:
    height, width, _ = frames[0].shape
    source = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {1 / seconds:.4f} -i -"
    target = "-c:v libx264 -pix_fmt yuv420p -movflags +faststart -f mp4"
    command = ["ffmpeg", "-loglevel", "error", "-y", *source.split(), *target.split(), str(path)]
    data = b"".join(frame.tobytes() for frame in frames)
    subprocess.run(command, input=data, capture_output=True, check=True)
