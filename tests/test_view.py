"""Pictures: what is on them is labelled, readable and true, whatever the arm."""

from __future__ import annotations

import logging
import os
import re
import subprocess
import sys
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from softmpc.control.track_result import TrackResult
from softmpc.model.model import Model, build
from softmpc.model.scene_file import scene_from_dict
from softmpc.simulation.audit import Audit
from softmpc.simulation.result import Simulation, titles_of
from softmpc.view import animation, time_plots
from softmpc.view.arm import Arm, box_of
from softmpc.view.energy import energy_figure
from softmpc.view.motion import MOST_POINTS, motion_figure, thinned
from softmpc.view.posture import posture_figure
from softmpc.view.style import COLOURS, DASHES, colour, dash, save_figure, styled
from softmpc.view.tracking import tracking_figure

ARMS = {
    "two sections, hanging": "[effects]\ngravity = [0, 0, 9.81]",
    "one section of four units": "[manipulator]\nsections = 1\n"
    "section_angles_deg = [0, 90, 180, 270]\n[actuation]\nkind = 'static'",
    "planar, no gravity": "[model]\nstrains = ['epsilon', 'kappa_y']\n"
    "[actuation]\nkind = 'pressure'",
    "five sections of two segments": "[manipulator]\nsections = 5\n[model]\nsegments = 2\n"
    "[effects]\ngravity = [0, 0, -9.81]",
    "one unit": "[manipulator]\nsections = 1\nsection_angles_deg = [0]\n[model]\n"
    "strains = ['kappa_y']",
}
STEPS = 41


@pytest.fixture(scope="module", params=ARMS)
def model(request: pytest.FixtureRequest) -> Model:
    return build(scene_from_dict(tomllib.loads(ARMS[request.param])))


def arm_model(name: str) -> Model:
    return build(scene_from_dict(tomllib.loads(ARMS[name])))


