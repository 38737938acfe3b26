"""Every scene in this folder gives the readings kept beside it; a warning fails the test, as all do here."""

from pathlib import Path

import pytest

from solen.curve import Arc, CartesianOval, Parabola, Segment
from solen.scene import Beam, Fan, Rays, dumps
from solen.scene.model import BEHAVIOURS
from tests.scenes.golden_support import FOLDER, MODES, NAMES, measured, rows_of, scene_of


@pytest.mark.parametrize("name", NAMES)
def test_readings_are_those_kept(name: str) -> None:
    found, kept = measured(scene_of(name)), rows_of(name)
    assert {(row.mode, row.reading) for row in kept} == {(mode, key) for mode in MODES for key in found[mode]}
    off = [row for row in kept if not abs(found[row.mode][row.reading] - row.value) <= row.tolerance]
    assert not off, [(row, found[row.mode][row.reading]) for row in off]


@pytest.mark.parametrize("name", NAMES)
def test_the_file_is_what_solen_writes(name: str) -> None:
    assert (FOLDER / f"{name}.json").read_text(encoding="utf-8") == dumps(scene_of(name)) + "\n"


def test_every_scene_has_its_readings() -> None:
    assert NAMES
    assert sorted(path.stem for path in Path(FOLDER).glob("*.csv")) == NAMES


def test_the_folder_covers_every_curve_behaviour_and_source() -> None:
    scenes = [scene_of(name) for name in NAMES]
    assert {type(i.curve) for scene in scenes for i in scene.interfaces} == {Segment, Arc, Parabola, CartesianOval}
    ideal = {"splitter", "lens", "grating"}  # tests/trace has closed forms for these
    assert {i.behaviour for scene in scenes for i in scene.interfaces} == set(BEHAVIOURS) - ideal
    assert {type(source) for scene in scenes for source in scene.sources} == {Fan, Beam, Rays}
    assert any(region.absorption_per_mm for scene in scenes for region in scene.regions)
    assert any(monitor.bins for scene in scenes for monitor in scene.monitors)
