"""The monitor in C against that in Python, and what compilers say of it."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import codegen_small as small
import numpy as np
import pytest
from c_monitor import (
    AGREE,
    BACK_OFF,
    BACK_OFF_BIT,
    NAMES,
    PRESSURE,
    REFERENCE,
    SPACES,
    STATUSES,
    TIP,
    CMonitor,
    assert_alike,
    directory,
    model,
    observed,
    space,
    steps,
)
from codegen_small import COMPILERS, SANITIZERS, SINGLE, STRICT, needs

from softmpc.codegen.monitor import Monitor, margins
from softmpc.simulation.validity import reynolds_numbers


@pytest.fixture(scope="module", params=[*SPACES])
def both(request: Any, tmp_path_factory: Any) -> tuple[CMonitor, Monitor]:
    folder = directory(tmp_path_factory.mktemp("monitor") / "c", request.param)
    return CMonitor(folder), Monitor(model(), BACK_OFF, SPACES[request.param]())


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


# ---------------------------------------------------------------- the C, as compilers see it


@pytest.mark.sampled
@pytest.mark.parametrize("precision", ["double", "float"])
@pytest.mark.parametrize("cc", [pytest.param(cc, marks=needs(cc)) for cc in COMPILERS])
def test_no_warnings(cc: str, precision: str, tmp_path: Path) -> None:
    flags = ["-O1", *STRICT, *(SINGLE[cc] if precision == "float" else ())]
    for name, driven in [*((name, True) for name in SPACES), ("none", False)]:
        folder = directory(tmp_path / f"{name} {driven}", name, driven)
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
