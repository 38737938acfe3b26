"""Supports and loads of a soft body: their tables, the keys that each requires, and the errors."""

import pytest

from solen.errors import SpecError
from solen.spec import Design, dumps, loads, template, value_at, with_values

HEAD = 'schema = 1\nname = "test"\nmaterial = {index = 1.44}\n'
HOLD = '[[hold]]\nname = "fork"\nface = "outer-*"\n'
CLAMP = '[[hold]]\nname = "clamp"\nface = "lens"\nkind = "turning"\nabout = "stem-base"\n'
FINGER = '[[press]]\nname = "finger"\nface = "stem-right"\nat_mm = 8\nradius_mm = 4\n'
TURNED = '[motion]\nkind = "loaded"\ndrives = "clamp.angle_deg"\n'
PRESSED = '[motion]\nkind = "loaded"\ndrives = "finger.depth_mm"\ndepths_mm = [0, 0.25, 0.5]\n'


def error_line(text: str) -> str:
    with pytest.raises(SpecError) as caught:
        loads(HEAD + text)
    line = str(caught.value)
    assert "\n" not in line
    return line


def test_a_loaded_design_is_unchanged_by_writing_and_reading() -> None:
    design = loads(HEAD + TURNED + HOLD + CLAMP)
    assert loads(dumps(design)) == design
    assert design.motion.values() == design.motion.angles_deg()
    assert design.motion.unit == "deg"
    pressed = loads(HEAD + PRESSED + HOLD + FINGER)
    assert loads(dumps(pressed)) == pressed
    assert (pressed.motion.values(), pressed.motion.unit) == ((0.0, 0.25, 0.5), "mm")


def test_keys_of_several_tables_are_read_and_set_by_index() -> None:
    design = loads(HEAD + TURNED + HOLD + CLAMP)
    moved = with_values(design, {"hold[0].from_mm": 12.2, "mechanics.modulus_MPa": 2.0})
    assert (moved.hold[0].from_mm, moved.hold[1], moved.mechanics.modulus_MPa) == (12.2, design.hold[1], 2.0)
    assert value_at(moved, "hold[0].from_mm") == 12.2
    for key in ("hold[2].from_mm", "hold[0].form_mm", "hold.from_mm"):
        with pytest.raises(SpecError, match=key.replace("[", r"\[")):
            value_at(design, key)
    with pytest.raises(SpecError, match=r"hold\[2\]"):
        with_values(design, {"hold[2].from_mm": 1.0})


@pytest.mark.parametrize(
    ("text", "problem", "remedy"),
    [
        (TURNED, "hold; is missing: there is no default", '"receiver-*"'),
        (HOLD, "hold; does not apply with motion.kind = ", "loaded"),
        ("[mechanics]\npoisson = 0.49\n", "mechanics; does not apply with motion.kind = ", "loaded"),
        ('[motion]\ndrives = "a.angle_deg"\n', "motion.drives = 'a.angle_deg'; does not apply", "omit motion.drives"),
        ("[motion]\nkind = 'loaded'\n" + HOLD, "motion.drives; is missing", "add a [[press]]"),
        (TURNED + HOLD, "motion.drives = 'clamp.angle_deg'; is not a quantity", "add a [[press]]"),
        (TURNED + HOLD + CLAMP + "angle_deg = 1\n", "hold[1].angle_deg = 1.0; does not apply with", "omit angle_deg"),
        (
            TURNED + "pivot = 'emitter'\n" + HOLD + CLAMP,
            "motion.pivot = 'emitter'; does not apply",
            "omit motion.pivot",
        ),
        (TURNED + "moves = ['lens']\n" + HOLD + CLAMP, "motion.moves = ['lens']; does not apply", "always move with"),
        (
            TURNED + "depths_mm = [1]\n" + HOLD + CLAMP,
            "motion.depths_mm = (1.0,); does not apply",
            "omit motion.depths_mm",
        ),
        (PRESSED + HOLD + FINGER + "depth_mm = 1\n", "press[0].depth_mm = 1.0; does not apply with", "omit depth_mm"),
        (PRESSED + "from_deg = -1\n" + HOLD + FINGER, "motion.from_deg = -1.0; does not apply", "omit motion.from_deg"),
        (PRESSED.replace("depths", "sdepths") + HOLD + FINGER, "motion.sdepths_mm; unknown key", "depths_mm"),
        (PRESSED.replace("[0, 0.25", "[0, 0"), "motion.depths_mm = ", "must be a list of numbers in ascending order"),
        (PRESSED.replace("[0, 0.25", "[-1, 0"), "hold; is missing", "add"),
        (PRESSED.replace("[0, 0.25", "[-1, 0") + HOLD + FINGER, "motion.depths_mm = ", "must be at least 0"),
        (TURNED + HOLD + CLAMP + FINGER, "press[0].depth_mm; is missing: required unless motion.drives", "add"),
        (
            TURNED + HOLD + CLAMP + FINGER + "depth_mm = 1\nforce_N = 1\n",
            "press[0].force_N = 1.0; does not apply with depth_mm",
            "omit",
        ),
        (
            PRESSED + HOLD + FINGER + "absorption_per_mm = 1\n",
            "press[0].absorption_per_mm = 1.0; does not apply without an index",
            "index",
        ),
        (TURNED + HOLD + CLAMP.replace('about = "stem-base"', ""), "hold[1].about; is missing", "stem-base"),
        (TURNED + HOLD + "about = 'emitter'\n" + CLAMP, "hold[0].about = 'emitter'; does not apply", "turning"),
        (
            TURNED + HOLD + CLAMP + CLAMP.replace('"stem-base"', '"emitter"'),
            "hold[2].about = 'emitter'; must be",
            "one",
        ),
        (TURNED + HOLD + CLAMP + FINGER.replace("finger", "fork"), "press[0].name = 'fork'; is already the", "hold"),
        (PRESSED + HOLD + FINGER.replace('"finger"', '"air"'), "press[0].name = 'air'; is the name of", "another"),
        (PRESSED + HOLD + FINGER.replace('"finger"', '"body"'), "press[0].name = 'body'; is the name of", "another"),
        (
            PRESSED + HOLD + FINGER + 'index = 1.4\n[[wall]]\nface = "outer-*"\noutside = "finger"\nindex = 1.5\n',
            "press[0].name = 'finger'; is the name of another medium",
            "another",
        ),
        (TURNED + HOLD.replace("fork", "f.1") + CLAMP, "hold[0].name = 'f.1'; cannot contain a dot", ""),
        (TURNED + HOLD + "from_mm = 2\nto_mm = 1\n" + CLAMP, "hold[0].from_mm = 2.0; must be less than", ""),
        (TURNED + HOLD + CLAMP + "[mechanics]\npoisson = 0.3\n", "mechanics.poisson = 0.3; must be at least 0.4", ""),
    ],
)
def test_refuses_contradictory_tables_and_names_the_key(text: str, problem: str, remedy: str) -> None:
    line = error_line(text)
    assert problem in line
    assert remedy in line


def test_the_shipped_example_is_driven_by_force() -> None:
    design = loads(template("press-860"))
    assert isinstance(design, Design)
    assert (design.motion.unit, design.motion.values()[-1]) == ("N", 0.4)
