"""Headers of tables of cured discs and of guides, and the mark of simulated tables."""

from pathlib import Path

import pytest

from solen.recording import read


def saved(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("header", "name", "quantity", "unit"),
    [
        ("exposure_s", "exposure", "time", "s"),
        ("exposure (s)", "exposure", "time", "s"),
        ("exposure_mJ_per_cm2", "exposure", "exposure", "mJ/cm2"),
        ("Belichtungszeit (s)", "Belichtungszeit", "time", "s"),
        ("signal_V", "signal", "voltage", "V"),
        ("signal (mW)", "signal", "power", "mW"),
        ("power_dBm", "power", "power", "dBm"),
    ],
)
def test_headers_of_exposures_and_signals(tmp_path: Path, header: str, name: str, quantity: str, unit: str) -> None:
    channel = read(saved(tmp_path, f"{header},thickness_um\n1,20\n2,30\n")).channels[0]
    assert (channel.name, channel.quantity, channel.unit) == (name, quantity, unit)


def test_exposure_without_unit_is_ambiguous(tmp_path: Path) -> None:
    channel = read(saved(tmp_path, "exposure,thickness_um\n1,20\n2,30\n")).channels[0]
    assert (channel.name, channel.quantity, channel.unit) == ("exposure", "", "")


@pytest.mark.parametrize("name", ["guide", "piece", "part", "disc"])
def test_numbers_of_guides_are_labels(tmp_path: Path, name: str) -> None:
    recording = read(saved(tmp_path, f"length_mm,power_mW,{name}\n10,1,7\n20,0.5,8\n"))
    assert recording.label(name) == ("7", "8")


@pytest.mark.parametrize(
    ("comment", "simulated"),
    [
        ("# simulated", True),
        ("# Simulated: Dp 110", True),
        ("# simulated, with noise", True),
        ("# simulation", True),
        ("# This table is simulated", True),
        ("# simulated: no", False),
        ("# This table is measured, not simulated", False),
        ("# measured after it was simulated", False),
        ("# simulatedly", False),
    ],
)
def test_simulation_mark_in_comment(tmp_path: Path, comment: str, simulated: bool) -> None:
    recording = read(saved(tmp_path, f"{comment}\nexposure_s,thickness_um\n1,20\n2,30\n"))
    assert recording.provenance.simulated is simulated
