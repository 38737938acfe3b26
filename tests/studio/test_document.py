"""A design that is worked on: steps back, saving, and files that somebody else changes."""

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
from solen.studio.answers import View, effective, lit_sensor, picture_frame, refined_frames, shown_sensor
from solen.studio.commands import same_as
from solen.studio.document import Document
from solen.studio.frames import VERSION, decoded, encoded

TEXT = 'schema = 1\nname = "a"\n[material]\nindex = 1.44  # of the batch\n'


@pytest.fixture
def document(tmp_path: Path) -> Document:
    (tmp_path / "a.toml").write_text(TEXT, encoding="utf-8")
    return Document(tmp_path / "a.toml")


def test_changes_of_a_gesture_are_one_step(document: Document) -> None:
    for focus in (21.0, 22.0, 23.0):
        document.change({"lens.focus_mm": focus}, "drag")
    document.change({"lens.focus_mm": 24.0}, "another")
    seen = [document.step(by).design.lens.focus_mm for by in (-1, -1, -1, 1, 1, 1)]
    assert seen == [23.0, 20.0, 20.0, 23.0, 24.0, 24.0]
    document.step(-1)
    document.change({"emitter.offset_mm": 0.1})
    assert document.step(1).design.lens.focus_mm == 23.0, "what was undone is gone after another change"


def test_a_file_that_somebody_else_changed_is_not_overwritten(document: Document) -> None:
    document.change({"lens.focus_mm": 21.0})
    document.path.write_text(TEXT.replace("1.44", "1.45"), encoding="utf-8")
    with pytest.raises(OutputError, match="another program"):
        document.save()
    assert load(document.path).material.index == 1.45
    assert document.reload().design.material.index == 1.45
    document.change({"lens.focus_mm": 21.0})
    document.save()
    assert document.path.read_text(encoding="utf-8").startswith(TEXT.replace("1.44", "1.45"))


def test_what_is_not_saved_is_kept_beside(document: Document) -> None:
    document.keep_unsaved()
    assert document.kept is None
    document.change({"lens.focus_mm": 21.0})
    document.keep_unsaved()
    assert document.kept is not None
    assert load(document.kept).lens.focus_mm == 21.0
    assert document.path.read_text(encoding="utf-8") == TEXT


def test_what_was_left_unsaved_is_offered_and_never_overwritten(document: Document) -> None:
    values = {"lens.focus_mm": 21.0, "motion.moves": ["lens"], "material.index": 1.5}
    left = document.change(values).design
    document.keep_unsaved()
    assert document.kept is not None
    text = document.kept.read_text(encoding="utf-8")

    again = Document(document.path)
    assert again.offered == document.kept
    again.change({"lens.focus_mm": 22.0})
    again.keep_unsaved()
    assert again.kept is not None
    assert again.kept.name == "a-unsaved-2.toml"
    assert document.kept.read_text(encoding="utf-8") == text, "left as it was"
    again.step(-1)
    again.keep_unsaved()
    assert again.kept is None, "nothing is unsaved, and its own file is removed"

    assert again.restore().design == left
    assert again.offered is None
    again.change({"lens.focus_mm": 23.0})
    again.keep_unsaved()
    assert load(document.kept).lens.focus_mm == 23.0, "what was taken over is kept on"
    document.kept.write_text(text + "# mine\n", encoding="utf-8")
    again.change({"lens.focus_mm": 24.0})
    again.keep_unsaved()
    assert again.kept is not None
    assert again.kept != document.kept, "somebody else has changed it"
    again.save()
    again.keep_unsaved()
    assert sorted(path.name for path in document.path.parent.iterdir()) == ["a-unsaved.toml", "a.toml"]
    assert again.step(-1).design.lens.focus_mm == 23.0


def test_what_was_left_of_another_design_is_not_taken_over(document: Document) -> None:
    document.path.with_name("a-unsaved.toml").write_text(TEXT, encoding="utf-8")
    assert Document(document.path).offered is None, "the same"
    document.path.with_name("a-unsaved.toml").write_text("[lens", encoding="utf-8")
    broken = Document(document.path)
    assert broken.offered is None
    with pytest.raises(SpecError, match="restore"):
        broken.restore()
    broken.change({"lens.focus_mm": 21.0})
    broken.keep_unsaved()
    assert document.path.with_name("a-unsaved.toml").read_text(encoding="utf-8") == "[lens"


def test_a_new_file_is_written_when_it_is_saved(tmp_path: Path) -> None:
    document = Document(tmp_path / "new.toml")
    assert document.is_new
    assert not document.path.exists()
    document.save()
    assert load(document.path) == document.state.design


