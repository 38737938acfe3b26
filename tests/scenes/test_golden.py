"""Every scene in this folder gives its stored readings."""

from pathlib import Path

import pytest

from solen.curve import Arc, CartesianOval, Parabola, Segment
from solen.scene import Beam, Fan, Rays, dumps
from solen.scene.model import BEHAVIOURS
from tests.scenes.golden_support import FOLDER, MODES, NAMES, rows_of, scene_of, traced_readings


@pytest.mark.parametrize("name", NAMES)
def test_readings(name: str) -> None:
    values, stored = traced_readings(scene_of(name)), rows_of(name)
    assert {(row.mode, row.reading) for row in stored} == {(mode, key) for mode in MODES for key in values[mode]}
    wrong = [row for row in stored if not abs(values[row.mode][row.reading] - row.value) <= row.tolerance]
    assert not wrong, [(row, values[row.mode][row.reading]) for row in wrong]


@pytest.mark.parametrize("name", NAMES)
def test_scene_file_has_the_current_format(name: str) -> None:
    assert (FOLDER / f"{name}.json").read_text(encoding="utf-8") == dumps(scene_of(name)) + "\n"


def test_every_scene_has_readings() -> None:
    assert NAMES
    assert sorted(path.stem for path in Path(FOLDER).glob("*.csv")) == NAMES


def test_scenes_cover_curves_behaviours_and_sources() -> None:
    scenes = [scene_of(name) for name in NAMES]
    assert {type(i.curve) for scene in scenes for i in scene.interfaces} == {Segment, Arc, Parabola, CartesianOval}
    ideal = {"splitter", "lens", "grating"}  # tests/trace compares these with closed forms
    assert {i.behaviour for scene in scenes for i in scene.interfaces} == set(BEHAVIOURS) - ideal
    assert {type(source) for scene in scenes for source in scene.sources} == {Fan, Beam, Rays}
    assert any(region.absorption_per_mm for scene in scenes for region in scene.regions)
    assert any(monitor.bins for scene in scenes for monitor in scene.monitors)
