"""Named arms. A preset is frozen: new numbers get a new version, never the old name.

Version 1 is the class defaults, pinned by a test; a later version states what it changes.
"""

from dataclasses import replace
from math import radians

from softmpc.errors import ParameterError, unknown_name
from softmpc.model.parameters import Manipulator, Section

__all__ = ["DEFAULT_PRESET", "PRESETS", "chen2022", "preset"]


def _section(*angles_deg: float) -> Section:
    return replace(Section(), unit_angles=tuple(radians(angle) for angle in angles_deg))


# The angles of section 2 are turned by 180°, so that equal curvatures bend both sections alike.
CHEN2022_V1 = Manipulator(
    name="chen2022-v1", sections=(_section(0, 120, 240), _section(180, 300, 60))
)
PRESETS = {arm.name: arm for arm in (CHEN2022_V1,)}
DEFAULT_PRESET = CHEN2022_V1.name


def preset(name: str = DEFAULT_PRESET) -> Manipulator:
    """Return the arm of that name."""
    if name not in PRESETS:
        raise ParameterError(unknown_name("preset", name, PRESETS))
    return PRESETS[name]


def chen2022(version: int = 1) -> Manipulator:
    """Return the two-section arm of Chen, Sun, Guo, Gong, Micromachines 2022, 13, 130."""
    return preset(f"chen2022-v{version}")