def sway(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """A made-up motion: times (K) and strains (K×n)."""
    time = np.linspace(0, 2, STEPS)
    phase = np.arange(model.strains)
    return time, 0.4 * model.layout.q.scale * np.sin(3 * time[:, None] + phase)


def run_of(model: Model, far: bool = False) -> TrackResult:
    """A made-up closed loop along `sway`, its start far from the reference if asked."""
    time, q = sway(model)
    tips = np.stack([np.asarray(model.frames(one)[0]).T for one in q])
    control = time[:-1:2]
    rng = np.random.default_rng(0)
    gap = 1e-4 * rng.standard_normal((STEPS, 3)) + (0.02 * np.exp(-9 * time)[:, None] if far else 0)
    layout = model.layout
    return TrackResult(
        title="Made up at 5 $ or 6 $",
        status="finished",
        settle=1.0,
        time=time,
        tips=tips,
        reference=tips[:, -1] + gap,
        q=q,
        dq=0 * q,
        p=np.abs(rng.standard_normal((STEPS, len(layout.p)))) * 2e5,
        control_time=control,
        u=np.abs(rng.standard_normal((len(control), len(layout.u)))) * 0.4 * layout.u.scale,
        step_ms=20 + rng.random(len(control)),
        iterations=np.full(len(control), 4),
        statuses=["solved"] * len(control),
        names=(layout.q.names, layout.u.names, layout.p.names),
    )


def motion_of(
    model: Model, q: np.ndarray | None = None, time: np.ndarray | None = None
) -> Simulation:
    """A made-up simulation along `sway`."""
    when, where = sway(model)
    time, q = (when if time is None else time), (where if q is None else q)
    tips = np.stack([np.asarray(model.frames(one)[0]).T for one in q])
    speeds = np.linalg.norm(tips - tips[0], axis=2)
    none = {name: np.zeros((len(q), len(getattr(model.layout, name)))) for name in "zup"}
    about = {"title": "Made up", "status": "finished", "wall_s": 1.0, "titles": titles_of(model)}
    return Simulation(time=time, q=q, dq=0 * q, tips=tips, tip_speeds=speeds, **none, **about)


def check(made: Figure, tmp_path: Path) -> None:
    """Every axes has names with units, letters are large enough and on the page; it is saved."""
    for axes in made.axes:
        labels = [axes.get_xlabel(), axes.get_ylabel()]
        if hasattr(axes, "get_zlabel"):
            labels.append(axes.get_zlabel())
        for text in labels:
            assert re.fullmatch(r"\S.* \(\S+\)", text), text
    path = save_figure(made, tmp_path / "picture.png")
    with Image.open(path) as image:
        assert image.size == pytest.approx(made.get_size_inches() * made.dpi, abs=1)
    assert [item.name for item in tmp_path.iterdir()] == ["picture.png"]
    shown = [text for text in made.findobj(Text) if text.get_text().strip() and text.get_visible()]
    assert min(text.get_fontsize() for text in shown) >= 8
    plain = [text for text in shown if text.axes is None or not hasattr(text.axes, "zaxis")]
    assert all(inside(text, made) for text in plain)


def inside(text: Any, made: Figure) -> bool:
    """Whether a text is not cut off at the edge; ticks beyond the axes are not drawn."""
    box, page = text.get_window_extent(), made.bbox
    if box.width == 0 or text.get_text() in tick_labels(made):
        return True
    return bool(page.x0 <= box.x0 and box.x1 <= page.x1 and page.y0 <= box.y0 and box.y1 <= page.y1)


def tick_labels(made: Figure) -> set[str]:
    axes = made.axes
    return {t.get_text() for one in axes for t in [*one.get_xticklabels(), *one.get_yticklabels()]}


# ---------------------------------------------------------------- every picture of every arm


@pytest.mark.sampled
def test_posture(model: Model, tmp_path: Path) -> None:
    q = sway(model)[1][7]
    made = posture_figure(model, q, "A posture")
    check(made, tmp_path)
    assert made.get_suptitle() == "A posture"
    flat = made.axes[1]
    sections = len(model.scene.manipulator.sections)
    drawn = [line for line in flat.get_lines() if line.get_label().startswith("section ")]
    assert len(drawn) == sections + 1  # and "section tip"
    places = np.asarray(model.centerline(q))
    ends = np.concatenate([line.get_xydata() for line in drawn[:-1]])
    assert ends[-1] == pytest.approx(places[[0, 2], -1])


@pytest.mark.sampled
def test_tips(model: Model, tmp_path: Path) -> None:
    run = run_of(model)
    check(time_plots.tips_figure(run.time, run.tips), tmp_path)
    check(time_plots.tips_figure(run.time, run.tips, run.reference), tmp_path)


def test_tips_with_speeds(tmp_path: Path) -> None:
    run = run_of(arm_model("two sections, hanging"))
    made = time_plots.tips_figure(run.time, run.tips, speeds=np.abs(run.tips[..., 0]))
    check(made, tmp_path)
    assert [axes.get_ylabel() for axes in made.axes] == ["x (m)", "y (m)", "z (m)", "speed (m/s)"]


@pytest.mark.sampled
def test_motion(model: Model, tmp_path: Path) -> None:
    run = motion_of(model)
    made = motion_figure(model, run, "A motion")
    check(made, tmp_path)
    space, plane, curves, speeds = made.axes
    across = 0 if plane.get_xlabel() == "x (m)" else 1
    drawn = {line.get_label(): line.get_xydata() for line in plane.get_lines()}
    np.testing.assert_allclose(drawn["way of the tip"], run.tips[:, -1, [across, 2]])
    ways = [np.array(line.get_data_3d()).T for line in space.get_lines()]
    for tip in run.tips.transpose(1, 0, 2):  # the way of each section's tip is in space
        assert any(way.shape == tip.shape and np.allclose(way, tip) for way in ways)
    assert len(curves.get_lines()) > 0
    assert len(speeds.get_lines()) == run.tips.shape[1]


def test_a_motion_that_stands_still(tmp_path: Path) -> None:
    model = arm_model("two sections, hanging")
    time, q = sway(model)
    check(motion_figure(model, motion_of(model, 0 * q), ""), tmp_path)
    check(motion_figure(model, motion_of(model, q[:1], time[:1]), ""), tmp_path)


def test_long_motions_are_thinned() -> None:
    rows = np.arange(100_000)[:, None]
    few = thinned(rows)
    assert len(few) == MOST_POINTS
    assert (few[0, 0], few[-1, 0]) == (0, 99_999)
    assert thinned(rows[:30]) is not None and len(thinned(rows[:30])) == 30


@pytest.mark.parametrize("missing", [(), ("elastic: the law 'strain' has no energy; take …",)])
def test_energy(tmp_path: Path, missing: tuple[str, ...]) -> None:
    time = np.linspace(0, 1, 50)
    energies = {"kinetic": time**2, "elastic": 3 + time}
    works = {"drive": 2 * time, "material_damping": time**2 - time + 1e-7 * np.sin(time)}
    made = energy_figure(Audit(time, energies, works, missing, 1e-9))
    check(made, tmp_path)
    stored, worked, error = made.axes
    drawn = {line.get_label(): line.get_ydata() for line in stored.get_lines()}
    np.testing.assert_allclose(drawn["elastic"], time)  # the change since the start
    np.testing.assert_allclose(drawn["sum"], time + time**2)
    assert "material damping" in {line.get_label() for line in worked.get_lines()}
    assert error.get_title("left").startswith("no balance: elastic" if missing else "sum of energ")


@pytest.mark.sampled
def test_strains(model: Model, tmp_path: Path) -> None:
    made = time_plots.strains_figure(model, *sway(model))
    check(made, tmp_path)
    assert len(made.axes) == len(model.scene.strains)


@pytest.mark.parametrize(("segments", "names"), [(2, 4), (8, 2)])
def test_strains_name_sections_where_dashes_would_repeat(segments: int, names: int) -> None:
    parts = {"segments": segments, "strains": ["epsilon", "kappa_y"]}
    fine = build(scene_from_dict({"model": parts}))
    made = time_plots.strains_figure(fine, *sway(fine))
    legend = made.axes[0].get_legend()
    assert legend is not None
    assert len({text.get_text() for text in legend.get_texts()}) == names
    assert len(made.axes[0].get_lines()) == 2 * segments


@pytest.mark.sampled
def test_drive(model: Model, tmp_path: Path) -> None:
    run = run_of(model)
    made = time_plots.inputs_figure(model, run.control_time, run.u, run.p[:-1:2])
    check(made, tmp_path)
    assert len(made.axes) == (1 if model.scene.actuation.input == "pressure" else 2)
    high = model.scene.manipulator.limits.pressure_max / 1e6
    assert made.axes[-1].get_ylim()[1] > high  # the limits are on the picture


def test_solve_times(tmp_path: Path) -> None:
    time = np.linspace(0, 1, 30)
    for budget in (None, 50.0):
        check(time_plots.solve_times_figure(time, 20 + time, budget), tmp_path)


def test_errors(tmp_path: Path) -> None:
    time = np.linspace(0, 1, 30)
    for sections in (1, 2):
        errors = np.outer(time, np.arange(1, sections + 1))
        check(time_plots.errors_figure(time, errors), tmp_path)


@pytest.mark.sampled
@pytest.mark.parametrize("far", [False, True])
def test_tracking(model: Model, tmp_path: Path, far: bool) -> None:
    made = tracking_figure(model, run_of(model, far))
    check(made, tmp_path)
    assert "mm RMS after 1 s" in made.get_suptitle()
    error = next(axes for axes in made.axes if axes.get_ylabel() == "tip error (mm)")
    assert error.get_yscale() == ("log" if far else "linear")


def test_tracking_before_the_error_counts(tmp_path: Path) -> None:
    model = arm_model("planar, no gravity")
    run = run_of(model)
    short = {name: getattr(run, name)[:5] for name in ("time", "tips", "reference", "q", "p")}
    steps = {name: getattr(run, name)[:2] for name in ("control_time", "u", "step_ms", "statuses")}
    made = tracking_figure(model, TrackResult(**{**vars(run), **short, **steps}))
    check(made, tmp_path)
    assert "RMS" not in made.get_suptitle()


# ---------------------------------------------------------------- the arm in space


def test_sections_of_the_centre_line(model: Model) -> None:
    arm, q = Arm(model), sway(model)[1][5]
    lines = arm.sections(q)
    tips, rotations = (np.asarray(value) for value in model.frames(q))
    for i, line in enumerate(lines):
        assert line[-1] == pytest.approx(tips[:, i])
        assert arm.rotations(q)[i] == pytest.approx(rotations[:, 3 * i : 3 * i + 3])
    assert all(a[-1] == pytest.approx(b[0]) for a, b in pairwise(lines))


@pytest.mark.parametrize(
    ("name", "down"), [("two sections, hanging", True), ("planar, no gravity", False)]
)
def test_a_hanging_arm_hangs(name: str, down: bool) -> None:
    model = arm_model(name)
    space: Any
    space, front, _ = posture_figure(model, np.zeros(model.strains)).axes
    assert falls(space.get_zlim()) == falls(front.get_ylim()) == down
    assert falls(space.get_ylim()) == down  # turned, not mirrored


def falls(limits: tuple[float, float]) -> bool:
    return bool(limits[0] > limits[1])


def test_boxes_are_never_flat() -> None:
    line = np.array([[0, 0, 0], [0, 0, 1.0], [np.nan, 9, 9]])
    low, high = box_of(line, margin=0.1)
    assert low[2] == pytest.approx(-0.1)
    assert (high - low).min() >= 0.4 * (high - low).max() - 1e-12


# ---------------------------------------------------------------- animation


def test_animation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation.shutil, "which", lambda name: None)
    model, seen = arm_model("two sections, hanging"), []
    run = run_of(model)
    target, title = (
        tmp_path / "sway.gif",
        "A title of more than fifty letters, which no picture holds",
    )
    written = animation.animate(
        model, run.time, run.q, target, run.reference, title, lambda *done: seen.append(done)
    )
    assert written == [target]
    assert [item.name for item in tmp_path.iterdir()] == ["sway.gif"]
    assert seen[-1] == (26, 26)
    with Image.open(target) as film:
        assert (film.size, film.n_frames) == ((480, 480), 26)  # type: ignore[attr-defined]
        assert film.info["duration"] == 80
        assert film.convert("RGB").getpixel((2, 470)) == (255, 255, 255)
    assert target.stat().st_size < 3e6 * 26 / 100


