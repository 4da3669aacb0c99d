"""The monitor in C against that in Python, and both against what other rooms say."""

from __future__ import annotations

import ctypes
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import codegen_small as small
import numpy as np
import pytest
from arms import PAPER, arm
from codegen_small import COMPILERS, SANITIZERS, SINGLE, STRICT, needs
from scipy.spatial import cKDTree

from softmpc.codegen.monitor import Monitor, Observed, margins
from softmpc.codegen.monitor_data import monitor_files
from softmpc.control.step import FAILED, INPUT_NOT_FINITE, ITERATION_CAP, SOLVED, Step
from softmpc.errors import InputError
from softmpc.model.actuation import PressureDrive
from softmpc.model.model import Model, build
from softmpc.model.scene import Scene
from softmpc.rig.rigging import _back_off
from softmpc.simulation.validity import LAMINAR, reynolds_numbers
from softmpc.statics.workspace import find_workspace
from softmpc.statics.workspace_result import Surface, Workspace

PROBE = Path(__file__).parent / "codegen_c" / "monitor_probe.c"
GRID = {"azimuths": 6, "polars": 5, "samples": 100}
BACK_OFF = 0.05
TIP, REFERENCE, PRESSURE, BACK_OFF_BIT, _ = (1 << bit for bit in range(5))
NAMES = ("tip_margin", "reference_margin", "pressure_room", "back_off", "reynolds")
STATUSES = ("solved", "iteration cap", "budget overrun", "input not finite", "failed")
QP = ("not asked", "optimal", "not optimal", "infeasible")
AGREE = 1e-10


def model() -> Model:
    return small.transcription().model


@cache
def space() -> Workspace:
    return find_workspace(model(), executor=1, **GRID)


def reshaped(**parts: Any) -> Workspace:
    """The same places under other surfaces."""
    outer, inner = parts.pop("outer"), parts.pop("inner")
    old = space().outer
    assert old is not None
    sides = {
        name: Surface(radii, old.tips, old.pressures, old.q, old.smallest_stiffness, old.flags)
        for name, radii in (("outer", outer), ("inner", inner))
    }
    return replace(space(), **sides, **parts)


@cache
def tilted() -> Workspace:
    """Around another axis that is out of reach, at uneven azimuths, with gaps."""
    random = np.random.default_rng(5)
    frame = np.linalg.qr(random.normal(size=(3, 3)))[0]
    outer = random.uniform(0.3, 0.4, (5, 5))
    inner = random.uniform(0.1, 0.2, (5, 5))
    outer[:, -1] = inner[:, -1] = 0.25
    rims = np.stack([random.uniform(0.3, 0.5, 5), random.uniform(1.5, 2.5, 5)], 1)
    outer[1, 2] = inner[1, 2] = outer[3] = inner[3] = rims[3] = np.nan
    azimuths = np.array([-0.2, 0.9, 2.2, 3.0, 5.1])
    return reshaped(frame=frame, azimuths=azimuths, rims=rims, outer=outer, inner=inner)


@cache
def flat() -> Workspace:
    """Two half-planes."""
    random = np.random.default_rng(6)
    outer, inner = random.uniform(0.3, 0.4, (2, 5)), random.uniform(0.1, 0.2, (2, 5))
    rims, azimuths = np.array([[0.0, 1.1], [0.0, 0.7]]), np.array([0.0, np.pi])
    return reshaped(dimension=2, azimuths=azimuths, rims=rims, outer=outer, inner=inner)


SPACES: dict[str, Callable[[], Workspace | None]] = {
    "an arm": space, "tilted": tilted, "flat": flat, "none": lambda: None
}  # fmt: skip


# ---------------------------------------------------------------- the monitor in C


