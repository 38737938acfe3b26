"""The design file: one-line errors for unknown keys, schemas and invalid TOML; writing and reading change nothing."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import solen.spec.toml as design_file
from solen.errors import OutputError, SpecError
from solen.spec import Design, dumps, json_schema, load, loads, parse_assignment, save, template, with_values
from solen.spec.strict import migrated, nearest

HEAD = 'schema = 1\nname = "test"\n[material]\nindex = 1.44\n'


def error_line(text: str) -> str:
    with pytest.raises(SpecError) as refusal:
        loads(text, what="sensor.toml")
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    assert line.startswith("sensor.toml")
    return line.removeprefix("sensor.toml").removeprefix(": ")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[lens]\nfocus = 3", "lens.focus; unknown key; did you mean lens.focus_mm?"),
        ("[lens]\ndistance_mm = 3", "lens.distance_mm; unknown key; did you mean emitter.distance_mm?"),
        ("[lense]\nfocus_mm = 3", "lense; unknown key; did you mean lens?"),
        ("[trace]\nqqq = 3", "trace.qqq; unknown key; the keys of this table are mode"),
        ("[qqqq]", "qqqq; unknown key; the keys of this table are name, material, emitter, ambient"),
        ("[body]\nfolder = 'x'", "body.folder; unknown key"),
        ("[body]\nkind = 'x'\nthick_mm = 3", "body.thick_mm; unknown key; did you mean body.thickness_mm?; and 1 more"),
    ],
)
def test_an_unknown_key_is_reported_with_the_nearest_known_key(text: str, line: str) -> None:
    assert error_line(HEAD + text).startswith(line)


def test_an_unknown_key_is_reported_before_a_missing_one() -> None:
    text = 'schema = 1\nnames = "x"\n[material]\nindex = 1.44'
    assert error_line(text) == "names; unknown key; did you mean name?; and 1 more problem"


RESERVED = {
    "emitter": ["power_mW"],
    "receivers": ["part", "width_mm"],
    "trace": ["min_weight", "seed"],
    "lens": ["outline"],
}


@pytest.mark.parametrize(("table", "key"), [(table, key) for table, keys in RESERVED.items() for key in keys])
def test_a_reserved_key_is_not_yet_supported(table: str, key: str) -> None:
    assert error_line(f"{HEAD}[{table}]\n{key} = 1").startswith(f"{table}.{key}; is not yet supported")


@pytest.mark.parametrize("name", ["emitters", "lenses", "receivers", "emitter", "lens", "motion"])
def test_lists_of_parts_belong_to_the_network_table(name: str) -> None:
    line = error_line(f"{HEAD}[[{name}]]\n[[{name}]]\n")
    assert line.startswith(f"{name}; ")
    assert f"network.{name}" in line


def test_a_value_where_a_table_belongs_is_refused() -> None:
    assert error_line('schema = 1\nname = "x"\nlens = 3\nmaterial = {index = 1.44}').startswith(
        "lens = 3; must be a table; write [lens]"
    )


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("schema = 1\n[material]\nindex = 1.44", "name; is missing; add"),
        ('schema = 1\nname = "x"', "material; is missing; add"),
        ('name = "x"\n[material]\nindex = 1.44', "; schema is missing; add the line schema = 1"),
    ],
)
def test_missing_keys_are_reported(text: str, line: str) -> None:
    assert error_line(text).startswith(line)


@pytest.mark.parametrize("value", ["0", "-1", "true", "1.0", "'1'"])
def test_refuses_an_invalid_schema_version(value: str) -> None:
    assert "must be an integer, at least 1" in error_line(HEAD.replace("schema = 1", f"schema = {value}"))


def test_a_newer_schema_requires_an_update() -> None:
    line = error_line(HEAD.replace("schema = 1", "schema = 7"))
    assert line == "schema = 7; was written by a newer solen; this version reads schema 1 and older; update solen"


def test_an_old_file_is_migrated_version_by_version(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(design_file, "SCHEMA", 3)
    monkeypatch.setattr(
        design_file,
        "MIGRATIONS",
        {
            1: lambda data: {"name": data["title"], **data},
            2: lambda data: {key: value for key, value in data.items() if key != "title"},
        },
    )
    old = HEAD.replace("name =", "title =")
    assert loads(old).name == "test"
    assert dumps(loads(old)).startswith("schema = 3\n")
    assert "unknown key" in error_line(old.replace("schema = 1", "schema = 3"))


def test_migration_does_not_change_its_argument() -> None:
    data = {"schema": 1, "a": 1}
    steps = {1: lambda tables: {**tables, "b": 2}}
    assert migrated(data, "f", current=2, migrations=steps, error=SpecError) == {"a": 1, "b": 2}
    assert data == {"schema": 1, "a": 1}


@pytest.mark.parametrize(
    ("text", "position"),
    [
        ("schema = 1\nname = ", "line 2"),
        ("a = 1\na = 2", "line 2"),
        ("a = " + "[" * 5000, ""),
        ("a = " + "9" * 5000, ""),
    ],
)
def test_invalid_toml_is_reported_with_its_line(text: str, position: str) -> None:
    line = error_line(text)
    assert "not valid TOML" in line
    assert position in line


def test_relative_paths_are_based_on_the_folder_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "sensor.toml"
    file.write_text("\ufeff" + HEAD.replace("index = 1.44", 'resin = "resins/mine.toml"'), encoding="utf-8")
    design = load(str(file))
    assert design.folder == tmp_path
    assert design.resin_file == tmp_path / "resins" / "mine.toml"


@pytest.mark.parametrize("content", [None, b"\xff\xfe", b"[lens]"])
def test_a_file_that_cannot_be_read_is_named(content: bytes | None, tmp_path: Path) -> None:
    file = tmp_path / "sensor.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(SpecError) as refusal:
        load(file)
    assert str(refusal.value).startswith(str(file))
    assert "\n" not in str(refusal.value)


def test_defaults_are_omitted_on_writing() -> None:
    assert dumps(loads(template("paper-860"))) == 'schema = 1\nname = "Paper 860 nm"\n\n[material]\nindex = 1.44\n'


def positive(highest: float) -> st.SearchStrategy[float]:
    return st.floats(1e-6, highest)


TABLES: dict[str, dict[str, st.SearchStrategy[Any]]] = {
    "emitter": {
        "wavelength_nm": st.floats(100, 20_000),
        "distance_mm": positive(1e6),
        "offset_mm": st.floats(-1e3, 1e3),
        "cone_deg": positive(180),
        "rays": st.integers(1, 10**9),
    },
    "lens": {
        "shape": st.sampled_from(["cartesian-oval", "none"]),
        "focus_mm": positive(1e6),
        "design_index": st.floats(1, 4.99),
    },
    "body": {"stem_curve_per_mm": st.floats(-1, 1), "arm_angle_deg": positive(89), "thickness_mm": positive(9)},
    "motion": {
        "pivot": st.sampled_from(["emitter", "stem-base"]) | st.tuples(st.floats(-9, 9), st.floats(-9, 9)),
        "moves": st.sampled_from([("emitter",), ("lens", "emitter")]),
        "from_deg": st.floats(-89, 0),
        "to_deg": st.floats(1, 89),
        "step_deg": st.floats(0.01, 100),
    },
    "trace": {"mode": st.sampled_from(["count", "power"])},
}
LINE: st.SearchStrategy[Any] = st.text(st.characters(codec="utf-8"), min_size=1).filter(
    lambda text: text.isprintable() and text.strip()
)
MATERIALS: st.SearchStrategy[Any] = st.fixed_dictionaries(
    {"index": st.floats(1, 4.99)}, optional={"absorption_per_mm": st.floats(0, 9)}
)
RESINS: st.SearchStrategy[Any] = st.fixed_dictionaries({"resin": LINE}, optional={"absorption_per_mm": st.floats(0, 9)})
RECEIVERS: st.SearchStrategy[dict[str, Any]] = st.just({}) | st.builds(
    lambda gap: {"coupling": "air-gap", "gap_mm": gap}, positive(9)
)
DESIGNS: st.SearchStrategy[dict[str, Any]] = st.fixed_dictionaries(
    {"name": LINE, "material": MATERIALS | RESINS, "receivers": RECEIVERS},
    optional={table: st.fixed_dictionaries({}, optional=keys) for table, keys in TABLES.items()},
)


@given(DESIGNS)
def test_writing_and_reading_change_nothing(tables: dict[str, Any]) -> None:
    design = Design(**tables)
    again = loads(dumps(design))
    assert again == design
    assert dumps(again) == dumps(design)


@pytest.mark.parametrize("is_set", [True, False])
def test_an_absorption_of_zero_set_with_a_resin_is_kept(is_set: bool) -> None:
    line = "absorption_per_mm = 0.0" if is_set else ""
    design = loads(HEAD.replace("index = 1.44", f'resin = "pmma"\n{line}'))
    assert loads(dumps(design)).material.sets_absorption is is_set


def test_a_saved_design_refers_to_the_same_resin_file(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    design = loads(HEAD.replace("index = 1.44", 'resin = "mine.toml"'), folder=tmp_path)
    assert load(save(tmp_path / "same.toml", design)) == design
    moved = load(save(tmp_path / "other" / "sensor.toml", design))
    assert moved.material.resin == "../mine.toml"
    assert moved.resin_file is not None
    assert moved.resin_file.resolve() == (tmp_path / "mine.toml").resolve()


def test_a_failed_write_is_reported(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written"):
        save(tmp_path / "missing" / "sensor.toml", loads(HEAD))


def test_values_are_set_by_dotted_keys() -> None:
    design = loads(HEAD)
    changed = with_values(design, {"lens.focus_mm": 25, "name": "b", "motion.pivot": [0, 1]})
    assert (changed.lens.focus_mm, changed.name, changed.motion.pivot) == (25.0, "b", (0.0, 1.0))
    assert design.lens.focus_mm == 20.0
    assert with_values(changed, {"lens": {"design_index": 1.5}}).lens.focus_mm == 20.0


def test_none_resets_an_optional_key_to_its_default() -> None:
    design = loads(HEAD + "[receivers]\ncoupling = 'air-gap'\ngap_mm = 1")
    assert with_values(design, {"receivers.coupling": "matched", "receivers.gap_mm": None}) == loads(HEAD)


def test_an_index_and_a_resin_replace_each_other() -> None:
    by_resin = with_values(loads(HEAD), {"material.resin": "pmma"})
    assert (by_resin.material.index, by_resin.material.resin) == (None, "pmma")
    assert with_values(by_resin, {"material.index": 1.44}) == loads(HEAD)
    with pytest.raises(SpecError, match="both index and resin"):
        with_values(by_resin, {"material.index": 1.44, "material.resin": "pmma"})


def test_depths_and_forces_of_a_motion_replace_each_other() -> None:
    by_force = loads(template("press-860"))
    changes = {"motion.drives": "finger.depth_mm", "motion.depths_mm": [0.0, 0.3]}
    by_depth = with_values(by_force, changes)
    assert (by_depth.motion.depths_mm, by_depth.motion.forces_N) == ((0.0, 0.3), None)
    back = {"motion.drives": "finger.force_N", "motion.forces_N": by_force.motion.forces_N}
    assert with_values(by_depth, back) == by_force


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("focus_mm", 25, "focus_mm; unknown key; did you mean lens.focus_mm?"),
        ("lens.focus", 25, "lens.focus; unknown key; did you mean lens.focus_mm?"),
        ("lens.focus_mm.x", 25, "lens.focus_mm = {'x': 25}; must be a number"),
        ("name.x", 25, "name.x; unknown key"),
        ("schema", 1, "schema; unknown key"),
        ("lens.focus_mm", float("nan"), "lens.focus_mm = nan; must be a finite number"),
        ("emitter.power_mW", 50.0, "emitter.power_mW; is not yet supported"),
        ("", 1, "; unknown key"),
    ],
)
def test_refuses_invalid_assignments_by_key(key: str, value: object, line: str) -> None:
    with pytest.raises(SpecError) as refusal:
        with_values(loads(HEAD), {key: value})
    assert str(refusal.value).startswith(line)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("lens.focus_mm=25", "lens.focus_mm", 25),
        (" lens.focus_mm = 2.5 ", "lens.focus_mm", 2.5),
        ("motion.moves=['emitter']", "motion.moves", ["emitter"]),
        ('name="a=b"', "name", "a=b"),
        ("name=a=b", "name", "a=b"),
        ("lens.shape=none", "lens.shape", "none"),
        ("motion.pivot=[1, 2", "motion.pivot", "[1, 2"),
        ("name=1\nother = 2", "name", "1\nother = 2"),
        ("name=", "name", ""),
    ],
)
def test_an_assigned_value_is_toml_or_else_a_string(text: str, key: str, value: object) -> None:
    assert parse_assignment(text) == (key, value)


@pytest.mark.parametrize("text", ["lens.focus_mm", "=25", ""])
def test_refuses_text_without_a_key_and_a_value(text: str) -> None:
    with pytest.raises(SpecError, match=r"not of the form key=value; write, for example, lens\.focus_mm=25"):
        parse_assignment(text)


def test_nearest_finds_only_similar_names() -> None:
    assert nearest("Focus", ["focus_mm", "shape"]) == "focus_mm"
    assert nearest("zzz", ["focus_mm", "shape"]) is None


def test_the_json_schema_lists_every_key_of_every_table() -> None:
    schema = json_schema()
    assert schema["required"] == ["schema", "name", "material"]
    assert schema["properties"]["schema"]["const"] == 1
    assert set(schema["properties"]) == {"schema", *Design.model_fields}
    assert set(schema["$defs"]) == {
        *("Material", "Emitter", "Ambient", "Lens", "Body", "Receivers", "Motion", "Trace"),
        *("Wall", "Layer", "Fabricate", "Readout", "Parameters", "Tolerance", "Hold", "Press", "Pull", "Mechanics"),
        *("Network", "Node", "Guide", "PlacedLens", "PlacedEmitter", "PlacedReceiver", "NamedMotion", "Reading"),
    }
    parameters = schema["$defs"].pop("Parameters")
    assert parameters["additionalProperties"] == {"type": "number"}
    for table in (schema, *schema["$defs"].values()):
        assert table["additionalProperties"] is False
    for table in schema["$defs"].values():
        assert all(prop["description"] for prop in table["properties"].values())
    assert "null" not in str(schema)
    assert "folder" not in str(schema["properties"])
