"""The page of messages: each that it quotes is provoked here, or at least stands in the source."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from arms import PAPER, model_of
from click.testing import CliRunner
from faq_studies import OF_STUDIES
from pages import ROOT
from test_validity import step

import softmpc
from softmpc.cli import plan as plan_command
from softmpc.cli import track as track_command
from softmpc.cli.main import main
from softmpc.cli.sweep_options import executor_for
from softmpc.codegen.directory import checked_folder
from softmpc.codegen.plant import plant_files
from softmpc.codegen.targets import CORTEX_M7
from softmpc.compiled import _compiled, compiled
from softmpc.control import step as step_words
from softmpc.control import tracking
from softmpc.control.paths import Line, Reference, TimeLaw
from softmpc.control.preflight import Finding, check_reach
from softmpc.control.transcription import require_linear_drive
from softmpc.errors import SoftmpcError
from softmpc.estimation.sensors import SectionTips
from softmpc.model.actuation import FrictionDrive, PressureDrive, StaticDrive
from softmpc.model.formulations import VirtualPower
from softmpc.model.mass import LumpedMass
from softmpc.model.model import Model
from softmpc.model.scene import default_effects
from softmpc.model.scene_file import scene_from_dict
from softmpc.planning.elastic import require_solver
from softmpc.planning.problem import check_times
from softmpc.simulation.cvodes import Cvodes
from softmpc.simulation.inputs import InputProfile, Step
from softmpc.simulation.result_files import read_npz
from softmpc.simulation.system import require_damping
from softmpc.simulation.validity import late_inputs, motion_warnings
from softmpc.statics.rest_limits import rest_limits
from softmpc.sweeps import sweep

PAGE = (ROOT / "docs" / "faq.md").read_text(encoding="utf-8")
QUOTED = re.findall(r"^### `(.+)`$", PAGE, re.MULTILINE)
PACKAGE = Path(softmpc.__file__).parent
ARM = "[effects]\ngravity = [0.0, 0.0, 9.81]\n"


def pieces(quoted: str) -> str:
    """A pattern for a quoted message, whose … is anything."""
    return ".*".join(re.escape(piece.strip()) for piece in quoted.split("…"))


def has(text: str, quoted: str) -> bool:
    return re.search(pieces(quoted), " ".join(text.split())) is not None


# ---------------------------------------------------------------- how messages come about


def of(document: dict[str, Any]) -> Callable[[], object]:
    return lambda: softmpc.build(scene_from_dict(document))


def loading(text: str | None) -> Callable[[], object]:
    def load() -> object:
        if text is not None:
            Path("arm.toml").write_text(text, encoding="utf-8")
        return softmpc.load_scene("arm.toml")

    return load


def command(*words: str) -> Callable[[], object]:
    def call() -> object:
        Path("arm.toml").write_text(ARM, encoding="utf-8")
        return CliRunner().invoke(main, [word.replace("ARM", "arm.toml") for word in words]).output

    return call


def stands(name: str) -> Callable[[str], bool]:
    """Whether a text stands in a module; where provoking it takes long."""
    tree = ast.parse((PACKAGE / name).read_text(encoding="utf-8"))
    texts = [
        "…".join(str(part.value) for part in node.values if isinstance(part, ast.Constant))
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr)
    ]
    texts += [str(n.value) for n in ast.walk(tree) if isinstance(n, ast.Constant)]
    return lambda quoted: any(has(text, quoted) for text in texts)


def warnings_of(m: Model, z: Any, u: Any, q: Any = None) -> str:
    times = np.linspace(0, 0.02, len(z))
    return "\n".join(one.text for one in motion_warnings(m, times, z, u, q))


def fast_flow() -> object:
    m = model_of()
    return warnings_of(m, *step(m, 1.5, 4, np.linspace(0, 0.02, 41)))


def pulled() -> object:
    z = np.zeros((2, 18))
    z[1, [7, 13]] = -120e3
    return warnings_of(model_of(), z, np.zeros((2, 6)))


def short_cylinder() -> object:
    z = np.zeros((2, 18))
    z[1, 6:] = 1e6
    short = replace(PAPER, limits=replace(PAPER.limits, stroke_max=0.02))
    return warnings_of(model_of(manipulator=short), z, np.zeros((2, 6)))


def squeezed() -> object:
    q = np.zeros((2, 8))
    q[1, 4] = -0.7
    return warnings_of(model_of(actuation=StaticDrive()), np.zeros((2, 0)), np.zeros((2, 6)), q)


def without_compiler() -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softmpc.compiled.compiler", lambda: None)
        return compiled(model_of().residual, "require")


def large_function() -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("softmpc.compiled.compiler", lambda: SimpleNamespace())
        return _compiled(model_of().residual, 10)


def wrong_mode() -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOFTMPC_COMPILE", "off")
        return compiled(model_of().residual)


def other_version() -> object:
    np.savez("run.npz", about='{"schema": 99}')
    return read_npz(Path("run.npz"))


def no_piqp() -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("casadi.has_conic", lambda name: False)
        return require_solver()


def others_files() -> object:
    Path("thesis.tex").write_text("years of work", encoding="utf-8")
    return checked_folder(".")


def no_dask() -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "distributed", None)
        with executor_for(None, "tcp://127.0.0.1:1"):
            return None


def other_sweep() -> object:
    sweep(abs, [1, 2], executor=1, keep="kept")
    return sweep(abs, [1, 3], executor=1, keep="kept")


def judged(**result: Any) -> str:
    return str(track_command._judge(SimpleNamespace(**result)))  # type: ignore[arg-type]


def judged_plan(**result: Any) -> str:
    return plan_command._judge(SimpleNamespace(**result))[1]  # type: ignore[arg-type]


def infeasible() -> object:
    found = Finding("reach", 0.0, 1.0, (0.0, 0.0, 0.9), 12.0, "mm")
    return tracking._stop_where_infeasible([found])


def without(*names: str, **slots: Any) -> Model:
    """A model without some of the default effects."""
    return model_of(effects=[one for one in default_effects() if one.name not in names], **slots)


def still(*names: str, **slots: Any) -> Model:
    """A model without inertia, and without damping of the wall and by other names."""
    none = ("inertia", "coriolis", "rotary_inertia", "material_damping")
    return without(*none, *names, **slots)


FREE_TWIST = replace(
    PAPER, sections=tuple(replace(section, angular_damping=0.0) for section in PAPER.sections)
)
RUBBING = replace(PAPER, hydraulics=replace(PAPER.hydraulics, friction=10.0))
PROVOKED: dict[str, Callable[[], object]] = {
    "…: no such file; …": loading(None),
    "…: is not valid TOML: …": loading("[effects\n"),
    "schema = 2: must be 1, the only version known here": of({"schema": 2}),
    "unknown key in [effects]": of({"effects": {"gravty": True}}),
    "[manipulator] young_modulus": of({"manipulator": {"young_modulus": 1.2}}),
    "[track] is missing": command("track", "ARM"),
    "has no table [simulate]": command("simulate", "ARM"),
    "effect 'buoyancy' needs": of({"effects": {"buoyancy": True}}),
    "effect '…' is not in the formulation": of(
        {"model": {"formulation": "newton-euler"}, "effects": {"fluid_drag": True}}
    ),
    "elasticity 'printed' depends": of({"model": {"elasticity": "printed", "segments": 2}}),
    "hydraulics.friction = ": of({"hydraulics": {"friction": 10.0}}),
    "…: is of another version": other_version,
    "… values given": command("statics", "ARM", "--pressure", "0.1,0.2"),
    "unit 1 = 600000 MPa": command("statics", "ARM", "--pressure", "600000,0,0,0,0,0"),
    "this scene's actuation takes pressures": lambda: softmpc.pressures_from_torques(
        model_of(actuation=PressureDrive()), np.zeros(6)
    ),
    "the target is far out of reach": command("inverse", "ARM", "--tip", "120,0,570"),
    "the target is out of reach": command("inverse", "ARM", "--tip", "0.7,0,0.3"),
    "unit …: its limits of pressure": lambda: rest_limits(
        model_of(replace(PAPER, limits=replace(PAPER.limits, torque_min=5.0, torque_max=6.0)))
    ),
    "(34) is laminar": fast_flow,
    "… fell to … kPa": pulled,
    "piston … went to": short_cylinder,
    "…: the wall's law is for small strains": squeezed,
    "the motion ends at t = ": lambda: (
        late_inputs(InputProfile.of(6, [Step(1, 20.0, 0.5)]), 2.0)[0].text
    ),
    "forward dynamics needs the effect": lambda: still().forward_dynamics,
    "forward dynamics needs an invertible M": lambda: (
        without("rotary_inertia", formulation=VirtualPower(mass=LumpedMass())).forward_dynamics
    ),
    "without inertia a simulation": lambda: require_damping(still(manipulator=FREE_TWIST)),
    "CVODES needs": lambda: Cvodes(still()),
    "no C compiler": without_compiler,
    "function '…' has … instructions": large_function,
    "unknown SOFTMPC_COMPILE": wrong_mode,
    "[track]: the path is infeasible": infeasible,
    "the path is out of reach": lambda: check_reach(
        softmpc.InverseStatics(model_of()), far_reference()
    ),
    "… of … steps of the controller failed": lambda: judged(
        status="finished", failures=1, statuses=["solved", "iteration cap"]
    ),
    "this problem carries the drive": lambda: require_linear_drive(
        model_of(RUBBING, actuation=FrictionDrive())
    ),
    "least time chooses": lambda: check_times("time", [1.0], 2.0),
    "least … needs a time": lambda: check_times("effort", [None], None),
    "no motion meets all": lambda: judged_plan(status="infeasible", gives_way=["x"], held_by=[]),
    "plans need the solver": no_piqp,
    "…: rate = ": lambda: SectionTips(rate=300.0),
    "…: holds files that are not": others_files,
    "… not found; on Debian": lambda: replace(CORTEX_M7, compiler="no-such-gcc").missing,
    "the plant in C needs": lambda: plant_files(still("environment_damping"), still()),
    "… cannot be sent to a worker": lambda: sweep(lambda case: case, [1], executor=2),
    "--dask needs Dask": no_dask,
    "holds another sweep": other_sweep,
    **OF_STUDIES,
}
STANDS = {
    "the statics did not converge: out": ("statics/equilibrium.py", "outside the model's range"),
    "the statics did not converge: no con": ("statics/equilibrium.py", "no convergence"),
    "…: no step can be found": ("simulation/runge_kutta.py", None),
    "plant stopped": ("control/closed_loop.py", None),
    "terminal cost: the costs leave": ("control/terminal.py", None),
    "terminal cost: no input": ("control/terminal.py", None),
    "…: the base of the arm": ("planning/scene_table.py", None),
    "the sensors do not tell": ("estimation/observability.py", None),
    "codegen: the solver is": ("codegen/generate.py", None),
    "…: is of another problem": ("codegen/replay_setup.py", None),
    "a script that sweeps needs": ("sweep_processes.py", None),
    "…: its worker was killed": ("sweep_processes.py", None),
    "not timed: the Jacobian of": ("accuracy/rest_cost.py", "minutes for … segments in all"),
    "interrupted": ("cli/main.py", None),
}


def far_reference() -> Any:
    path = Line((0.1, 0.0, 57.0), (0.1, 0.0, 58.0))
    return Reference(path, TimeLaw(2.0, 1.0))


def test_each_quoted_message_has_one_proof() -> None:
    keys = [*PROVOKED, *STANDS]
    proofs = {quoted: [key for key in keys if quoted.startswith(key)] for quoted in QUOTED}
    assert {quoted: found for quoted, found in proofs.items() if len(found) != 1} == {}
    assert {found for (found,) in proofs.values()} == set(keys)


@pytest.mark.sampled
@pytest.mark.parametrize("key", PROVOKED)
def test_message_is_provoked(key: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        said = str(PROVOKED[key]())
    except SoftmpcError as error:
        said = str(error)
    (quoted,) = (quoted for quoted in QUOTED if quoted.startswith(key))
    assert has(said, quoted), said[:500]


@pytest.mark.parametrize("key", STANDS)
def test_message_stands_in_the_source(key: str) -> None:
    name, text = STANDS[key]
    (quoted,) = (quoted for quoted in QUOTED if quoted.startswith(key))
    assert text is None or quoted.endswith(text)
    assert stands(name)(text or quoted)


# ---------------------------------------------------------------- tables


def rows_after(heading: str) -> list[str]:
    """First cells of the table below a heading, without their code marks."""
    part = PAGE.partition(f"### `{heading}")[2].partition("\n### ")[0]
    return re.findall(r"^\| `(.+?)` \|", part, re.MULTILINE)


def test_kinds_of_findings() -> None:
    rows = rows_after("[track]: the path is infeasible")
    assert len(rows) == 8
    for row in rows:
        kind = row.partition(":")[0]
        assert has(Finding(kind, 0.0, 1.0, (0.0, 0.0, 0.9), 12.0, "mm").text, row)
    assert "`--on-infeasible project`" in PAGE
    with pytest.raises(SoftmpcError, match='--on-infeasible project, or on_infeasible = "project"'):
        infeasible()


def test_statuses_of_steps() -> None:
    words = {step_words.ITERATION_CAP, step_words.BUDGET_OVERRUN, step_words.INPUT_NOT_FINITE}
    assert {row.partition(":")[0] for row in rows_after("… of … steps")} == words | {
        step_words.FAILED
    }


def test_other_ends_of_plans() -> None:
    for status in ("not least", "not verified"):
        assert judged_plan(status=status) in " ".join(PAGE.split())
