"""Write the reference page of scene files: `python docs/make_scene_reference.py`."""

from pathlib import Path

from softmpc.model.scene_reference import reference_page

PAGE = Path(__file__).parent / "scene_reference.md"

if __name__ == "__main__":
    PAGE.write_text(reference_page(), encoding="utf-8")
    print(PAGE)
