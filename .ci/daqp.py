"""Compare the sources of DAQP in softmpc/codegen/c/daqp with its source package, or take them anew.

python .ci/daqp.py            fails where a file differs from the package of the version in VERSION
python .ci/daqp.py --take V   takes those of version V instead
"""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

KEPT = Path(__file__).parents[1] / "softmpc" / "codegen" / "c" / "daqp"
PLACES = {".c": "csrc/src", ".h": "csrc/include", "": "."}  # LICENSE is at the top


def package(version: str, folder: Path) -> Path:
    """The source package of a version, from the package index, unpacked."""
    subprocess.run(
        [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--no-binary", "daqp",
         f"daqp=={version}", "--dest", str(folder)],
        check=True,
    )  # fmt: skip
    (archive,) = folder.glob("daqp-*.tar.gz")
    with tarfile.open(archive) as file:
        file.extractall(folder, filter="data")
    return folder / f"daqp-{version}"


def main() -> None:
    take = sys.argv[1:2] == ["--take"]
    version = sys.argv[2] if take else (KEPT / "VERSION").read_text().strip()
    with tempfile.TemporaryDirectory() as scratch:
        theirs = package(version, Path(scratch))
        names = sorted(path.name for path in KEPT.iterdir() if path.name != "VERSION")
        found = {name: theirs / PLACES[Path(name).suffix] / name for name in names}
        if take:
            for name, path in found.items():
                (KEPT / name).write_bytes(path.read_bytes())
            (KEPT / "VERSION").write_text(f"{version}\n")
            return
        other = [
            name for name, path in found.items() if path.read_bytes() != (KEPT / name).read_bytes()
        ]
    if other:
        sys.exit(f"{KEPT}: {', '.join(other)}: not as in daqp {version}")
    print(f"{len(names)} files as in the source package of daqp {version}")


if __name__ == "__main__":
    main()
