"""Named arms. A preset is frozen: new numbers get a new version, never the old name.

Version 1 is the class defaults, pinned by a test; a later version states what it changes.
"""

from dataclasses import replace
from math import radians
from typing import Any

from softmpc.errors import ParameterError, unknown_name
from softmpc.model.parameters import Manipulator, Section

__all__ = ["DEFAULT_PRESET", "FITTED", "PRESETS", "chen2022", "preset"]


def _section(*angles_deg: float) -> Section:
    return replace(Section(), unit_angles=tuple(radians(angle) for angle in angles_deg))


# The angles of section 2 are turned by 180°, so that equal curvatures bend both sections alike.
CHEN2022_V1 = Manipulator(
    name="chen2022-v1", sections=(_section(0, 120, 240), _section(180, 300, 60))
)

# What a version changes against version 1: (value, source) by path, as `softmpc calibrate` names
# them. Version 2 is what the paper's summary values give, rounded to four digits. A test fits them
# anew with
#     softmpc calibrate examples/calibration/paper_arm.toml examples/calibration/chen2022.toml
_LIMIT = "fitted: not determined; the settling times of Figs 6 and 7 hold with version 1's value"
FITTED: dict[str, dict[str, tuple[float, str]]] = {
    "chen2022-v2": {
        "sections.bending_radius": (
            0.02984,
            "fitted: radii 0.139 m and 0.136 m of 3.1, without gravity; ± 0.00006 m",
        ),
        "sections.linear_damping": (4.5, _LIMIT),
        "sections.angular_damping": (0.002, _LIMIT),
        "sections.viscosity": (1.0e4, _LIMIT),
        "hydraulics.piston_damping": (200.0, _LIMIT),
        "hydraulics.friction": (
            0.0,
            "fitted: at its bound; not told apart from the efficiency but by a prior, 0 ± 100 N",
        ),
        "hydraulics.efficiency": (
            0.5348,
            "fitted: 2.5 N·m for 1 MPa of 3.1, with no friction; ± 0.005",
        ),
    }
}


def _fitted(name: str) -> Manipulator:
    """Version 1 with the fitted numbers of that name."""
    parts: dict[str, dict[str, Any]] = {"sections": {}, "hydraulics": {}}
    for path, (value, _) in FITTED[name].items():
        part, _, field = path.partition(".")
        parts[part][field] = value
    sections = tuple(replace(s, **parts["sections"]) for s in CHEN2022_V1.sections)
    hydraulics = replace(CHEN2022_V1.hydraulics, **parts["hydraulics"])
    return replace(CHEN2022_V1, name=name, sections=sections, hydraulics=hydraulics)


PRESETS = {arm.name: arm for arm in (CHEN2022_V1, *map(_fitted, FITTED))}
DEFAULT_PRESET = CHEN2022_V1.name


def preset(name: str = DEFAULT_PRESET) -> Manipulator:
    """Return the arm of that name."""
    if name not in PRESETS:
        raise ParameterError(unknown_name("preset", name, PRESETS))
    return PRESETS[name]


def chen2022(version: int = 1) -> Manipulator:
    """Return the two-section arm of Chen, Sun, Guo, Gong, Micromachines 2022, 13, 130.

    Version 1 has deduced and assumed values for what the paper does not print; version 2 has them
    from a calibration (`FITTED`).
    """
    return preset(f"chen2022-v{version}")
