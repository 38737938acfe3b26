"""Files of arrays (MATLAB, TDMS, HDF5, netCDF) give the same recording as a CSV of the same numbers."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from nptdms import ChannelObject, RootObject, TdmsWriter
from scipy.io import netcdf_file, savemat

from solen.errors import DataError
from solen.extras import PACKAGES
from solen.recording import Recording, read

TIME = np.arange(400) * 0.005
ANGLE = np.sin(TIME)
LEFT, RIGHT = 2.0 - 0.3 * ANGLE, 2.0 + 0.3 * ANGLE


def write_matlab(path: Path) -> None:
    table = {"time_s": TIME[:, None], "angle_deg": ANGLE, "V": np.column_stack([LEFT, RIGHT])}
    savemat(path, {"run": table, "fs": 200.0, "operator": "nobody", "short": np.arange(7.0)}, do_compression=True)


def write_matlab73(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("time_s", TIME), ("angle_deg", ANGLE)):
            file.create_dataset(f"run/{name}", data=values[None, :])
        file.create_dataset("run/V", data=np.vstack([LEFT, RIGHT]))
        text = file.create_dataset("operator", data=np.array([[ord(letter)] for letter in "nobody"], dtype=np.uint16))
        text.attrs["MATLAB_class"] = np.bytes_("char")
        file.create_dataset("fs", data=[[200.0]])
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(128))


def write_netcdf4(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.attrs["operator"] = "nobody"
        file.attrs["simulated"] = "yes"
        time = file.create_dataset("time", data=1e3 * TIME)
        time.attrs["units"] = "milliseconds since 2026-01-01"
        time.make_scale("time")
        file.create_dataset("angle", data=np.radians(ANGLE)).attrs["units"] = "rad"
        names = file.create_dataset("receiver", data=np.array([b"left", b"right"], dtype="S5"))
        names.make_scale("receiver")
        volts = file.create_dataset("voltage", data=np.column_stack([LEFT, RIGHT]))
        volts.attrs["units"] = "V"
        volts.dims[0].attach_scale(time)
        volts.dims[1].attach_scale(names)


def write_netcdf3(path: Path) -> None:
    opened: Any = netcdf_file(path, "w")
    with opened as file:
        file.operator = "nobody"
        file.createDimension("time", TIME.size)
        for name, values, unit in (("time", TIME, "s"), ("angle", ANGLE, "deg"), ("left", LEFT, "V")):
            variable = file.createVariable(name, "d", ("time",))
            variable[:] = values
            variable.units = unit


def write_tdms(path: Path) -> None:
    wave = {"wf_increment": 0.005, "wf_start_offset": 0.0, "wf_samples": TIME.size}
    with TdmsWriter(path) as writer:
        channels = [
            ChannelObject("daq", name, values, {"unit_string": unit} | wave)
            for name, values, unit in (("angle", ANGLE, "deg"), ("left", LEFT, "V"), ("right", RIGHT, "V"))
        ]
        writer.write_segment([RootObject({"operator": "nobody"}), *channels])


def values(recording: Recording, name: str, unit: str) -> Any:
    return recording.need(name).to(unit)


@pytest.mark.parametrize(
    ("write", "kind", "left"),
    [
        (write_matlab, "matlab", "V 1"),
        (write_matlab73, "matlab-7.3", "V 1"),
        (write_netcdf4, "hdf5", "left"),
        (write_netcdf3, "netcdf", "left"),
        (write_tdms, "tdms", "left"),
    ],
)
def test_arrays_become_channels(tmp_path: Path, write: Callable[[Path], None], kind: str, left: str) -> None:
    path = tmp_path / "recording.bin"  # the format is not in the name
    write(path)
    recording = read(path)
    assert recording.provenance.format == kind
    assert recording.provenance.metadata["operator"] == "nobody"
    assert recording.provenance.simulated is (kind == "hdf5")
    assert values(recording, "time", "s") == pytest.approx(TIME, abs=1e-12)
    assert values(recording, "angle", "deg") == pytest.approx(ANGLE, abs=1e-12)
    assert recording.need(left).values == pytest.approx(LEFT)


def test_names_omitted_arrays_of_another_length(tmp_path: Path) -> None:
    path = tmp_path / "one.mat"
    write_matlab(path)
    recording = read(path)
    assert recording.provenance.metadata["fs"] == "200"
    assert any("different length are omitted: short" in warning for warning in recording.warnings)


def test_rejects_truncated_tdms_without_printing(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "cut.tdms"
    write_tdms(path)
    path.write_bytes(path.read_bytes()[:-800])
    with pytest.raises(DataError, match="last part was cut off"):
        read(path)
    assert capfd.readouterr().err == ""


def test_matlab_version_4(tmp_path: Path) -> None:
    path = tmp_path / "old.mat"
    savemat(path, {"time": TIME, "left": LEFT}, format="4")
    assert read(path).need("left").values == pytest.approx(LEFT)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(DataError, match="save it again in MATLAB"):
        read(path)


@pytest.mark.parametrize("write", [write_matlab, write_matlab73, write_netcdf4, write_netcdf3, write_tdms])
def test_rejects_damaged_file_in_one_line(tmp_path: Path, write: Callable[[Path], None]) -> None:
    path = tmp_path / "damaged"
    write(path)
    data = path.read_bytes()
    rng = np.random.default_rng(5)
    for length in (600, len(data) // 2):
        path.write_bytes(data[:length])
        try:
            recording = read(path)
        except DataError as bad:
            assert "\n" not in str(bad)  # noqa: PT017
        else:  # intact parts may be read, but not as if they were complete
            assert len(recording.channels[0].values) < TIME.size or recording.warnings
    for _ in range(20):
        noisy = bytearray(data)
        for position in rng.integers(8, len(data), 30):
            noisy[position] ^= 0xFF
        path.write_bytes(noisy)
        try:
            read(path)
        except DataError as bad:
            assert "\n" not in str(bad)  # noqa: PT017  a damaged number may be a valid one


@pytest.mark.parametrize(("write", "module"), [(write_netcdf4, "h5py"), (write_tdms, "nptdms")])
def test_missing_extra_names_install_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable[[Path], None], module: str
) -> None:
    path = tmp_path / "one"
    write(path)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(DataError) as error:
        read(path)
    assert PACKAGES[module].command in str(error.value)


@pytest.mark.parametrize(
    ("word", "unit"), [("Volts", "V"), ("millivolts", "mV"), ("Degrees", "deg"), ("Seconds", "s"), ("Radian", "rad")]
)
def test_units_in_words(tmp_path: Path, word: str, unit: str) -> None:
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([ChannelObject("run", "some", LEFT, properties={"unit_string": word})])
    assert read(tmp_path / "a.tdms").channels[0].unit == unit


def test_column_names_of_matrix(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"data": np.column_stack([TIME, LEFT, RIGHT]).T, "fs": 200.0, "other": np.zeros((5, 2))})
    recording = read(path, columns=("time_s", "left_mV", "right_mV"))
    assert [(channel.name, channel.unit) for channel in recording.channels] == [
        ("time", "s"),
        ("left", "mV"),
        ("right", "mV"),
    ]
    assert recording.channels[1].values.tolist() == LEFT.tolist()
    with pytest.raises(DataError, match=r"no matrices of 4 columns; it contains data 3 by 400"):
        read(path, columns=("a", "b", "c", "d"))


@pytest.mark.parametrize("junk", [b"\xff\xfa\x81 noise", b"a\x01b\n"])
def test_error_for_junk_names_format_of_extension(tmp_path: Path, junk: bytes) -> None:
    (tmp_path / "run.nc").write_bytes(junk)
    with pytest.raises(DataError, match=r"run\.nc; is neither a netCDF file nor text"):
        read(tmp_path / "run.nc")
