"""Write the page of the paper's numbers and its pictures: `python docs/make_reproduce.py [FOLDER]`.

Runs what `softmpc reproduce` runs. FOLDER is where the page goes, by default docs.
"""

import io
import sys
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from softmpc.study.reproduce import Reproduction, reproduce
from softmpc.view.paper_figures import FIGURES, paper_figures
from softmpc.view.paper_tables import explained, markdown

DOTS, COLOURS = 90, 64  # keep the files small
HEAD = """\
# The paper's numbers

The command puts every number and figure of the paper beside what the model gives, and says why they
differ; here with the parameters `{parameters}`.

```bash
softmpc reproduce --out results/reproduce
```

It prints the tables of this page, `--json` gives them to programs; `--out` writes them as CSV and
Markdown, and the figures. `--only limit+x,fig6` does some topics only, `--preset` takes other
parameters. `python docs/make_reproduce.py` writes this page.

Columns of the tables, where a topic does not say otherwise:

{readings}

How each equation is read is on [](equations.md). The command fits nothing; where a parameter was
chosen for a printed number, the reason below the table says so. A tip is at rest when it stays
within 2 % of its travel, for as long as it took to come there; the time counts from the end of the
last move of the torques.

What cannot be reproduced: the errors of section 4.3 were measured against a rig, of which no data
were published. Pictures of the paper without numbers are drawn again, in the same order. Dashed is
the paper's formulation as read.
"""


def page(found: Reproduction) -> str:
    """The page, with links to pictures named as `picture` does."""
    readings = "\n".join(f"- **{name}**: {text}" for name, text in explained().items())
    parts = [HEAD.format(parameters=found.parameters, readings=readings).rstrip()]
    for key, text in markdown(found).items():
        parts.append(text)
        shown = [name for name, (topic, *_) in FIGURES.items() if topic == key]
        parts += [f"![{name.replace('fig', 'Fig. ')}](images/{picture(name)})" for name in shown]
    return "\n\n".join(parts) + "\n"


def picture(name: str) -> str:
    """File name of a figure."""
    return f"reproduce_{name}.png"


def save(figure: Figure, path: Path) -> None:
    """A small PNG."""
    whole = io.BytesIO()
    figure.savefig(whole, dpi=DOTS)
    with Image.open(whole) as image:
        image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    print(path)


def main() -> None:
    """Write page and pictures."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    (folder / "images").mkdir(parents=True, exist_ok=True)
    found = reproduce()
    for name, figure in paper_figures(found):
        save(figure, folder / "images" / picture(name))
    (folder / "reproduce.md").write_text(page(found), encoding="utf-8")
    print(folder / "reproduce.md")


if __name__ == "__main__":
    main()