class CMonitor:
    """A monitor in C, compiled without the controller around it."""

    def __init__(self, folder: Path, single: bool = False) -> None:
        self.real: Any = ctypes.c_float if single else ctypes.c_double
        flags = ["-fPIC", "-O1", f"-I{folder}", *(SINGLE["gcc"] if single else ())]
        files = [*folder.glob("*monitor*.c"), folder / "linear.c", PROBE]
        objects = small.compile_objects(files, folder / "objects", flags)
        library = folder / "monitor.so"
        small.run(["gcc", "-shared", *map(str, objects), "-o", str(library), "-lm"])
        self.library = ctypes.CDLL(str(library))
        self.memory = self._type()()
        self.library.smpc_monitor_memory.restype = ctypes.c_ulong
        assert self.library.smpc_monitor_memory() == ctypes.sizeof(self.memory)
        self.library.smpc_monitor_init(ctypes.byref(self.memory))

    def _type(self) -> type[ctypes.Structure]:
        count, tubes = ctypes.c_uint64, self.real * 3
        ints = [(name, ctypes.c_int) for name in ("known", "iterations", "turbulent")]
        fields = [*ints, *((name, self.real) for name in (*NAMES[:4], "largest")), ("each", tubes)]
        observed = type("Observed", (ctypes.Structure,), {"_fields_": fields})
        counts = ("since_solved", "programs", "iterations")
        all_fields = [
            ("last", observed), ("worst", observed), ("steps", count), ("statuses", count * 5),
            *((name, count) for name in counts), ("mean", self.real),
        ]  # fmt: skip
        return type("Monitor", (ctypes.Structure,), {"_fields_": all_fields})

    def update(self, step: Step, x: Any, u: Any, reference: Any) -> None:
        status = STATUSES.index(step.status.split(":")[0])
        report = (ctypes.c_int * 3)(status, QP.index(step.qp), step.iterations)
        given = [self._given(value) for value in (reference, x, u)]
        self.library.probe(ctypes.byref(self.memory), report, *given)

    def margin(self, place: Any) -> float:
        """NaN where it is not known."""
        found = self.real()
        known = self.library.smpc_margin(self._given(place), ctypes.byref(found))
        return float(found.value) if known else float("nan")

    def _given(self, value: Any) -> Any:
        return (self.real * len(value))(*np.asarray(value, float))


def observed(part: Any) -> Observed:
    """What the struct says, as in Python."""
    values = [part.tip_margin, part.reference_margin, part.pressure_room, part.back_off]
    values.append(part.largest)
    known = {
        name: float(value) if part.known & 1 << bit else None
        for bit, (name, value) in enumerate(zip(NAMES, values, strict=True))
    }
    assert part.known < 32
    assert all(value == 0 for value, of in zip(values, known.values(), strict=True) if of is None)
    return Observed(**known, iterations=part.iterations)


def assert_alike(one: Observed, two: Observed, within: float = AGREE) -> None:
    for name in NAMES:
        found, wanted = getattr(one, name), getattr(two, name)
        assert (found is None) == (wanted is None), name
        if wanted is not None:
            full = LAMINAR if name == "reynolds" else 1.0
            assert abs(found - wanted) <= within * max(full, abs(wanted)), name
    assert one.iterations == two.iterations and one.turbulent == two.turbulent


def directory(into: Path, name: str, of: Model | None = None, back_off: float = BACK_OFF) -> Path:
    """A generated directory with the monitor for one of the workspaces, or for another model."""
    shutil.copytree(
        small.folder(), into, ignore=lambda _, names: [n for n in names if "monitor" in n]
    )
    for file, text in monitor_files(of or model(), {"tip": 3}, back_off, SPACES[name]()).items():
        (into / file).write_text(text)
    return into


@pytest.fixture(scope="module", params=[*SPACES])
def both(request: Any, tmp_path_factory: Any) -> tuple[CMonitor, Monitor]:
    folder = directory(tmp_path_factory.mktemp("monitor") / "c", request.param)
    return CMonitor(folder), Monitor(model(), BACK_OFF, SPACES[request.param]())


@cache
def steps() -> list[tuple[Step, np.ndarray, np.ndarray, np.ndarray]]:
    """Steps of a closed loop, then states of all sizes; statuses and iterations at random."""
    random = np.random.default_rng(1)
    given, inputs = small.closed_loop(30)
    layout = model().layout
    size = len(layout.x)
    cases = [(row[-size:], u, row[:3]) for row, u in zip(given, inputs, strict=True)]
    for _ in range(200):
        x = random.normal(size=size) * layout.x.scale * random.uniform(0, 0.7)
        cases.append((x, random.uniform(0, 2, 3), random.normal(size=3) * 0.25))
    found = []
    for x, u, reference in cases:
        status = random.choice([SOLVED] * 3 + [ITERATION_CAP, INPUT_NOT_FINITE, f"{FAILED}: QP"])
        qp = "not asked" if status == INPUT_NOT_FINITE else "optimal"
        iterations = 0 if qp == "not asked" else int(random.integers(1, 100))
        step = Step(u, str(status), "solution", 0.0, 0.0, iterations=iterations, qp=qp)
        found.append((step, x, u, reference))
    return found


