"""Scenes and scene files: defaults, round trips, and a clear message for each kind of slip."""

import math
import tomllib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, ClassVar

import pytest

from softmpc.errors import InputError, SceneError
from softmpc.model.actuation import PressureDrive
from softmpc.model.effects import (
    EFFECTS,
    AddedMass,
    Buoyancy,
    Contact,
    Coriolis,
    Effect,
    EnvironmentDamping,
    FluidDrag,
    Gravity,
    Inertia,
    MaterialDamping,
    Payload,
    RotaryInertia,
    TipLoad,
)
from softmpc.model.elasticity import PrintedElasticity, StrainElasticity
from softmpc.model.formulations import NewtonEuler, VirtualPower
from softmpc.model.kinematics import PaperArc
from softmpc.model.mass import GaussMass, LumpedMass
from softmpc.model.obstacles import Box, Cylinder, Plane, Sphere
from softmpc.model.parameters import Hydraulics, Limits, Manipulator, Section
from softmpc.model.presets import chen2022
from softmpc.model.scene import STRAINS, Scene, default_effects
from softmpc.model.scene_file import (
    TABLES,
    load_scene,
    read_document,
    save_scene,
    scene_from_dict,
    scene_to_dict,
    write_document,
)
from softmpc.model.scene_reference import reference_page
from softmpc.model.tables import Table


def scene_of(text: str) -> Scene:
    return scene_from_dict(tomllib.loads(text))


# ---------------------------------------------------------------- scenes


def test_default_scene() -> None:
    scene = Scene(chen2022())
    kinds = [type(effect) for effect in scene.effects]
    assert kinds == [
        Gravity, Inertia, Coriolis, RotaryInertia, EnvironmentDamping, MaterialDamping,
    ]  # fmt: skip
    assert scene.effect(Gravity) == Gravity((0, 0, 9.81))
    assert scene.effect(TipLoad) is None
    assert scene.with_(segments=4).segments == 4


def test_one_order_however_given() -> None:
    given = Scene(
        chen2022(),
        strains=("kappa_y", "epsilon"),
        effects=[TipLoad(), Inertia(), Gravity()],  # type: ignore[arg-type]
    )
    assert given.strains == ("epsilon", "kappa_y")
    assert given.effects == (Gravity(), Inertia(), TipLoad())