def test_frames_say_their_version() -> None:
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
def test_every_shipped_design_is_drawn(tmp_path: Path, name: str) -> None:
    (tmp_path / "a.toml").write_text(template(name), encoding="utf-8")
    document = Document(tmp_path / "a.toml")
    head, arrays = decoded(picture_frame(document, document.state, View(), 1, whole=True, curve=name == "hand-860"))
    assert len(arrays["rays"]) > 100
    assert arrays["outline"].shape[1] == 2
    assert set(head["values"]) == set(json_schema()["properties"]) - {"schema"}
    if name == "hand-860":
        assert "a network" in head["no_curve"]
        assert {"emitter-wrist", "node-thumb-tip", "receiver-ring-side"} <= set(head["handles"])
        assert head["emitters"] == ["wrist", "index", "ring"]


def test_a_network_shows_the_powers_of_all_emitters_and_lights_the_chosen_one(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(template("hand-860"), encoding="utf-8")
    document = Document(tmp_path / "a.toml")
    document.change({"network.motion[0].at_deg": 3.0})
    head, _ = decoded(next(refined_frames(document.state, 1, View(), lambda: False)))
    index = lit_sensor(document.state, View(lit="index"))
    found = index.trace(mode="power", rays=20_000).detectors
    for k, receiver in enumerate(head["receivers"]):
        power, u = head["power"][0][1][k], head["u_power"][0][1][k]
        assert power == pytest.approx(found[receiver].power, abs=4.0 * (u + 1e-3))
    x, z = picture(index).handles["emitter-index"]
    changed = document.change(dragged(index, "emitter-index", (x, z + 0.5))[1]).design.network.emitters
    assert changed[1].distance_mm is not None, "of the chosen one"
    assert changed[0].distance_mm is None
    assert lit_sensor(document.state, View(lit="none")) is document.state.sensor


def test_two_designs_are_shown_side_by_side(document: Document) -> None:
    """The one that was pinned stays as it was, and both are turned alike."""
    before = document.state.sensor
    document.pin()
    state = document.change({"emitter.offset_mm": 0.2})
    head, arrays = decoded(
        picture_frame(document, state, View(angle_deg=2.0, light="plane"), 1, whole=True, curve=False)
    )
    assert head["is_beside"]
    assert arrays["beside_outline"] == pytest.approx(picture(before, 2.0).outline, abs=1e-5)
    assert arrays["emitter"].mean(axis=0) - arrays["beside_emitter"].mean(axis=0) == pytest.approx(
        [0.2 * np.cos(np.radians(2.0)), 0.2 * np.sin(np.radians(2.0))], abs=1e-5
    )
    frames = refined_frames(state, 1, View(light="plane"), lambda: False, document.beside)
    curves = {head["curve"]["name"]: head["curve"] for head, _ in map(decoded, frames) if head["kind"] == "curve"}
    exact = before.power([before.design.motion.from_deg]).contrast[0]
    assert curves["pinned"]["ends"][0] == pytest.approx(exact, abs=4 * curves["pinned"]["u_ends"][0] + 1e-3)
    assert curves["own"]["ends"][0] != pytest.approx(exact, abs=0.01)
    document.pin()
    assert document.beside is None


def test_what_a_part_states_is_shown_as_what_holds(tmp_path: Path) -> None:
    sensor = Document(tmp_path / "new.toml").state.sensor
    assert effective(sensor)["emitter.width_mm"] == sensor.light.width_mm == 0.2
    assert "emitter.width_mm" not in effective(sensor.set({"emitter.width_mm": 0.3}))


def test_the_same_elsewhere_is_the_same_design(document: Document) -> None:
    values = {"lens.focus_mm": 21, "motion.pivot": [0.5, 2.0], "motion.moves": ["lens"], "name": 'it\'s "mine"'}
    state = document.change(values)
    same = same_as(document.path, state.changes)
    words = shlex.split(same["shell"])
    assigned = [word for before, word in pairwise(words) if before == "--set"]
    assert open_design(Path(words[2]), assigned) == state.design
    made: dict[str, Any] = {}
    exec(same["python"].replace("print(sensor.power().contrast)", ""), made)  # noqa: S102  what is shown to a person
    assert made["sensor"].design == state.design
    assert "--set" not in same_as(document.path, {"emitter.part": None})["shell"]


def test_a_printed_lens_is_shown_as_it_was_designed_too(document: Document) -> None:
    x = np.linspace(-2.0, 2.0, 41)
    profile = np.column_stack([x, document.state.sensor.lens.front.points(np.linspace(0.0, 1.0, 41))[:, 1] + 0.02])
    header = "x_mm,z_mm,u_mm"
    rows = np.column_stack([profile, np.full(41, 1e-3)])
    np.savetxt(document.path.with_name("lens.csv"), rows, delimiter=",", header=header, comments="")
    state = document.change({"lens.shape": "measured", "lens.profile": "lens.csv"})
    own, designed, flat = (shown_sensor(state, View(lens=lens)) for lens in ("own", "designed", "flat"))
    assert own.is_measured
    assert designed.design.lens.shape == "cartesian-oval"
    assert not flat.has_lens