# ---------------------------------------------------------------- C and Python


@needs("gcc")
def test_what_is_seen_is_the_same_in_c(both: tuple[CMonitor, Monitor]) -> None:
    c, python = both
    seen = []
    for step, x, u, reference in steps():
        c.update(step, x, u, reference)
        seen.append(python.update(step, x, u, reference))
        assert_alike(observed(c.memory.last), python.last)
        assert_alike(observed(c.memory.worst), python.worst)
        numbers = reynolds_numbers(model(), x[2 * model().strains :])[0]
        np.testing.assert_allclose([*c.memory.last.each], numbers, rtol=AGREE)
        assert c.memory.since_solved == python.since_solved
    assert [*c.memory.statuses] == [python.statuses.get(name, 0) for name in STATUSES]
    assert (c.memory.steps, c.memory.programs) == (python.steps, python.programs)
    assert c.memory.iterations == python.iterations
    assert c.memory.mean == pytest.approx(python.mean_iterations, rel=AGREE)
    assert python.worst.turbulent and python.worst.reynolds == max(o.reynolds for o in seen)
    assert not all(one.turbulent for one in seen)
    assert python.worst.back_off == max(o.back_off for o in seen) > 1
    if python.workspace is not None:
        inside = [o.tip_margin > 0 for o in seen]
        assert any(inside) and not all(inside)
        assert python.worst.reference_margin == min(o.reference_margin for o in seen) < 0


@needs("gcc")
def test_margins_are_the_same_in_c(both: tuple[CMonitor, Monitor]) -> None:
    c, python = both
    random = np.random.default_rng(2)
    places = random.normal(size=(2000, 3)) * 0.2
    places = np.concatenate([places, space().samples.tips, np.eye(3), -np.eye(3), np.zeros((1, 3))])
    shell = python.workspace.shell if python.workspace else None
    if shell is not None:
        nodes = shell.directions() * shell.outer[..., None] * random.uniform(0.4, 1.1, (1, 5, 1))
        places = np.concatenate([places, nodes.reshape(-1, 3)])
        if shell.flat:
            places = np.concatenate([places, places * [1, 0, 1]])
    found = np.array([c.margin(place) for place in places])
    if shell is None:
        assert np.isnan(found).all()
        return
    wanted = margins(shell, places)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=AGREE)
    good = np.isfinite(wanted)
    assert (found[good] > 0).sum() > 20 and (found[good] < 0).sum() > 20
    np.testing.assert_array_equal(found[good] < 0, shell.outside(places[good]) > 0)


@needs("gcc")
def test_float_keeps_four_digits(tmp_path: Path) -> None:
    c = CMonitor(directory(tmp_path / "c", "an arm"), single=True)
    python = Monitor(model(), BACK_OFF, space())
    for step, x, u, reference in steps():
        c.update(step, x, u, reference)
        python.update(step, x, u, reference)
        assert_alike(observed(c.memory.last), python.last, 1e-4)
    assert_alike(observed(c.memory.worst), python.worst, 1e-4)


# ---------------------------------------------------------------- against other rooms


def test_margins_are_distances_to_the_surfaces() -> None:
    """Against the nearest of very many places on the edge, in all directions."""
    shell = space().shell
    assert shell is not None
    azimuths = np.linspace(0, 2 * np.pi, 240, endpoint=False)
    rims, *sides = shell.between(azimuths)
    fine = replace(shell, nodes=np.linspace(0, 1, 200))
    edge = [
        fine.places(
            azimuths, rims, np.array([np.interp(fine.nodes, shell.nodes, row) for row in radii])
        )
        for radii in sides
    ]
    random = np.random.default_rng(3)
    tips = space().samples.tips
    places = tips[random.integers(0, len(tips), 3000)] + random.normal(size=(3000, 3)) * 0.02
    found, (away, _) = margins(shell, places), cKDTree(np.reshape(edge, (-1, 3))).query(places)
    for sign in (1, -1):
        some = sign * found > 3e-3
        ratio = sign * found[some] / away[some]
        print(f"{sign:+d}: {some.sum()} places, ratio {np.quantile(ratio, [0, 0.5, 0.95, 1])}")
        assert some.sum() > 300 and abs(np.median(ratio) - 1) < 0.05
        assert np.quantile(ratio, 0.05) > 0.9 and np.quantile(ratio, 0.95) < 1.2