def test_no_rotary_inertia_by_default_without_twist() -> None:
    assert Scene(chen2022(), strains=STRAINS[:3]).effect(RotaryInertia) is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"segments": 0}, r"segments = 0: must be a whole number from 1 to 64"),
        ({"segments": 1.5}, "segments = 1.5"),
        ({"segments": True}, "segments = True"),
        ({"strains": ()}, "at least one"),
        ({"strains": ("epsilon", "epsilon")}, "'epsilon' is given twice"),
        ({"strains": ("kapa_x",)}, "did you mean 'kappa_x'"),
        ({"strains": "epsilon"}, "must be some of"),
        ({"effects": (Gravity(), Gravity())}, "'gravity' is given twice"),
        ({"effects": (Inertia, Gravity())}, r"write Inertia\(\)"),
        ({"effects": 3}, "must be a tuple"),
        ({"effects": (Coriolis(),)}, "'coriolis' needs the effect 'inertia'"),
        ({"effects": (RotaryInertia(),)}, "'rotary_inertia' needs the effect 'inertia'"),
        ({"kinematics": PaperArc}, r"write PaperArc\(\)"),
        ({"actuation": "hydraulic"}, "actuation = 'hydraulic'"),
        ({"formulation": NewtonEuler(), "strains": STRAINS[:3]}, "use 'virtual-power'"),
        ({"formulation": NewtonEuler(PrintedElasticity()), "segments": 2}, "allowed for 1 only"),
    ],
)
def test_scene_contradictions(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Scene(chen2022(), **changes)


# ---------------------------------------------------------------- reading


def test_empty_file_is_the_preset_without_gravity() -> None:
    scene = scene_of("")
    expected = [effect for effect in default_effects() if not isinstance(effect, Gravity)]
    assert scene == Scene(chen2022(), effects=tuple(expected))


def test_every_model_key() -> None:
    scene = scene_of("""
        [model]
        segments = 3
        kinematics = "paper-arc"
        mass = "gauss-1"
        elasticity = "strain"
        strains = ["kappa_x", "epsilon"]
        [effects]
        gravity = [0, 0, -9.81]
        environment_damping = false
        [actuation]
        kind = "pressure"
        [load]
        tip_force = [1, 0, 0]
    """)
    assert scene == Scene(
        chen2022(),
        segments=3,
        kinematics=PaperArc(),
        formulation=VirtualPower(GaussMass(1), StrainElasticity()),
        strains=("epsilon", "kappa_x"),
        effects=(
            Gravity((0, 0, -9.81)), Inertia(), Coriolis(), MaterialDamping(), TipLoad((1, 0, 0)),
        ),
        actuation=PressureDrive(),
    )  # fmt: skip


def test_inertia_takes_its_companions_along() -> None:
    effects = scene_of("[effects]\ninertia = false").effects
    assert [effect.name for effect in effects] == ["environment_damping", "material_damping"]


def test_effects_with_parameters() -> None:
    scene = scene_of("""
        [effects]
        gravity = [0, 0, 9.81]
        buoyancy = true
        fluid_drag = {density = 900, normal = 0.8}
        added_mass = false
        payload = {mass = 1}
        [effects.contact]
        stiffness = 2e4
        places = 3
        [[effects.contact.obstacles]]
        kind = "plane"
        point = [0, 0, 0.4]
        [[effects.contact.obstacles]]
        kind = "cylinder"
        radius = 0.2
        side = "inside"
    """)
    walls = Plane((0, 0, 0.4)), Cylinder(radius=0.2, side="inside")
    assert scene.effect(Buoyancy) == Buoyancy(1000)
    assert scene.effect(FluidDrag) == FluidDrag(density=900, normal=0.8)
    assert scene.effect(AddedMass) is None
    assert scene.effect(Payload) == Payload(1.0)
    assert scene.effect(Contact) == Contact(walls, stiffness=2e4, places=3)
    assert scene_from_dict(scene_to_dict(scene)) == scene


def test_effects_beyond_the_paper_are_off() -> None:
    absent = {kind for kind in EFFECTS if not kind.by_default} - {Gravity, TipLoad}
    assert len(absent) >= 6
    assert not absent & {type(effect) for effect in scene_of("").effects}


@pytest.mark.parametrize("mass", ["", 'mass = "lumped"'])
def test_newton_euler_is_lumped(mass: str) -> None:
    scene = scene_of(f'[model]\nformulation = "newton-euler"\n{mass}')
    assert scene.formulation == NewtonEuler()
    assert scene.formulation.mass == LumpedMass()


def test_sections_repeat_those_of_the_preset() -> None:
    arm = scene_of("[manipulator]\nsections = 3\nsection_length = [0.1, 0.2, 0.3]").manipulator
    first, second = chen2022().sections
    assert [section.length for section in arm.sections] == [0.1, 0.2, 0.3]
    assert [s.unit_angles for s in arm.sections] == [
        first.unit_angles, second.unit_angles, first.unit_angles,
    ]  # fmt: skip
    assert arm.name == "chen2022-v1, changed"


def test_angles_for_all_sections_or_for_each() -> None:
    same = scene_of("[manipulator]\nsection_angles_deg = [0, 90, 180, 270]").manipulator
    assert [section.units for section in same.sections] == [4, 4]
    each = scene_of("[manipulator]\nsection_angles_deg = [[0], [90, 270]]").manipulator
    assert [section.units for section in each.sections] == [1, 2]
    assert each.sections[1].unit_angles == (math.radians(90), math.radians(270))


def test_drive_and_limits() -> None:
    text = '[hydraulics]\nscrew = "lead"\nefficiency = 0.9\n[limits]\npressure_max = 5e5'
    arm = scene_of(text).manipulator
    assert arm.hydraulics == Hydraulics(screw="lead", efficiency=0.9)
    assert arm.limits == Limits(pressure_max=5e5)


def test_other_tables_stay_raw(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text('title = "x"\n[track]\nanything = 1\n[simulate]\nelse = [2]\n')
    document = read_document(path)
    assert document["track"] == {"anything": 1}
    assert scene_from_dict(document) == load_scene(path) == scene_of("")


# ---------------------------------------------------------------- round trips

ODD_ARM = Manipulator(
    name="mine",
    sections=(
        Section(length=0.1, unit_angles=(0.0,)),
        Section(mass=0.001, unit_angles=tuple(math.radians(a) for a in (17.3, -90, 1 / 3))),
        Section(young_modulus=1e9),
    ),
    hydraulics=Hydraulics(screw="lead", friction=3.0),
    limits=Limits(torque_min=-1.0),
)


@pytest.mark.parametrize(
    "scene",
    [
        Scene(chen2022()),
        Scene(ODD_ARM, segments=4, kinematics=PaperArc(), strains=("epsilon", "kappa_y")),
        Scene(chen2022(), formulation=NewtonEuler(PrintedElasticity()), effects=()),
        Scene(
            replace(chen2022(), limits=Limits(torque_max=1.0)),
            formulation=VirtualPower(LumpedMass()),
            effects=(Gravity((1.5, 0, -9.81)), TipLoad((0.1, 0, 0), (0, 0, 1e-3))),
            actuation=PressureDrive(),
        ),
        Scene(
            chen2022(),
            effects=(
                Gravity(),
                *(kind() for kind in EFFECTS if kind not in (Gravity, Contact)),
                Contact(
                    (
                        Plane((1, 0, 0), (1, 2, 3)),
                        Cylinder(axis=(0.3, 0, 7)),
                        Cylinder(length=0.3),
                        Sphere((0.1, 0, 0.2), 0.07, "inside"),
                        Box(size=(0.1, 0.2, 0.3), rotation=(0, 30, 0)),
                    ),
                    damping=0.2,
                ),
            ),
        ),
    ],
)
def test_round_trip(scene: Scene, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    save_scene(scene, path)
    assert load_scene(path) == scene
    assert [item.name for item in tmp_path.iterdir()] == ["scene.toml"]


def test_toml_of_the_preset() -> None:
    table = scene_to_dict(Scene(chen2022()))["manipulator"]
    assert table["preset"] == "chen2022-v1" and "name" not in table
    assert table["section_length"] == 0.25
    assert table["section_angles_deg"] == [[0, 120, 240], [180, 300, 60]]


def test_saving_keeps_the_last_good_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "scene.toml"
    write_document({"title": "good"}, path)

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(InputError, match="cannot be written: No space left"):
        write_document({"title": "new"}, path)
    assert path.read_text() == 'title = "good"\n'
    assert len(list(tmp_path.iterdir())) == 1


def test_saving_into_a_missing_folder(tmp_path: Path) -> None:
    save_scene(Scene(chen2022()), tmp_path / "nowhere" / "scene.toml")
    assert load_scene(tmp_path / "nowhere" / "scene.toml") == Scene(chen2022())
    with pytest.raises(InputError, match="cannot be written"):
        save_scene(Scene(chen2022()), tmp_path / "nowhere" / "scene.toml" / "scene.toml")


def test_own_classes_cannot_be_saved() -> None:
    @dataclass(frozen=True)
    class Wind(Effect):
        name: ClassVar[str] = "wind"

    @dataclass(frozen=True)
    class MyArc(PaperArc):
        name: ClassVar[str] = "my-arc"

    for changes in ({"effects": (Wind(),)}, {"kinematics": MyArc()}):
        with pytest.raises(SceneError, match="a part that scene files do not know"):
            scene_to_dict(Scene(chen2022(), **changes))  # type: ignore[arg-type]


# ---------------------------------------------------------------- bad input


def test_missing_file(tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").write_text("")
    with pytest.raises(SceneError, match=r"no such file; the folder .* has no scene file"):
        load_scene(tmp_path / "project.toml")
    (tmp_path / "figure_eight.toml").write_text("")
    with pytest.raises(SceneError, match=r"did you mean 'figure_eight\.toml'"):
        load_scene(tmp_path / "figure8.toml")
    with pytest.raises(SceneError, match=r"no such file; scene files there: figure_eight\.toml$"):
        load_scene(tmp_path / "swing.toml")
    with pytest.raises(SceneError, match="cannot be read"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"schema = 1\n[model\n", r"scene\.toml: is not valid TOML: .*line 2"),
        (b"segments == 2", "line 1"),
        (b"title = 'x'\nsegments = [", "at the end of the file, line 2"),
        (b"\xff\xfe", "not UTF-8"),
        (b"[manipulator]\nsection_length = -1", r"scene\.toml: \[manipulator\] section_length"),
    ],
)
def test_bad_file(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    with pytest.raises(SceneError, match=message):
        load_scene(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("schema = 2", r"schema = 2: must be 1"),
        ("schema = true", "schema = True: must be 1"),
        ("title = 3", "title = 3: must be a text"),
        ("manipulator = 3", r"\[manipulator\] = 3: must be a table"),
        ("[[model]]", r"\[model\] = .*: must be a table"),
        ("[modle]", r"unknown key in the scene file: 'modle'; did you mean 'model'\?"),
        ("[model]\nsegment = 1", r"unknown key in \[model\]: 'segment'; did you mean 'segments'"),
        ("[effects]\nfriction = true", r"\[actuation\] kind = 'hydraulic-friction'"),
        ("[effects]\ncoriolise = true", "did you mean 'coriolis'"),
        ("[load]\nforce = [0,0,0]", "did you mean 'tip_force'"),
        ("[actuation]\nkinds = 'static'", "did you mean 'kind'"),
        ("[hydraulics]\nbulk = 1e9", "did you mean 'bulk_modulus'"),
        ("[limits]\npresure_max = 1e6", "did you mean 'pressure_max'"),
        ("[manipulator]\nsecton_length = 1", "did you mean 'section_length'"),
        ("[manipulator]\npreset = 'chen2022-v7'", "did you mean 'chen2022-v2'"),
        ("[manipulator]\nsections = 0", "sections = 0: must be a whole number from 1 to 64"),
        ("[manipulator]\nsections = 2.0", "sections = 2.0: must be a whole number"),
        (
            "[manipulator]\nsection_length = 'abc'",
            "section_length = 'abc': must be a number in m or a list of 2 of them",
        ),
        ("[manipulator]\nsection_length = true", "section_length = True: must be a number in m"),
        (
            "[manipulator]\nsection_length = [1, 1, 1]",
            r"section_length = \[1, 1, 1\] \(3 values\): must be a number in m or a list of 2",
        ),
        (
            "[manipulator]\nsection_length = [0.2, -0.1]",
            r"section_length\[1\] = -0\.1 m: must be between 0\.001 and 100 m",
        ),
        ("[manipulator]\nsection_mass = nan", r"section_mass = nan kg: must be between"),
        ("[manipulator]\nsection_mass = inf", r"section_mass = inf kg: must be between"),
        ("[manipulator]\nsection_angles_deg = []", "must be a list of one or more"),
        ("[manipulator]\nsection_angles_deg = 'x'", "must be a list of one or more"),
        ("[manipulator]\nsection_angles_deg = [[0], []]", r"section_angles_deg\[1\] = \[\]"),
        ("[manipulator]\nsection_angles_deg = [[0], 3]", r"section_angles_deg\[1\] = 3: must be"),
        ("[manipulator]\nsection_angles_deg = [0, 720]", r"\[1\] = 720 deg: must be between -360"),
        (
            "[manipulator]\nsection_angles_deg = [[0], [0], [0]]",
            r"\(3 values\): must be one list of angles in deg for all sections or 2 lists",
        ),
        ("[hydraulics]\nefficiency = 0", "efficiency = 0: must be above 0 and at most 1"),
        ("[hydraulics]\nscrew = 'lead/pi'", "did you mean 'lead/2pi'"),
        ("[limits]\npressure_max = -1", "must be at most pressure_max"),
        ("[model]\nkinematics = 'paper'", "unknown kinematics: 'paper'; did you mean 'paper-arc'"),
        ("[model]\nkinematics = 3", "kinematics = 3: must be a text, one of constant-strain"),
        ("[model]\nformulation = 'newton'", "did you mean 'newton-euler'"),
        ("[model]\nmass = 'gauss-9'", "did you mean 'gauss-"),
        ("[model]\nelasticity = 'enregy'", "did you mean 'energy'"),
        ("[model]\nformulation = 'newton-euler'\nmass = 'gauss-2'", "use virtual-power"),
        ("[model]\nstrains = []", "at least one"),
        ("[model]\nstrains = 'epsilon'", "must be a list of epsilon"),
        ("[model]\nstrains = ['eps']", "unknown strains: 'eps'; did you mean 'epsilon'"),
        ("[model]\nsegments = 65", "segments = 65: must be a whole number from 1 to 64"),
        ("[effects]\ngravity = [0, 0]", r"gravity = \[0, 0\] \(2 values\): must be a list of 3"),
        ("[effects]\ngravity = true", "gravity = True: must be a list of 3"),
        ("[effects]\ngravity = [0, 0, nan]", r"gravity\[2\] = nan m/s²: must be a finite number"),
        ("[effects]\ngravity = [0, 0, 'g']", r"gravity\[2\] = 'g': must be a number in m/s²"),
        (
            "[effects]\nend_stops = {start = 1}",
            r"EndStops.start = 1 m: must be at most stroke_max = 0.35 m",
        ),
        ("[effects]\ninertia = 1", "inertia = 1: must be true or false"),
        ("[effects]\ninertia = false\ncoriolis = true", "'coriolis' needs the effect 'inertia'"),
        (
            "[effects]\npayload = 3",
            r"payload = 3: must be true, false or a table {mass = …, radius",
        ),
        ("[effects]\npayload = {mas = 1}", r"in \[effects\] payload: 'mas'; did you mean 'mass'"),
        (
            "[effects]\npayload = {mass = 0}",
            r"\[effects\] payload mass = 0 kg: must be above 0 and",
        ),
        ("[effects]\npayload = {mass = 'x'}", r"payload mass = 'x': must be a number in kg"),
        ("[effects]\nbuoyancy = true", "'buoyancy' needs the effect 'gravity': add it, or leave"),
        ("[effects]\ncontact = true", r"\[effects\] contact: Contact\.obstacles is empty"),
        ("[effects]\ncontact = {obstacles = 3}", "obstacles = 3: must be a list of tables"),
        ("[effects]\ncontact = {obstacles = [{}]}", r"contact obstacles\[0\] kind: is missing"),
        (
            "[effects]\ncontact = {obstacles = [{kind = 'plain'}]}",
            r"contact obstacles\[0\] unknown kind: 'plain'; did you mean 'plane'",
        ),
        (
            "[effects]\ncontact = {obstacles = [{kind = 'plane', norm = [0, 0, 1]}]}",
            r"obstacles\[0\]: 'norm'; did you mean 'normal'",
        ),
        (
            "[effects]\ncontact = {obstacles = [{kind = 'plane', normal = [0, 1]}]}",
            r"obstacles\[0\] normal = \[0, 1\] \(2 values\): must be a list of 3",
        ),
        (
            "[model]\nformulation = 'newton-euler'\n[effects]\nfluid_drag = true",
            "'fluid_drag' is not in the formulation 'newton-euler': use 'virtual-power'",
        ),
        ("[actuation]\nkind = 'hydraulics'", "did you mean 'hydraulic'"),
        ("[load]\ntip_force = 3", "tip_force = 3: must be a list of 3 values"),
    ],
)
def test_bad_input(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        scene_of(text)


# ---------------------------------------------------------------- the strict reader


def test_table_reads_each_kind_once() -> None:
    table = Table({"r": 2, "n": 3, "on": True, "kind": "a", "at": [1, 2.5]}, "[track]")
    assert table.number("r", unit="m", low=0) == 2.0
    assert table.integer("n", low=1, high=9) == 3
    assert table.boolean("on") and table.boolean("off", False) is False
    assert table.string("kind", allowed=["a", "b"]) == "a"
    assert table.vector("at", 2) == (1.0, 2.5)
    assert table.number("speed", 0.5) == 0.5
    table.finish()


def test_table_names_what_is_missing_or_left_over() -> None:
    table = Table({"raduis": 1.0}, "[track]")
    with pytest.raises(SceneError, match=r"\[track\] radius: is missing; is it 'raduis', misspelt"):
        table.number("radius")
    with pytest.raises(SceneError, match=r"key in \[track\]: 'raduis'; did you mean 'radius'"):
        table.finish()


# ---------------------------------------------------------------- the reference page


def test_reference_page_has_every_key() -> None:
    page = reference_page()
    read = scene_to_dict(Scene(chen2022(), effects=(Gravity(), TipLoad())))
    for name in TABLES:
        assert f"## [{name}]" in page
        for key in read[name]:
            assert f"| `{key}` |" in page, key
    for kind in EFFECTS:
        assert kind is TipLoad or f"| `{kind.name}` |" in page
        for item in fields(kind):  # type: ignore[arg-type]
            assert kind in (Gravity, TipLoad) or f"| `{item.name}` |" in page
    for line in page.splitlines():
        assert not line.startswith("|") or line.count("|") in (5, 7)
