"""The edited document: undo, saving, and files that are changed by other programs."""

import shlex
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import OutputError, SpecError
from solen.pipeline.design.designs import open_design
from solen.sensor import dragged, picture
from solen.spec import json_schema, load, template, template_names
from solen.studio.commands import same_as
from solen.studio.document import Document
from solen.studio.frames import VERSION, decoded, encoded
from solen.studio.replies import View, effective, lit_sensor, picture_frame, refined_frames, shown_sensor

TEXT = 'schema = 1\nname = "a"\n[material]\nindex = 1.44  # of the batch\n'


@pytest.fixture
def document(tmp_path: Path) -> Document:
    (tmp_path / "a.toml").write_text(TEXT, encoding="utf-8")
    return Document(tmp_path / "a.toml")


def test_changes_of_gesture_are_one_step(document: Document) -> None:
    for focus in (21.0, 22.0, 23.0):
        document.change({"lens.focus_mm": focus}, "drag")
    document.change({"lens.focus_mm": 24.0}, "another")
    values = [document.step(by).design.lens.focus_mm for by in (-1, -1, -1, 1, 1, 1)]
    assert values == [23.0, 20.0, 20.0, 23.0, 24.0, 24.0]
    document.step(-1)
    document.change({"emitter.offset_mm": 0.1})
    assert document.step(1).design.lens.focus_mm == 23.0, "another change discards the undone states"


def test_does_not_overwrite_file_changed_by_other_program(document: Document) -> None:
    document.change({"lens.focus_mm": 21.0})
    document.path.write_text(TEXT.replace("1.44", "1.45"), encoding="utf-8")
    with pytest.raises(OutputError, match="another program"):
        document.save()
    assert load(document.path).material.index == 1.45
    assert document.reload().design.material.index == 1.45
    document.change({"lens.focus_mm": 21.0})
    document.save()
    assert document.path.read_text(encoding="utf-8").startswith(TEXT.replace("1.44", "1.45"))


def test_keeps_unsaved_changes_next_to_design(document: Document) -> None:
    document.keep_unsaved()
    assert document.unsaved_file is None
    document.change({"lens.focus_mm": 21.0})
    document.keep_unsaved()
    assert document.unsaved_file is not None
    assert load(document.unsaved_file).lens.focus_mm == 21.0
    assert document.path.read_text(encoding="utf-8") == TEXT


def test_offers_earlier_unsaved_changes_and_never_overwrites_them(document: Document) -> None:
    values = {"lens.focus_mm": 21.0, "motion.moves": ["lens"], "material.index": 1.5}
    unsaved = document.change(values).design
    document.keep_unsaved()
    assert document.unsaved_file is not None
    text = document.unsaved_file.read_text(encoding="utf-8")

    reopened = Document(document.path)
    assert reopened.earlier_changes == document.unsaved_file
    reopened.change({"lens.focus_mm": 22.0})
    reopened.keep_unsaved()
    assert reopened.unsaved_file is not None
    assert reopened.unsaved_file.name == "a-unsaved-2.toml"
    assert document.unsaved_file.read_text(encoding="utf-8") == text, "must remain unchanged"
    reopened.step(-1)
    reopened.keep_unsaved()
    assert reopened.unsaved_file is None, "without unsaved changes, the file is removed"

    assert reopened.restore().design == unsaved
    assert reopened.earlier_changes is None
    reopened.change({"lens.focus_mm": 23.0})
    reopened.keep_unsaved()
    assert load(document.unsaved_file).lens.focus_mm == 23.0, "the restored file is updated"
    document.unsaved_file.write_text(text + "# mine\n", encoding="utf-8")
    reopened.change({"lens.focus_mm": 24.0})
    reopened.keep_unsaved()
    assert reopened.unsaved_file is not None
    assert reopened.unsaved_file != document.unsaved_file, "the file was changed by another program"
    reopened.save()
    reopened.keep_unsaved()
    assert sorted(path.name for path in document.path.parent.iterdir()) == ["a-unsaved.toml", "a.toml"]
    assert reopened.step(-1).design.lens.focus_mm == 23.0


def test_does_not_offer_unsaved_changes_of_other_design(document: Document) -> None:
    document.path.with_name("a-unsaved.toml").write_text(TEXT, encoding="utf-8")
    assert Document(document.path).earlier_changes is None, "the design is the same"
    document.path.with_name("a-unsaved.toml").write_text("[lens", encoding="utf-8")
    broken = Document(document.path)
    assert broken.earlier_changes is None
    with pytest.raises(SpecError, match="restore"):
        broken.restore()
    broken.change({"lens.focus_mm": 21.0})
    broken.keep_unsaved()
    assert document.path.with_name("a-unsaved.toml").read_text(encoding="utf-8") == "[lens"


def test_writes_new_file_when_saved(tmp_path: Path) -> None:
    document = Document(tmp_path / "new.toml")
    assert document.is_new
    assert not document.path.exists()
    document.save()
    assert load(document.path) == document.state.design


def test_frames_contain_version() -> None:
    frame = encoded(
        {"kind": "x", "value": float("nan")}, {"a": np.array([1.0, 2.5]), "b": np.array([[1.0, 2.0], [3.0, 4.0]])}
    )
    head, arrays = decoded(frame)
    assert frame[0] == VERSION
    assert head == {"kind": "x", "value": None}
    assert arrays["a"].tolist() == [[1.0], [2.5]]
    assert arrays["b"].tolist() == [[1.0, 2.0], [3.0, 4.0]]
    with pytest.raises(ValueError, match="version"):
        decoded(bytes([VERSION + 1]) + frame[1:])