def test_the_axis_is_an_edge_only_where_it_is_out_of_reach() -> None:
    on_axis = margins(space().shell, [[0.0, 0.0, 0.33]])[0]
    assert on_axis == pytest.approx(min(0.41693999 - 0.33, 0.33 - 0.25048537), abs=1e-7)
    assert margins(tilted().shell, 0.25 * tilted().frame[:, 2])[0] < -0.05


def test_back_off_is_that_of_a_rig() -> None:
    pressures = np.random.default_rng(4).uniform(-0.02e6, 1.02e6, (50, 3))
    settings = SimpleNamespace(back_off=BACK_OFF, strains=())
    setup = SimpleNamespace(
        task=SimpleNamespace(controller=settings), plant=SimpleNamespace(model=model())
    )
    monitor, none = Monitor(model(), BACK_OFF), Monitor(model())
    drive, n = model().drive, model().strains
    for p in pressures:
        u = np.linalg.solve(drive.static_gain, p)
        x = np.concatenate([np.zeros(2 * n), drive.at_rest(u)])
        monitor.update(steps()[0][0], x, u)
        none.update(steps()[0][0], x, u)
    track: Any = SimpleNamespace(p=pressures, names=([],), q=np.zeros((50, 0)))
    wanted = _back_off(SimpleNamespace(setup=setup), track)["pressure"]
    assert monitor.worst.back_off == pytest.approx(wanted, rel=1e-9) and wanted > 1
    assert none.worst.back_off is None
    over = max(-pressures.min(), pressures.max() - 1e6) / 1e6
    assert none.worst.pressure_room == pytest.approx(-over, rel=1e-9)


# ---------------------------------------------------------------- what is not known


@needs("gcc")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300])
def test_what_is_not_finite_is_not_known(both: tuple[CMonitor, Monitor], value: float) -> None:
    c, python = both
    step, x, u, reference = steps()[0]
    c.library.smpc_monitor_init(ctypes.byref(c.memory))
    c.update(step, x, u, reference)
    before, has_shell = observed(c.memory.worst), python.workspace is not None
    for i in range(len(x)):
        spoilt = np.where(np.arange(len(x)) == i, value, x)
        c.update(step, spoilt, u, reference)
        python.update(step, spoilt, u, reference)
        assert_all_finite(c)
        if not np.isfinite(value):
            assert_alike(observed(c.memory.last), python.last)
            assert c.memory.last.known == (REFERENCE if has_shell else 0)
    c.update(step, x, np.full(3, value), np.full(3, value))
    assert_all_finite(c)
    if not np.isfinite(value):
        assert not c.memory.last.known & (PRESSURE | BACK_OFF_BIT | REFERENCE)
        assert bool(c.memory.last.known & TIP) == has_shell
        assert_alike(observed(c.memory.worst), before)


def assert_all_finite(c: CMonitor) -> None:
    for part in (c.memory.last, c.memory.worst):
        values = [getattr(part, name) for name in NAMES[:4]]
        assert np.isfinite([*values, part.largest, *part.each]).all()


def test_what_the_drive_has_not_costs_nothing() -> None:
    other = build(Scene(arm(PAPER.sections[0]), actuation=PressureDrive()))
    files = monitor_files(other, {"axis": 3})
    assert "model_monitor_reynolds.c" not in files and "model_monitor_tip_now.c" not in files
    assert "#define SMPC_TUBES 0 " in files["monitor_data.h"]
    assert "#define SMPC_TIP_REFERENCE -1 " in files["monitor_data.h"]
    assert "reach" not in files["monitor_data.c"]
    layout = other.layout
    seen = Monitor(other).update(steps()[0][0], 0 * layout.x.scale, 0.25 * layout.p.scale)
    assert seen.reynolds is None and seen.tip_margin is None and seen.back_off is None
    assert seen.pressure_room is not None and not seen.turbulent


# ---------------------------------------------------------------- the C, as compilers see it


