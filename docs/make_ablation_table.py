"""Write the table of the ablation page anew: `python docs/make_ablation_table.py`, some minutes."""

import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parent / "ablation.md"
HEAD = r"(<!-- table -->\n```bash\n(softmpc [^\n]*)\n```\n\n```text\n)"
MARKED = re.compile(HEAD + r".*?(```\n<!-- end -->)", re.DOTALL)

if __name__ == "__main__":
    page = PAGE.read_text(encoding="utf-8")
    found = MARKED.search(page)
    assert found, f"{PAGE} has no table between its marks"
    command = [sys.executable, "-m", "softmpc.cli", *found[2].split()[1:]]
    done = subprocess.run(
        command, cwd=PAGE.parents[1], stdout=subprocess.PIPE, text=True, check=True
    )
    PAGE.write_text(MARKED.sub(lambda m: m[1] + done.stdout + m[3], page), encoding="utf-8")
    print(PAGE)
