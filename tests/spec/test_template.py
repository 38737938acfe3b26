"""The shipped designs: the template shows every key with its default, and the JSON Schema accepts all of them."""

import re
import tomllib
from typing import Any, get_args

import pytest

from solen.errors import SpecError
from solen.parts import light_of
from solen.spec import Design, Material, json_schema, loads, template, template_names
from solen.spec.network import Network
from solen.spec.strict import Strict
from solen.spec.toml import DEFERRED

TYPES: dict[str, tuple[type, ...]] = {
    "string": (str,),
    "number": (int, float),
    "integer": (int,),
    "boolean": (bool,),
    "array": (list,),
    "object": (dict,),
}


def accepts(schema: dict[str, Any], value: Any, root: dict[str, Any]) -> bool:
    """Return whether a schema accepts a value; only the keywords that the schema of the design file uses are known."""
    if "$ref" in schema:
        return accepts(root["$defs"][schema["$ref"].rpartition("/")[2]], value, root)
    if "anyOf" in schema:
        return any(accepts(option, value, root) for option in schema["anyOf"])
    if not isinstance(value, TYPES[schema["type"]]) or ("const" in schema and value != schema["const"]):
        return False
    if "enum" in schema and value not in schema["enum"]:
        return False
    if isinstance(value, list):
        return "items" not in schema or all(accepts(schema["items"], item, root) for item in value)
    if isinstance(value, dict):
        known = schema["properties"]
        one_of = sum(set(option["required"]) <= set(value) for option in schema.get("oneOf", [])) == 1
        return (
            set(schema.get("required", [])) <= set(value) <= set(known)
            and (one_of or "oneOf" not in schema)
            and all(accepts(known[key], inner, root) for key, inner in value.items())
        )
    return isinstance(value, str) or (
        schema.get("minimum", value) <= value <= schema.get("maximum", value)
        and ("exclusiveMinimum" not in schema or value > schema["exclusiveMinimum"])
        and ("exclusiveMaximum" not in schema or value < schema["exclusiveMaximum"])
    )


def test_the_template_without_starred_lines_is_the_sensor_of_the_paper() -> None:
    plain = "\n".join(line for line in template().splitlines() if "(*)" not in line)
    paper = Design(name="SOLen 860 nm", material=Material(index=1.44))
    assert loads(plain) == paper
    assert loads(template("paper-860")) == paper.set(name="Paper 860 nm")


@pytest.mark.parametrize("name", [name for name in template_names() if not name.startswith("paper")])
def test_shipped_designs_have_an_led_chip_in_space(name: str) -> None:
    design = loads(template(name))
    light = light_of(design)
    assert design.trace.dimension == "extruded"
    assert (light.pattern, light.cone_deg) == ("lambertian", 180.0)
    assert 0.2 <= light.width_mm == light.height_mm <= 0.3
    assert light.wavelength_nm == float(name[-3:])


LISTS = ("wall", "hold", "press", "pull")
TABLES = [key for key in Design.model_fields if key not in ("name", "network", *LISTS)]


@pytest.mark.parametrize("table", TABLES)
def test_the_template_shows_every_key_with_its_default(table: str) -> None:
    model = Design.model_fields[table].annotation
    assert isinstance(model, type)
    assert issubclass(model, Strict)
    section = re.split(r"(?m)^\[", template().partition(f"\n[{table}]")[2])[0]
    values = tomllib.loads(template())[table]
    for key, field in model.model_fields.items():
        line = re.search(rf"(?m)^(# )?{key} = (.+)$", section)
        assert line, key
        if "(*)" in line[2]:
            shown = "none" if field.default is None else str(field.default)
            assert re.search(rf'default: "?{re.escape(shown)}', line[2]), key
        elif (table == "emitter" and key in DEFERRED) or key == "absorption_per_mm":  # a resin or a part may set it
            assert line[1] or key == "wavelength_nm", key
            assert tomllib.loads(f"x = {line[2]}")["x"] == field.default, key
        elif field.default is None:
            assert line[1] or key == "index", key
        else:
            default = list(field.default) if isinstance(field.default, tuple) else field.default
            assert values[key] == default, key


@pytest.mark.parametrize(
    ("name", "index", "wavelength_nm"),
    [("paper-860", 1.44, 860), ("paper-500", 1.49, 500), ("solen-450", 1.54, 450), ("pmma-860", None, 860)],
)
def test_the_examples_load(name: str, index: float | None, wavelength_nm: float) -> None:
    design = loads(template(name))
    assert (design.material.index, light_of(design).wavelength_nm) == (index, wavelength_nm)
    assert design.material.resin == (None if index else "pmma")


@pytest.mark.parametrize("table", LISTS)
def test_the_template_shows_the_tables_of_each_list(table: str) -> None:
    shown = template().partition(f"# [[{table}]]")[2].partition("\n\n")[0]
    kind = get_args(Design.model_fields[table].annotation)[0]
    assert set(re.findall(r"(?m)^# (\w+) = ", shown)) <= set(kind.model_fields)
    text = re.sub(r"(?m)^# ", "", f"# [[{table}]]{shown}")
    kind(**tomllib.loads(text)[table][0])


def test_the_template_names_the_lists_of_a_network() -> None:
    shown = template().partition("# [network]")[2].partition("\n\n")[0]
    assert set(re.findall(r"\w+", shown)) >= set(Network.model_fields)


def test_the_examples_are_listed() -> None:
    assert template_names() == (
        "hand-860",
        "paper-450",
        "paper-500",
        "paper-860",
        "pmma-860",
        "press-860",
        "robot-860",
        "solen-450",
        "solen-500",
        "solen-860",
        "strip-860",
    )


def test_an_unknown_example_is_reported_with_the_nearest_name() -> None:
    with pytest.raises(SpecError, match=r"^example = 'solen-850'; must be one of .*; did you mean solen-8?[56]0\?$"):
        template("solen-850")


@pytest.mark.parametrize("name", template_names())
def test_the_json_schema_accepts_the_examples(name: str) -> None:
    schema = json_schema()
    assert accepts(schema, tomllib.loads(template(name)), schema)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("focus_mm = 20.0", "focus_mm = 0"),
        ("focus_mm", "focus"),
        ('mode = "power"', 'mode = "powers"'),
        ("schema = 1", "schema = 2"),
        ("index = 1.44 ", "index = 5.0 "),
        ("# resin", "resin"),
        ('"emitter"]', '"stem"]'),
    ],
)
def test_the_json_schema_and_loads_refuse_the_same_errors(right: str, wrong: str) -> None:
    text = template().replace(right, wrong, 1)
    schema = json_schema()
    assert not accepts(schema, tomllib.loads(text), schema)
    with pytest.raises(SpecError):
        loads(text)
