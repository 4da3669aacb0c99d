"""The estimator in C: it finds what the one in Python finds, and stays on its feet."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

import softmpc.estimation.estimator as filtering
from softmpc import InputError, Scene, chen2022
from softmpc.codegen.estimator_data import Window
from softmpc.codegen.estimator_tips import tip_rows
from softmpc.control.tracking import read_track_file
from softmpc.estimation.estimator import Estimate
from softmpc.estimation.sensing import Sample
from softmpc.estimation.sensors import (
    CylinderPressures,
    MotorTorque,
    PistonSpeed,
    Reading,
    SectionTips,
    Sensor,
    UnitPressures,
)
from softmpc.model.actuation import PressureDrive
from softmpc.model.model import Model
from softmpc.rig.faults import Absent, Frozen, NotANumber, Spike
from tests.c_estimator import (
    C_SOURCES,
    COMPILER,
    OF_FLOAT,
    OWN,
    STEP,
    STRICT,
    Case,
    CEstimator,
    Told,
    built,
    case_of,
    recorded,
    same,
)

pytestmark = pytest.mark.skipif(COMPILER is None, reason="needs gcc or clang")
WINDOW = Window(STEP, late=2 * STEP)
SENSORS = (
    SectionTips(latency=0.010, dropout=0.1),
    UnitPressures(rate=50.0, latency=0.004, dropout=0.05),
)
FAULTS = (
    NotANumber(0.30, 0.1, "unit_pressures"), Frozen(0.50, 0.15), Absent(0.80, 0.2),
    Spike(1.10, 0.1, "section_tips", 0.2), Spike(1.40, 0.1, "section_tips", 0.02),
    Spike(1.60, 0.15, "unit_pressures", 8e4),
)  # fmt: skip


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Of the scene of the example, its sensors late and unreliable."""
    scene = read_track_file(Path("examples/figure_eight_rig.toml"))[1]
    return case_of(tmp_path_factory.mktemp("filter"), scene, SENSORS, WINDOW)


@pytest.fixture(scope="module")
def record(case: Case) -> list[Told]:
    """With every fault; some readings come late, in another order, or twice."""
    told = recorded(case.python.model, SENSORS, FAULTS, 80)
    random = np.random.default_rng(4)
    for one, after in reversed([*pairwise(told)]):
        late = [sample for sample in one.samples if random.random() < 0.1]
        twice = [sample for sample in one.samples if random.random() < 0.05]
        one.samples[:] = [sample for sample in one.samples if sample not in late]
        after.samples[:0] = twice
        after.samples.extend(late)
    return told


# ---------------------------------------------------------------- against Python


def test_faulty_late_and_lost_readings(case: Case, record: list[Told]) -> None:
    """State and covariance to 1e-8; whether each reading counted, and when it was the last."""
    state, covariance = same(case, record)
    assert state < 1e-8 and covariance < 1e-8
    reasons = sum(case.c.reasons(), Counter())
    assert set(reasons) >= {"not finite", "frozen", "after a jump", "too far", "twice"}
    assert case.c.contradicted > 0