@pytest.mark.parametrize("name", template_names())
def test_draws_every_shipped_design(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.toml").write_text(template(name), encoding="utf-8")
    document = Document(tmp_path / "a.toml")
    head, arrays = decoded(
        picture_frame(document, document.state, View(), 1, all_values=True, curve=name == "hand-860")
    )
    assert len(arrays["rays"]) > 100
    assert arrays["outline"].shape[1] == 2
    assert set(head["values"]) == set(json_schema()["properties"]) - {"schema"}
    if name == "hand-860":
        assert "a network" in head["no_curve"]
        assert {"emitter-wrist", "node-thumb-tip", "receiver-ring-side"} <= set(head["handles"])
        assert head["emitters"] == ["wrist", "index", "ring"]


def test_network_shows_powers_of_all_emitters_and_lights_selected_one(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(template("hand-860"), encoding="utf-8")
    document = Document(tmp_path / "a.toml")
    document.change({"network.motion[0].at_deg": 3.0})
    head, _ = decoded(next(refined_frames(document.state, 1, View(), lambda: False)))
    index = lit_sensor(document.state, View(lit="index"))
    reference = index.trace(mode="power", rays=20_000).detectors
    for k, receiver in enumerate(head["receivers"]):
        power, u = head["power"][0][1][k], head["u_power"][0][1][k]
        assert power == pytest.approx(reference[receiver].power, abs=4.0 * (u + 1e-3))
    x, z = picture(index).handles["emitter-index"]
    changed = document.change(dragged(index, "emitter-index", (x, z + 0.5))[1]).design.network.emitters
    assert changed[1].distance_mm is not None, "the selected emitter"
    assert changed[0].distance_mm is None
    assert lit_sensor(document.state, View(lit="none")) is document.state.sensor


def test_shows_two_designs_side_by_side(document: Document) -> None:
    """The pinned design remains unchanged, and both are turned by the same angle."""
    before = document.state.sensor
    document.pin()
    state = document.change({"emitter.offset_mm": 0.2})
    head, arrays = decoded(
        picture_frame(document, state, View(angle_deg=2.0, light="plane"), 1, all_values=True, curve=False)
    )
    assert head["is_beside"]
    assert arrays["beside_outline"] == pytest.approx(picture(before, 2.0).outline, abs=1e-5)
    assert arrays["emitter"].mean(axis=0) - arrays["beside_emitter"].mean(axis=0) == pytest.approx(
        [0.2 * np.cos(np.radians(2.0)), 0.2 * np.sin(np.radians(2.0))], abs=1e-5
    )
    frames = refined_frames(state, 1, View(light="plane"), lambda: False, document.comparison)
    curves = {head["curve"]["name"]: head["curve"] for head, _ in map(decoded, frames) if head["kind"] == "curve"}
    exact = before.power([before.design.motion.from_deg]).contrast[0]
    assert curves["pinned"]["ends"][0] == pytest.approx(exact, abs=4 * curves["pinned"]["u_ends"][0] + 1e-3)
    assert curves["own"]["ends"][0] != pytest.approx(exact, abs=0.01)
    document.pin()
    assert document.comparison is None


def test_effective_values_include_those_of_part(tmp_path: Path) -> None:
    sensor = Document(tmp_path / "new.toml").state.sensor
    assert effective(sensor)["emitter.width_mm"] == sensor.light.width_mm == 0.2
    assert "emitter.width_mm" not in effective(sensor.set({"emitter.width_mm": 0.3}))


def test_command_line_and_script_give_same_design(document: Document) -> None:
    values = {"lens.focus_mm": 21, "motion.pivot": [0.5, 2.0], "motion.moves": ["lens"], "name": 'it\'s "mine"'}
    state = document.change(values)
    commands = same_as(document.path, state.changes)
    words = shlex.split(commands["shell"])
    assigned = [word for before, word in pairwise(words) if before == "--set"]
    assert open_design(Path(words[2]), assigned) == state.design
    names: dict[str, Any] = {}
    exec(commands["python"].replace("print(sensor.power().contrast)", ""), names)  # noqa: S102  the script shown on the page
    assert names["sensor"].design == state.design
    assert "--set" not in same_as(document.path, {"emitter.part": None})["shell"]


def test_shows_measured_lens_as_designed(document: Document) -> None:
    x = np.linspace(-2.0, 2.0, 41)
    profile = np.column_stack([x, document.state.sensor.lens.front.points(np.linspace(0.0, 1.0, 41))[:, 1] + 0.02])
    header = "x_mm,z_mm,u_mm"
    rows = np.column_stack([profile, np.full(41, 1e-3)])
    np.savetxt(document.path.with_name("lens.csv"), rows, delimiter=",", header=header, comments="")
    state = document.change({"lens.shape": "measured", "lens.profile": "lens.csv"})
    measured, designed, flat = (shown_sensor(state, View(lens=lens)) for lens in ("own", "designed", "flat"))
    assert measured.is_measured
    assert designed.design.lens.shape == "cartesian-oval"
    assert not flat.has_lens
