"""Parameters: the paper's numbers, their ranges, and the messages for wrong ones."""

import math
import subprocess
import sys
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from softmpc.errors import (
    BuildError,
    InputError,
    ParameterError,
    SceneError,
    SoftmpcError,
    nearest,
    unknown_name,
)
from softmpc.model.parameters import Hydraulics, Limits, Manipulator, Section
from softmpc.model.presets import PRESETS, chen2022, preset
from softmpc.model.quantities import SOURCES

CLASSES = (Section, Hydraulics, Limits)


def test_preset_v1_is_frozen() -> None:
    """These numbers may never change: a calibration makes a version 2."""
    arm = chen2022()
    thirds = (0.0, math.radians(120), math.radians(240))
    section = dict(
        length=0.25, young_modulus=1.2e6, shear_modulus=0.4e6, bending_radius=0.0298,
        disc_radius=0.0323, unit_offset=0.0173, unit_area=3.14e-4, wall_area=3.93e-4, mass=0.56,
        unit_angles=thirds, linear_damping=4.5, angular_damping=0.002, viscosity=10000.0,
    )  # fmt: skip
    hydraulics = dict(
        bulk_modulus=2.18e9, piston_area=0.0021, piston_mass=1.2, tube_length=1.61,
        tube_diameter=0.004, water_viscosity=1.01e-3, screw_lead=0.004, efficiency=0.535,
        screw="lead/2pi", piston_damping=200.0, friction=0.0, cylinder_volume=7.35e-4,
        chamber_volume=7.85e-5, water_density=1000.0, friction_velocity=1e-3,
    )  # fmt: skip
    limits = dict(
        pressure_min=0.0, pressure_max=1e6, torque_min=0.0, torque_max=2.5, stroke_max=0.35,
        stretch_min=-0.5, stretch_max=2.0, curvature_max=1e4,
    )  # fmt: skip
    assert arm.name == "chen2022-v1"
    assert vars(arm.sections[0]) == section
    turned = tuple(math.radians(angle) for angle in (180, 300, 60))
    assert vars(arm.sections[1]) == section | {"unit_angles": turned}
    assert vars(arm.hydraulics) == hydraulics
    assert vars(arm.limits) == limits


def test_preset_by_name() -> None:
    assert preset("chen2022-v1") is chen2022(1) is PRESETS["chen2022-v1"]
    with pytest.raises(ParameterError, match=r"'chen2022'; did you mean 'chen2022-v2'\?"):
        preset("chen2022")
    with pytest.raises(ParameterError, match="chen2022-v9"):
        chen2022(9)


def test_derived_properties() -> None:
    arm, section = chen2022(), Section()
    inertia = math.pi * 0.0298**4 / 4
    assert (arm.units, arm.length, section.units) == (6, 0.5, 3)
    assert section.bending_stiffness == pytest.approx(1.2e6 * inertia)
    assert section.torsional_stiffness == pytest.approx(0.4e6 * 2 * inertia)
    assert section.axial_stiffness == pytest.approx(3 * 1.2e6 * 3.93e-4)
    half, height = -0.0173 / 2, 0.0173 * math.sqrt(3) / 2
    expected = [(0.0173, 0.0), (half, height), (half, -height)]
    assert np.allclose(section.unit_positions, expected, atol=1e-15)


def test_inputs_are_stored_as_plain_floats() -> None:
    section = Section(length=1, mass=np.float32(0.5), unit_angles=[0, np.pi])  # type: ignore[arg-type]
    assert type(section.length) is type(section.mass) is float
    assert section.unit_angles == (0.0, math.pi)
    assert hash(replace(chen2022(), sections=[section])) is not None  # type: ignore[arg-type]


def test_ranges_are_wide() -> None:
    Section(mass=1e-3, length=0.001, unit_offset=0.0, unit_angles=(0.0,))
    Section(young_modulus=1e12, shear_modulus=1e12, linear_damping=0.0, viscosity=0.0)
    Hydraulics(bulk_modulus=1e13, efficiency=1.0, piston_damping=0.0)
    Limits(pressure_min=-5e4, torque_min=-2.5)


@pytest.mark.parametrize(
    ("cls", "given", "message"),
    [
        (Section, {"length": -0.25}, r"\.length = -0\.25 m: must be between 0\.001 and 100 m"),
        (Section, {"length": math.nan}, r"Section\.length = nan m"),
        (Section, {"mass": math.inf}, r"Section\.mass = inf kg"),
        (Section, {"mass": 10**400}, r"Section\.mass = inf kg"),
        (Section, {"mass": "heavy"}, r"Section\.mass = 'heavy': must be a number in kg"),
        (Section, {"mass": True}, r"Section\.mass = True: must be a number"),
        (Section, {"mass": None}, r"Section\.mass = None: must be a number"),
        (Section, {"unit_angles": ()}, "at least one"),
        (Section, {"unit_angles": 1.0}, r"unit_angles = 1\.0: must be a list"),
        (Section, {"unit_angles": (0.0, 90.0)}, r"unit_angles\[1\] = 90 rad"),
        (Hydraulics, {"efficiency": 0.0}, "must be above 0 and at most 1"),
        (Hydraulics, {"screw": "lead/pi"}, r"did you mean 'lead/2pi'\? allowed: lead/2pi, lead"),
        (Limits, {"pressure_max": -1.0}, r"pressure_min = 0 Pa: must be at most pressure_max"),
        (Limits, {"torque_min": 2.6}, r"torque_min = 2\.6 N·m: must be at most"),
        (Manipulator, {"name": "", "sections": (Section(),)}, "non-empty text"),
        (Manipulator, {"name": "a", "sections": ()}, "one or more Section"),
        (Manipulator, {"name": "a", "sections": (1,)}, r"sections\[0\] = 1: must be a Section"),
        (Manipulator, vars(chen2022()) | {"limits": None}, "limits = None: must be a Limits"),
    ],
)
def test_wrong_values(cls: type, given: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        cls(**given)


def test_one_tree_of_errors() -> None:
    for kind in (ParameterError, SceneError):
        assert issubclass(kind, InputError)
    assert issubclass(InputError, SoftmpcError) and issubclass(InputError, ValueError)
    assert issubclass(BuildError, SoftmpcError) and not issubclass(BuildError, InputError)


@pytest.mark.parametrize("cls", CLASSES)
def test_every_field_is_documented(cls: type) -> None:
    for item in fields(cls):
        kind, _, explanation = item.metadata["source"].partition(": ")
        assert kind in SOURCES and explanation
        assert item.metadata["doc"]
        assert "range" in item.metadata or "allowed" in item.metadata


def test_names() -> None:
    assert nearest("Secton_length", ["section_length", "mass"]) == "section_length"
    assert nearest("zzz", ["section_length"]) is None
    assert unknown_name("key", "zzz", ["a", "b"]) == "unknown key: 'zzz'; allowed: a, b"


def test_parameters_do_not_load_casadi() -> None:
    """What only reads numbers starts fast."""
    code = (
        "import sys, softmpc.model.presets, softmpc.model.tables, softmpc.model.manipulator_tables;"
        "sys.exit('casadi' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