def test_readings_later_than_it_remembers(
    case: Case, record: list[Told], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They are left out, as in Python with the same memory."""
    told = [replace(one, samples=list(one.samples)) for one in record]
    for k in range(0, len(told) - 3, 4):
        told[k + 3].samples.extend(told[k].samples)
        told[k].samples.clear()
    monkeypatch.setattr(filtering, "MEMORY", WINDOW.memory(case.python))
    state, covariance = same(case, told)
    assert state < 1e-8 and covariance < 1e-8
    assert sum(case.c.reasons(), Counter())["too late"] > 10


@pytest.mark.parametrize(
    ("name", "scene", "sensors"),
    [
        ("pressures", Scene(chen2022(), actuation=PressureDrive()), [SectionTips(latency=0.01)]),
        pytest.param(
            "all sensors", Scene(chen2022()),
            [MotorTorque(200.0), SectionTips(), CylinderPressures(50.0), PistonSpeed(),
             UnitPressures(latency=0.003)],
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "two segments", Scene(chen2022(), segments=2), [SectionTips(), UnitPressures()],
            marks=pytest.mark.slow,
        ),
    ],
)  # fmt: skip
def test_other_scenes(name: str, scene: Scene, sensors: list[Sensor], tmp_path: Path) -> None:
    case = case_of(tmp_path, scene, sensors, Window(STEP))
    state, covariance = same(case, recorded(case.python.model, sensors, (), 20))
    assert state < 1e-8 and covariance < 1e-8


def test_the_order_of_arrival_does_not_matter(case: Case, record: list[Told]) -> None:
    """Readings of a step in any order: the same numbers to the last bit."""
    found = []
    for turn in (1, -1):
        case.c.reset(case.start.x, case.start.u)
        for one in record[:12]:
            case.c.receive(one.tick, one.samples[::turn])
            found.append(case.c.estimate(one.tick))
            case.c.applied(one.u, one.tick)
    for one, other in zip(found[:12], found[12:], strict=True):
        assert isinstance(one, Estimate) and isinstance(other, Estimate)
        assert np.array_equal(one.x, other.x) and np.array_equal(one.P, other.P)


def test_the_drive_goes_exactly(case: Case) -> None:
    """Pressures after any length of step, without an arm: against SciPy's matrix exponential."""
    p, drive, c = case.python.process, case.python.model.drive, case.c
    z0, ends = case.start.x[2 * p.n :], 2 * p.n
    u = case.start.u * 1.3
    whole = np.zeros((len(z0) + len(u),) * 2)
    whole[: len(z0)] = np.hstack([drive.A, drive.B])
    scale = p.scale[ends : p.nx]
    for ticks in (1, 2, 3, 7, 13, 20, 21, 33, 50):
        c.reset(case.start.x, u)
        found = c.estimate(ticks)
        assert isinstance(found, Estimate)
        exact = (expm(whole * ticks * 1e-3) @ np.concatenate([z0, u]))[: len(z0)]
        assert np.abs((found.x[ends:] - exact) / scale).max() < 1e-9


def test_single_precision(case: Case, record: list[Told]) -> None:
    """Floats follow doubles to a fraction of what the filter itself does not know."""
    library = built(case.folder, case.sources, "float.so", "-O0", *OF_FLOAT)
    single = CEstimator(library, case.python, np.float32)
    scale, n = case.python.model.layout.x.scale, case.python.process.nx
    case.c.reset(case.start.x, case.start.u)
    single.reset(case.start.x, case.start.u)
    worst = 0.0
    for one in record:
        for each in (case.c, single):
            each.receive(one.tick, one.samples)
        double, found = (each.estimate(one.tick) for each in (case.c, single))
        assert isinstance(double, Estimate) and isinstance(found, Estimate)
        deviations = np.sqrt(np.diag(double.P))
        worst = max(worst, np.abs((found.x - double.x) / scale / deviations[:n]).max())
        worst = max(worst, np.abs((found.d - double.d) / deviations[n:]).max())
        for each in (case.c, single):
            each.applied(one.u, one.tick)
    assert worst < 0.05
    assert single.size < 0.55 * case.c.size


# ---------------------------------------------------------------- what goes wrong


def test_nothing_but_numbers_comes_out(case: Case) -> None:
    """Readings that are not numbers, huge, of other times and sensors; inputs that are none."""
    random, c = np.random.default_rng(6), case.c
    c.reset(case.start.x, case.start.u)
    bad = np.array([np.nan, np.inf, -np.inf, 1e308, -1e200, 5e-324, 0.0, 1.0])
    stamps = [-(2**31), 2**31 - 1, 0]
    for k in range(60):
        tick = STEP * k
        samples = [
            Sample(
                int(random.integers(-2, 4)),
                int(random.choice([tick, tick - 5, *stamps])),
                tick,
                random.choice(bad, 6),
            )
            for _ in range(8)
        ]
        c.receive(tick, samples)
        found = c.estimate(tick)
        assert isinstance(found, Estimate)
        assert all(np.all(np.isfinite(part)) for part in (found.x, found.d, found.P))
        assert c.applied(random.choice(bad, len(case.start.u)), tick) in (0, 6)
        assert c.applied(case.start.u, tick) == 0
    assert c.reset(case.start.x * np.nan, case.start.u) == 6


def test_it_says_what_it_cannot_do(case: Case) -> None:
    c, start = case.c, case.start
    c.memory.raw = bytes(c.size)
    c.receive(0, [Sample(0, 0, 0, np.zeros(6))])
    assert c.estimate(0) == 6  # never reset
    c.reset(start.x, start.u, 100)
    assert c.estimate(99) == 4  # forgotten
    assert isinstance(c.estimate(1100), Estimate)
    assert c.estimate(1101) == 5 and c.ahead(1102) == 3  # too long alone
    assert c.reset(start.x, start.u, 1101) == 0 and isinstance(c.estimate(1150), Estimate)


def test_it_remembers_no_more_than_it_says(case: Case) -> None:
    """However many readings and inputs there are, at any times."""
    c = case.c
    c.reset(case.start.x, case.start.u)
    random = np.random.default_rng(1)
    y = case.python.readings[1](case.start.x, case.start.u)[0]
    for tick in range(200):
        noise = 5e3 * random.standard_normal(len(y))
        c.receive(tick, [Sample(1, tick, tick, y + noise)])
        assert isinstance(c.estimate(tick), Estimate)
        c.applied(case.start.u, tick)
        assert c.knots() <= WINDOW.knots(case.python)


class Bent(UnitPressures):
    """Reads something that is neither linear nor a tip."""

    name = "bent"

    def reading(self, model: Model) -> Reading:
        tips = SectionTips().reading(model)
        return tips


def test_a_sensor_that_is_no_c_is_refused(case: Case) -> None:
    with pytest.raises(InputError, match=r"'bent' cannot be written as C.*section_tips"):
        tip_rows(Bent(), case.python.model)


# ---------------------------------------------------------------- the C itself


@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_without_warnings(name: str, case: Case, tmp_path: Path) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"{name} is not installed")
    data = [case.folder / "estimator_data.c"]
    for more in ((), ("-DSMPC_FLOAT",)):
        for path in [*(C_SOURCES / one for one in OWN if one != "linear.c"), *data]:
            found = subprocess.run(
                [name, *STRICT, *more, f"-I{case.folder}", f"-I{C_SOURCES}", "-c", str(path), "-o",
                 str(tmp_path / "x.o")],
                capture_output=True, text=True,
            )  # fmt: skip
            assert not found.returncode, found.stderr


