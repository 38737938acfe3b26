"""Files exported by instruments of other laboratories: every trace, every number and every parameter in them."""

import csv
from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.recording import parameter, read, spectra


def test_reads_every_trace_of_cary_export(outside: Path) -> None:
    """Numbers are compared exactly with those of the columns of the file."""
    path = outside / "cary" / "AO_bonding_paper" / "orig_20150206_cary5000.csv"
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))[:55]
    recording = read(path)
    traces = spectra(recording)
    assert len(traces) == 61
    assert len({spectrum.channel.name for spectrum in traces}) == 61
    names = [name for name in rows[0] if name]
    assert [spectrum.channel.name.removesuffix(" (2)") for spectrum in traces] == names
    for number, spectrum in enumerate(traces):
        pairs = [(row[2 * number], row[2 * number + 1]) for row in rows[2:] if row[2 * number]]
        assert spectrum.wavelength_nm.tolist() == [float(wave) for wave, _ in pairs]
        assert spectrum.channel.values.tolist() == [float(value) for _, value in pairs]
        assert (spectrum.channel.quantity, spectrum.channel.unit) == ("transmittance", "%")
    assert recording.provenance.instrument == "Cary 5000"
    assert recording.provenance.date == "2015-02-06T13:45:42"
    assert [spectrum.channel.name for spectrum in traces if spectrum.channel.note] == ["empty_4_2"]
    assert sorted({spectrum.channel.values.size for spectrum in traces}) == [5, 53]


def test_reads_cleaned_table_in_unit_of_baseline(outside: Path) -> None:
    recording = read(outside / "cary" / "AO_bonding_paper" / "cln_20130218_cary5000.csv")
    by_name = {spectrum.channel.name: spectrum for spectrum in spectra(recording)}
    assert len(by_name) == 17
    assert by_name["VG05"].ratio()[by_name["VG05"].wavelength_nm == 2400.0] == pytest.approx(0.5333, abs=5e-5)


def test_index_of_silicon_drifts_between_repeats(outside: Path) -> None:
    """T = 2n/(n² + 1) of a lossless slab gives an index for each of the five repeats of bare silicon."""
    recording = read(outside / "cary" / "AO_bonding_paper" / "orig_20150206_cary5000.csv")
    by_name = {spectrum.channel.name: spectrum for spectrum in spectra(recording)}
    indices = []
    for repeat in range(1, 6):
        spectrum = by_name[f"VG05_1_{repeat}"]
        t = float(spectrum.ratio()[spectrum.wavelength_nm == 1775.0][0])
        indices.append(1.0 / t + np.sqrt(1.0 / t**2 - 1.0))
    assert indices[0] == pytest.approx(3.472, abs=5e-4)
    assert indices[-1] == pytest.approx(3.463, abs=5e-4)


def test_reads_testxpert_export_with_results_of_machine(outside: Path) -> None:
    recording = read(outside / "mechanics" / "zwick_TRA_ETFE" / "ETFE_specimen17.TRA.csv")
    assert (recording.provenance.format, recording.provenance.date) == ("testxpert", "2008-02-20")
    quantities = [channel.quantity for channel in recording.channels]
    assert quantities == ["time", "displacement", "force", "strain", "crosshead"]
    assert {channel.values.size for channel in recording.channels} == {18876}
    assert recording.need("displacement").values[0] == 6.8902e-05
    assert recording.need("strain").values[-1] == 309.236
    assert recording.warnings == []
    assert parameter(recording, "E-Modul") == (1127.12, "N/mm²")
    assert parameter(recording, "Kraftmaximum") == (37.9483, "N/mm²")
    assert parameter(recording, "Dehnung bei Fmax") == (306.402, "%")
    assert parameter(recording, "Dehnung bei Bruch") == (309.236, "%")
    assert parameter(recording, "Messlänge") is None


@pytest.mark.parametrize(("file", "rows"), [("Dragon Skin 20", 404), ("Ecoflex 00-30", 705), ("RTV615", 84)])
def test_reads_tensile_tests_with_parameters_above_columns(outside: Path, file: str, rows: int) -> None:
    recording = read(outside / "mechanics" / "SoftRoboticsMaterialsDB" / f"{file}.csv")
    quantities = [channel.quantity for channel in recording.channels]
    assert quantities == ["time", "true strain", "true stress", "strain", "stress"]
    assert {channel.values.size for channel in recording.channels} == {rows}
    assert recording.need("stress").unit == "MPa"
    assert recording.provenance.metadata["Specimen Length (mm)"] == "33"


@pytest.mark.parametrize(("test", "rows"), [("Treloar_1944_UT", 24), ("Meunier_2008_UT", 33), ("Meunier_2008_ET", 14)])
def test_reads_columns_without_header_if_named(outside: Path, test: str, rows: int) -> None:
    path = outside / "mechanics" / "hyperelastic" / f"{test}.txt"
    with pytest.raises(DataError, match="no header"):
        read(path)
    recording = read(path, columns=("stress_MPa", "stretch"))
    assert {channel.values.size for channel in recording.channels} == {rows}
    assert recording.need("stretch").values[-1] > 1.0


def test_reads_published_working_curves(outside: Path) -> None:
    recording = read(outside / "working_curve" / "published_Dp_Ec.csv")
    assert recording.label("resin") is not None
    assert recording.need("Dp").to("um")[:2].tolist() == [42.0, 53.0]
    assert recording.need("Ec").to("mJ/cm**2")[:2].tolist() == [18.3, 6.3]