def test_long_motions_have_no_more_frames(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animation.shutil, "which", lambda name: None)
    monkeypatch.setattr(animation, "MOST_FRAMES", 5)
    model = arm_model("planar, no gravity")
    time, q = sway(model)
    animation.animate(model, 10 * time, q, tmp_path / "long.gif")
    with Image.open(tmp_path / "long.gif") as film:
        assert film.n_frames == 6  # type: ignore[attr-defined]
        assert film.info["duration"] == 4000


@pytest.mark.skipif(os.name == "nt", reason="stands in for ffmpeg with a shell script")
def test_mp4_where_there_is_ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tool = tmp_path / "bin" / "ffmpeg"
    tool.parent.mkdir()
    tool.write_text('#!/bin/sh\nfor last; do :; done\ncat > "$last"\n')
    tool.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tool.parent}{os.pathsep}{os.environ['PATH']}")
    model = arm_model("one unit")
    time, q = sway(model)
    written = animation.animate(model, time[:5], q[:5], tmp_path / "a.gif")
    assert [path.name for path in written] == ["a.gif", "a.mp4"]
    assert (tmp_path / "a.mp4").stat().st_size == 3 * 480 * 480 * 3


# ---------------------------------------------------------------- style


def test_colours_differ_in_grey_too() -> None:
    grey = [np.dot(to_rgb(colour(i)), (0.299, 0.587, 0.114)) for i in range(len(COLOURS))]
    assert min(abs(a - b) for a, b in pairwise(grey)) > 0.1
    assert len({dash(unit) for unit in range(6)}) == 6  # arms with so many units a section
    assert (colour(0), dash(0)) == (colour(len(COLOURS)), dash(len(DASHES)))