@pytest.mark.skipif(shutil.which("nm") is None, reason="needs nm")
def test_no_memory_is_allocated_and_no_global_changes(case: Case, tmp_path: Path) -> None:
    """Symbols of the objects: those from elsewhere move memory or work out numbers."""
    mathematics, moves = {"sqrt", "sin", "cos", "sincos", "pow"}, {"memcpy", "memset", "memmove"}
    allowed = mathematics | moves | {"memcmp", "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}
    for path in [*(C_SOURCES / one for one in OWN), case.folder / "estimator_data.c"]:
        target = str(tmp_path / "x.o")
        command = [str(COMPILER), "-std=c99", "-fno-pie", f"-I{case.folder}", f"-I{C_SOURCES}"]
        subprocess.run([*command, "-c", str(path), "-o", target], check=True)
        lines = subprocess.run(["nm", target], capture_output=True, text=True).stdout.splitlines()
        kinds = [(line.split()[-2], line.split()[-1]) for line in lines]
        elsewhere = {name for kind, name in kinds if kind == "U" and not name.startswith("smpc_")}
        assert elsewhere <= allowed, path
        assert not [name for kind, name in kinds if kind in "bBdDC"], path


def test_every_trouble_and_reason_has_a_name(case: Case) -> None:
    names = case.c.library
    names.smpc_trouble_name.restype = names.smpc_reason_name.restype = ctypes.c_char_p
    for name, count in (("trouble", 7), ("reason", 9)):
        said = [getattr(names, f"smpc_{name}_name")(i) for i in range(-1, count + 1)]
        assert said[0] == said[-1] == b"unknown" and len(set(said)) == count + 1
