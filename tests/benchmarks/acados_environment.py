"""An environment of its own for acados, whose wheel brings a CasADi that would hide ours."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import casadi as ca

from softmpc import library_cache
from tests.benchmarks.common import ROOT

__all__ = ["AcadosFailed", "environment", "run_peer"]

WHEEL = "comma-deps-acados==0.2.2.post92"  # acados, HPIPM, BLASFEO (Haswell), its template renderer
NEEDS = f"it needs pip, {WHEEL} (Linux on x86-64), gcc and make"


class AcadosFailed(Exception):
    """Why there is no answer of acados, and what would help."""


def environment() -> Path:
    """Python of an environment with acados and our version of CasADi; made where there is none.

    Raises `AcadosFailed` with a reason.
    """
    python = "{}.{}".format(*sys.version_info[:2])
    name = f"acados-{WHEEL.rpartition('=')[2]}-casadi-{ca.__version__}-python{python}"
    folder = library_cache.folder() / name
    inside, whole = folder / "bin" / "python", folder / "whole"
    if not whole.exists():
        print(f"making an environment for acados in {folder}", file=sys.stderr, flush=True)
        shutil.rmtree(folder, ignore_errors=True)
        _do([sys.executable, "-m", "venv", str(folder)])
        _do([str(inside), "-m", "pip", "install", "--quiet", WHEEL])
        # Its own CasADi is another version, for one version of Python; the files have one place.
        ours = [f"casadi=={ca.__version__}", "--force-reinstall", "--no-deps"]
        _do([str(inside), "-m", "pip", "install", "--quiet", *ours])
        whole.touch()
    return inside


def run_peer(module: str, call: dict[str, Any]) -> Any:
    """What a module prints in that environment as its last line (JSON), given `call` (JSON)."""
    python = environment()
    found = _do([str(python), "-c", "import acados; print(acados.DIR)"]).splitlines()[-1]
    variables = {
        **os.environ,
        "ACADOS_SOURCE_DIR": found,
        "LD_LIBRARY_PATH": f"{found}/lib",
        "ACADOS_PYTHON_INTERFACE_PATH": str(Path(found).parent / "acados_template"),
        "TERA_PATH": f"{found}/bin/t_renderer",
        "PYTHONWARNINGS": "ignore",
    }
    output = _do([str(python), "-m", module], json.dumps(call), variables)
    return json.loads(output.splitlines()[-1])


def _do(command: list[str], given: str = "", variables: dict[str, str] | None = None) -> str:
    done = subprocess.run(
        command, input=given, capture_output=True, text=True, env=variables, cwd=ROOT
    )
    if done.returncode:
        said = "\n".join((done.stdout + done.stderr).splitlines()[-12:])
        raise AcadosFailed(f"{' '.join(command[:6])} failed; {NEEDS}:\n{said}")
    return done.stdout