def test_settings_of_the_user_are_left_alone() -> None:
    with mpl.rc_context({"font.size": 3, "axes.labelsize": 3}):
        before = dict(mpl.rcParams)
        made = time_plots.solve_times_figure(np.arange(3.0), np.arange(1.0, 4.0))
        assert dict(mpl.rcParams) == before
    assert made.axes[0].yaxis.label.get_fontsize() == 9


def test_no_pyplot_and_no_display() -> None:
    code = (
        "import sys, numpy as np\n"
        "from softmpc.view.time_plots import tips_figure\n"
        "assert 'matplotlib' not in sys.modules\n"
        "tips_figure(np.arange(3.0), np.zeros((3, 1, 3)))\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    clean = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "MPLBACKEND")}
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, env=clean)


def test_a_crash_leaves_the_last_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made, path = time_plots.errors_figure(np.arange(3.0), np.ones((3, 1))), tmp_path / "a.png"
    save_figure(made, path)
    before = path.read_bytes()

    def crash(self: Figure, target: Path) -> None:
        target.write_bytes(b"half")
        raise RuntimeError("crash")

    monkeypatch.setattr(Figure, "savefig", crash)
    with pytest.raises(RuntimeError):
        save_figure(made, path)
    assert [path.read_bytes(), len(list(tmp_path.iterdir()))] == [before, 1]


def test_what_is_written_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    logging.getLogger("softmpc").setLevel(logging.NOTSET)
    with caplog.at_level(logging.INFO, "softmpc"):
        save_figure(time_plots.errors_figure(np.arange(3.0), np.ones((3, 1))), tmp_path / "a.png")
    assert "a.png" in caplog.text


def test_styled_keeps_names() -> None:
    assert styled(test_styled_keeps_names).__name__ == "test_styled_keeps_names"
