"""The wall tables: several in one file, the keys that each requires, and the errors."""

from typing import Any

import pytest

from solen.errors import SpecError
from solen.spec import Design, Wall, dumps, loads, with_values

HEAD = 'schema = 1\nname = "x"\n[material]\nindex = 1.44\n'


def error_line(text: str) -> str:
    with pytest.raises(SpecError) as refusal:
        loads(HEAD + text)
    line = str(refusal.value).removeprefix("design: ")
    assert len(line.splitlines()) == 1
    return line


def test_walls_are_unchanged_by_writing_and_reading() -> None:
    text = """
[[wall]]
face = "stem-*"
from_mm = 2
to_mm = 6
outside = "skin"
index = 1.4
gap_um = 0.5

[[wall]]
face = "outer-right"
scatter = "gaussian"
sigma = 0.1
coating = [{index = 1.38, thickness_nm = 150}]
"""
    design = loads(HEAD + text)
    assert [wall.face for wall in design.wall] == ["stem-*", "outer-right"]
    assert design.wall[0].index == 1.4
    assert design.wall[1].coating[0].thickness_nm == 150.0
    assert loads(dumps(design)) == design
    assert with_values(design, {"lens.focus_mm": 25.0}).wall == design.wall


def test_a_design_without_walls_writes_none() -> None:
    assert "wall" not in dumps(Design(name="x", material={"index": 1.44}))


@pytest.mark.parametrize(
    ("keys", "start"),
    [
        ('fac = "x"', "wall[0].fac; unknown key; did you mean wall[0].face?"),
        ("from_mm = 1", "wall[0].face; is missing; add it: a face or a pattern"),
        ('face = "a"\nfrom_mm = -1', "wall[0].from_mm = -1; must be at least 0"),
        ('face = "a"\nfrom_mm = 2\nto_mm = 1', "wall[0].from_mm = 2.0; must be less than to_mm = 1.0"),
        ('face = "a"\noutside = "skin"', "wall[0].index; is missing: required with outside"),
        ('face = "a"\noutside = "body"\nindex = 1.4', "wall[0].outside = 'body'; is reserved for the printed part"),
        ('face = "a"\nindex = 1.4', "wall[0].index = 1.4; does not apply with outside = "),
        ('face = "a"\ngap_um = 1', "wall[0].gap_um = 1.0; does not apply with outside = "),
        ('face = "a"\nscatter = "gaussian"', "wall[0].sigma; is missing: required with scatter = "),
        ('face = "a"\nsigma = 0.1', "wall[0].sigma = 0.1; does not apply with scatter = "),
        ('face = "a"\nreflectance = 0.5', "wall[0].reflectance = 0.5; does not apply without finish"),
        ('face = "a"\nfinish = "mirror"\noutside = "skin"\nindex = 1.4', "wall[0].outside; does not apply with finish"),
        (
            'face = "a"\nfinish = "black"\nscatter = "lambertian"',
            "wall[0].scatter; does not apply with finish = ",
        ),
        ('face = "a"\ntexture_pitch_um = 25', "wall[0].texture_amplitude_um; is missing"),
        ('face = "a"\ncoating = [{index = 1.3}]', "wall[0].coating[0].thickness_nm; is missing; add it: thickness"),
    ],
)
def test_an_error_in_a_wall_names_its_index(keys: str, start: str) -> None:
    line = error_line(f"[[wall]]\n{keys}\n")
    assert line.startswith(start), line


def test_a_single_wall_is_also_a_list() -> None:
    assert "write [[wall]]" in error_line('[wall]\nface = "a"\n')


@pytest.mark.parametrize(
    "scatter", [{"scatter": "lambertian"}, {"scatter": "harvey-shack", "shoulder": 0.1, "slope": 2.0}]
)
def test_every_kind_of_scatter_is_accepted(scatter: dict[str, Any]) -> None:
    assert Wall(face="stem-*", **scatter).scatter == scatter["scatter"]