@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("cc", [pytest.param(cc, marks=needs(cc)) for cc in COMPILERS])
def test_no_warnings(cc: str, precision: str, tmp_path: Path) -> None:
    flags = ["-O1", *STRICT, *(SINGLE[cc] if precision == "float" else ())]
    pressures = build(Scene(arm(PAPER.sections[0]), actuation=PressureDrive()))
    for name, of in [*((name, None) for name in SPACES), ("none", pressures)]:
        folder = directory(tmp_path / f"{name} {of is None}", name, of)
        files = [folder / "monitor.c", folder / "monitor_data.c"]
        small.compile_objects(files, tmp_path / "objects", flags, cc)


@needs("gcc")
def test_sanitizers_find_nothing(tmp_path: Path) -> None:
    """Places of all sizes, and numbers that are none."""
    folder = directory(tmp_path / "c", "tilted")
    main = tmp_path / "main.c"
    main.write_text(
        '#include "monitor.h"\nint main(void)\n{\n'
        "    static const double sizes[] = {0, 1e-320, 1e-9, 0.3, 1e9, 1e200, 1.7e308, 1.0 / 0.0,"
        " 0.0 / 0.0};\n"
        "    const int count = sizeof sizes / sizeof *sizes;\n    int known = 0;\n"
        "    for (int i = 0; i < 8 * count * count * count; i++) {\n"
        "        const double place[] = {(i & 1 ? -1 : 1) * sizes[i / 8 % count],\n"
        "            (i & 2 ? -1 : 1) * sizes[i / 8 / count % count],\n"
        "            (i & 4 ? -1 : 1) * sizes[i / 8 / count / count]};\n"
        "        double margin;\n        known += smpc_margin(place, &margin);\n"
        "        if (!(margin - margin == 0)) return 1;\n    }\n"
        "    return known > count ? 0 : 2;\n}\n"
    )
    files = [*folder.glob("*monitor*.c"), folder / "linear.c", main]
    flags = ["-O1", *SANITIZERS, f"-I{folder}"]
    objects = small.compile_objects(files, tmp_path / "objects", flags)
    made = tmp_path / "program"
    small.run(["gcc", *SANITIZERS, *map(str, objects), "-o", str(made), "-lm"])
    small.run([str(made)])


# ---------------------------------------------------------------- workspaces of other arms


def other_arm(**parts: Any) -> Model:
    one = arm(PAPER.sections[0])
    limits = replace(one.limits, **parts.pop("limits", {}))
    section = replace(one.sections[0], **parts.pop("section", {}))
    return build(Scene(replace(one, sections=(section,), limits=limits), **parts))


@pytest.mark.parametrize(
    "make, says",
    [
        (lambda: (build(Scene(PAPER)), space()), "end of section 1, this arm's tip is that of"),
        (lambda: (other_arm(section={"unit_angles": (0.0, 2.0)}), space()), "3 units, this one"),
        (lambda: (model(), replace(space(), held={2: 3e5})), "without --hold"),
        (lambda: (model(), replace(space(), outer=None, inner=None)), "no surfaces"),
        (lambda: (other_arm(section={"young_modulus": 2e6}), space()), "rests up to"),
        (lambda: (other_arm(limits={"pressure_max": 0.8e6}), space()), "0 to 0.8 MPa"),
        (
            lambda: (other_arm(limits={"pressure_max": 1.1e6, "torque_max": 9.0}), space()),
            "0 to 1.1 MPa",
        ),
        (
            lambda: (other_arm(limits={"pressure_min": -0.1e6, "torque_min": -1.0}), space()),
            "-0.1 to",
        ),
    ],
)
def test_a_workspace_of_another_arm_is_refused(make: Any, says: str) -> None:
    of, given = make()
    with pytest.raises(InputError, match=says):
        monitor_files(of, {"tip": 3}, 0.0, given)
    with pytest.raises(InputError, match=says):
        Monitor(of, workspace=given)


def test_a_finer_model_of_the_same_arm_is_not() -> None:
    files = monitor_files(other_arm(segments=2), {"tip": 3}, 0.0, space())
    apart = float(re.findall(r"SMPC_REACH_APART (\S+)", files["monitor_data.h"])[0])
    assert 0.005 < apart < 0.0125
    Monitor(other_arm(effects=(*model().scene.effects,)), workspace=space())
