"""Build wheel and sdist, install each into an empty environment, and use it from elsewhere.

python .ci/installed.py       fails where something is missing
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
IN_SDIST = (
    "tests/test_docs.py", "examples/figure_eight.toml", "docs/conf.py", ".ci/run",
    ".github/workflows/ci.yml", "LICENSE", "THIRD_PARTY_NOTICES.md",
)  # fmt: skip
LICENCES = ("LICENSE", "THIRD_PARTY_NOTICES.md", "softmpc/codegen/c/daqp/LICENSE")
ARM = "schema = 1\n[effects]\ngravity = [0.0, 0.0, 9.81]\n"
PRESSURES = "0.6,0,0,0,0.3,0.3"  # MPa
LOOK = """
import sys
from importlib.metadata import files
from importlib.resources import files as resources

assert resources("softmpc").joinpath("py.typed").is_file()
kept = [str(path).replace(chr(92), "/") for path in files("softmpc")]
missing = set(sys.argv[1:]) - {path.partition(".dist-info/licenses/")[2] for path in kept}
assert not missing, f"no licence files {missing}"
"""


def build(folder: Path) -> tuple[Path, Path]:
    """Wheel and sdist."""
    command = [sys.executable, "-m", "build", "--outdir", str(folder), str(ROOT)]
    subprocess.run(command, check=True)
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, sdist


def check_sdist(sdist: Path) -> None:
    with tarfile.open(sdist) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    missing = [name for name in IN_SDIST if name not in names]
    if missing:
        sys.exit(f"{sdist.name} has no {', '.join(missing)}")


def use(distribution: Path, folder: Path) -> None:
    """Install it into a new environment below a folder: a posture by the command, its licences."""
    environment, work = folder / "environment", folder / "work"
    venv.create(environment, with_pip=True)
    programs = environment / ("Scripts" if os.name == "nt" else "bin")
    work.mkdir()
    (work / "arm.toml").write_text(ARM, encoding="utf-8")

    def run(program: str, *words: str) -> str:
        command = [str(programs / program), *words]
        done = subprocess.run(command, cwd=work, check=True, stdout=subprocess.PIPE)
        return done.stdout.decode("utf-8")

    run("python", "-m", "pip", "install", "--quiet", str(distribution))
    run("softmpc", "--help")
    posture = json.loads(run("softmpc", "statics", "arm.toml", "--pressure", PRESSURES, "--json"))
    assert posture["converged"] is True, posture
    run("python", "-c", LOOK, *LICENCES)
    print(f"{distribution.name}: tip at {posture['tips_m'][-1]} m", flush=True)


def main() -> None:
    with tempfile.TemporaryDirectory() as scratch:
        wheel, sdist = build(Path(scratch) / "dist")
        check_sdist(sdist)
        for kind, distribution in (("wheel", wheel), ("sdist", sdist)):
            folder = Path(scratch) / kind
            folder.mkdir()
            use(distribution, folder)


if __name__ == "__main__":
    main()
