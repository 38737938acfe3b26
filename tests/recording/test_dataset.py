"""Recordings and other results as datasets."""

from pathlib import Path

import pytest

import solen
from solen.errors import OutputError
from solen.samples import sample


def test_recording_has_a_variable_for_each_channel(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    (tmp_path / "run.csv").write_bytes(sample("rotation-simulated.csv"))
    recording = solen.read(tmp_path / "run.csv")
    dataset = recording.to_dataset()
    assert set(dataset.data_vars) == {*recording.names, *recording.texts}
    assert dataset["angle"].values == pytest.approx(recording.channel("angle").values)
    assert dataset["angle"].attrs["units"] == "deg"
    assert dataset.attrs["simulated"] == 1


def test_result_without_arrays_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    (tmp_path / "run.csv").write_bytes(sample("rotation-simulated.csv"))
    with pytest.raises(OutputError, match="contains no arrays of its own"):
        solen.analyse(tmp_path / "run.csv").to_dataset()
