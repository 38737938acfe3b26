"""Files of spectrometers and test machines: all numbers, and damage rejected."""

import random
import struct
from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError, SolenError
from solen.material.cure.discs import CureOptions, curve_of_discs
from solen.material.cure.exposures import samples_of
from solen.material.rows import RowOptions, chosen_rows
from solen.recording import parameter, read, read_parts, spectra
from tests.recording import programs
from tests.recording.mutate import KINDS
from tests.recording.programs import FORCE, PERCENT, TIME, TRAVEL, WAVES


def saved(folder: Path, content: str | bytes) -> Path:
    path = folder / "file.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


SPECTRA = {
    "jasco": (programs.jasco(), "jasco", "transmittance", "%", PERCENT),
    "jasco, decimal comma": (programs.jasco(mark=","), "jasco", "transmittance", "%", PERCENT),
    "jasco, CSV": (programs.jasco(","), "jasco", "transmittance", "%", PERCENT),
    "PerkinElmer .asc": (programs.perkin_elmer(), "perkin-elmer", "transmittance", "%", PERCENT),
    "Thorlabs": (programs.thorlabs(), "thorlabs", "power", "dBm", [-value for value in PERCENT]),
}


@pytest.mark.parametrize("name", SPECTRA)
def test_reads_all_numbers_of_spectrum(tmp_path: Path, name: str) -> None:
    text, kind, quantity, unit, values = SPECTRA[name]
    recording = read(saved(tmp_path, text))
    (trace,) = spectra(recording)
    assert recording.provenance.format == kind
    assert (trace.channel.quantity, trace.channel.unit) == (quantity, unit)
    assert trace.wavelength_nm.tolist() == WAVES
    assert trace.channel.values.tolist() == values


@pytest.mark.parametrize("mark", [".", ","])
def test_avantes_converted_text(tmp_path: Path, mark: str) -> None:
    recording = read(saved(tmp_path, programs.avantes(mark)))
    assert recording.need("wavelength").to("nm").tolist() == WAVES
    assert recording.need("transmittance").values.tolist() == PERCENT
    assert recording.need("transmittance").unit == "%"


@pytest.mark.parametrize(
    ("name", "before", "after", "part"),
    [
        ("jasco", "NPOINTS\t40", "NPOINTS\t41", "40 rows, .* 41"),
        ("jasco", "XUNITS\tNANOMETERS", "XUNITS\tSeconds", "Seconds"),
        ("jasco", "410.0000\t", "411.0000\t", "410 is expected"),
        ("jasco", "MAXY\t89.9", "MAXY\t98.9", "MAXY"),
        ("jasco", "\r\n##### Ext", "\r\n410.0\t85.1\r\n##### Ext", "below the end mark"),
        ("PerkinElmer .asc", "410.000000\t", "410.000000", "line 36"),
        ("PerkinElmer .asc", "\r\n2.0\r\n40\r\n", "\r\n2.0\r\n39\r\n", "40 rows, .* 39"),
        ("PerkinElmer .asc", "#DATA", "#DATE", "marks the start"),
        ("Thorlabs", "[EndOfFile]", "", "marks the end"),
        ("Thorlabs", "nm_vac", "THz", "THz"),
    ],
)
def test_checks_header_against_rows(tmp_path: Path, name: str, before: str, after: str, part: str) -> None:
    text = SPECTRA[name][0]
    assert before in text
    with pytest.raises(DataError, match=part):
        read(saved(tmp_path, text.replace(before, after, 1)))


@pytest.mark.parametrize(
    "header",
    [
        *("Transmittance (%)", "Transmittance(%)", "Transmittance [%]", "% Transmittance", "%T", "T%", "Trans. (%)"),
        *("film 1 T (%)", "film 1 (%T)", "%T of film 1", "film.Sample %T", "Transmission %"),
    ],
)
@pytest.mark.parametrize("axis", ["nm", "Wave (nm)", "Wavelength nm."])
def test_headers_of_percent(tmp_path: Path, header: str, axis: str) -> None:
    rows = "".join(f"{w},{t}\n" for w, t in zip(WAVES, PERCENT, strict=True))
    (trace,) = spectra(read(saved(tmp_path, f"{axis},{header}\n{rows}")))
    assert trace.channel.quantity == "transmittance"
    assert trace.wavelength_nm.tolist() == WAVES
    assert trace.ratio() == pytest.approx(0.01 * np.array(PERCENT), rel=1e-12)


@pytest.mark.parametrize("separator", ["\t", ",", ";", " "])
def test_two_columns_without_header_are_a_spectrum(tmp_path: Path, separator: str) -> None:
    rows = [f"{w}{separator}{t}" for w, t in zip(WAVES, PERCENT, strict=True)]
    recording = read(saved(tmp_path, "\n".join([*rows, ""])))
    (trace,) = spectra(recording)
    assert (trace.wavelength_nm.tolist(), trace.channel.values.tolist()) == (WAVES, PERCENT)
    assert trace.channel.quantity == ""
    assert any("400 to 478 are assumed to be in nm" in warning for warning in recording.warnings)


def test_rejects_other_columns_without_header(tmp_path: Path) -> None:
    rows = [f"{t},{f}" for t, f in zip(TIME, FORCE, strict=True)]
    with pytest.raises(DataError, match="no header"):
        read(saved(tmp_path, "\n".join([*rows, ""])))


TESTS = {
    "MTS 793": (programs.mts(), 1),
    "MTS 793, two acquisitions": (programs.mts(2), 1),
    "Trapezium": (programs.trapezium(), 2),
    "Bluehill": (programs.bluehill(), 1),
    "Bluehill, three specimens": (programs.bluehill(3), 3),
    "testXpert side by side": (programs.side_by_side(), 2),
    "MTS TestSuite": (programs.mts_testsuite(), 1),
    "MTS TestSuite, text": (programs.mts_testsuite("\t", ""), 1),
    "Lloyd NEXYGEN": (programs.nexygen(), 1),
    "Lloyd NEXYGEN, tabs": (programs.nexygen("\t"), 1),
}
MACHINES = {"MTS TestSuite": "mts-testsuite", "Lloyd NEXYGEN": "lloyd-nexygen", "testXpert": "testxpert"}


@pytest.mark.parametrize("name", TESTS)
def test_reads_all_numbers_of_each_specimen(tmp_path: Path, name: str) -> None:
    text, count = TESTS[name]
    parts = list(read_parts(saved(tmp_path, text)))
    assert len(parts) == count
    for number, (_, part) in enumerate(parts):
        rows = slice(0, 40 - 5 * number) if "side" in name else slice(number, None)
        travel = part.find("displacement") or part.need("crosshead")
        kind = next((kind for name_, kind in MACHINES.items() if name.startswith(name_)), "test-machine")
        assert part.provenance.format == kind
        assert part.need("time").to("s").tolist() == TIME[rows]
        assert travel.to("mm").tolist() == TRAVEL[rows]
        assert part.need("force").to("N").tolist() == FORCE[rows]


def test_specimens_have_parameters_of_their_rows(tmp_path: Path) -> None:
    for text, key, values in (
        (programs.trapezium(), "Width", [6.0, 6.1]),
        (programs.bluehill(3), "Modulus", [3.0, 3.1, 3.2]),
    ):
        parts = list(read_parts(saved(tmp_path, text)))
        parameters = [parameter(part, key) for _, part in parts]
        assert [number for number, _ in filter(None, parameters)] == values
    assert [name for name, _ in read_parts(saved(tmp_path, programs.trapezium()))] == ["1 _ 1", "1 _ 2"]


def test_rejects_several_specimens_as_one_recording(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="2 specimens: 1 _ 1, 1 _ 2"):
        read(saved(tmp_path, programs.trapezium()))


@pytest.mark.parametrize(
    ("name", "before", "after", "part"),
    [
        ("Trapezium", "0.5,0.3", "x,0.3", "belong to no table"),
        ("Bluehill", "0.5,0.25", "0.5;0.25", "belong to no table"),
        ("MTS 793, two acquisitions", "2.0\t1.0\t", "2.0\t1.0", "belong to no table"),
        ("testXpert side by side", "\t0.5\t0.25\t", "\t0.5\tx\t", "belong to no table"),
        ("MTS TestSuite", '"0.5"\r\n', '"0.2"\r\n', "the time of a test must increase"),
        ("Lloyd NEXYGEN", "\r\n0.5,", "\r\n0.05,", "the time of a test must increase"),
    ],
)
def test_rejects_damage_in_specimen(tmp_path: Path, name: str, before: str, after: str, part: str) -> None:
    text = TESTS[name][0]
    assert before in text
    with pytest.raises(DataError, match=part):
        list(read_parts(saved(tmp_path, text.replace(before, after, 1))))


def spc(
    *, spectra: int = 1, exponent: int = -128, listed_x: bool = False, order: str = "<", short: bool = False
) -> bytes:
    """Return a file in the layout of SPC.H."""
    flags = short | (4 if spectra > 1 else 0) | (0x80 if listed_x else 0)
    version = 0x4B if order == "<" else 0x4C
    head = struct.pack(
        f"{order}BBBbIddIBB", flags, version, 0, exponent, len(WAVES), WAVES[0], WAVES[-1], spectra, 3, 128
    )
    data = head.ljust(512, b"\0")
    if listed_x:
        data += np.array(WAVES, f"{order}f4").tobytes()
    bits = 16 if short else 32
    for number in range(spectra):
        values = np.array(PERCENT) + number
        dtype = f"{order}f4" if exponent == -128 else f"{order}i{bits // 8}"
        counts = values if exponent == -128 else np.round(values * 2.0 ** (bits - exponent))
        sub = struct.pack(f"{order}BbHfffIIf4x", 0, exponent, number, float(number), 0.0, 0.0, len(WAVES), 0, 0.0)
        data += sub + counts.astype(dtype).tobytes()
    return data


@pytest.mark.parametrize("exponent", [-128, 8])
@pytest.mark.parametrize("listed_x", [False, True])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("count", [1, 3])
def test_spc(tmp_path: Path, exponent: int, listed_x: bool, order: str, count: int) -> None:
    recording = read(saved(tmp_path, spc(spectra=count, exponent=exponent, listed_x=listed_x, order=order)))
    traces = spectra(recording)
    assert len(traces) == count
    for number, trace in enumerate(traces):
        assert trace.wavelength_nm == pytest.approx(WAVES, abs=1e-4)
        assert (trace.channel.quantity, trace.channel.unit) == ("transmittance", "%")
        assert trace.channel.values == pytest.approx(np.array(PERCENT) + number, abs=1e-5)


def test_spc_with_16_bits(tmp_path: Path) -> None:
    (trace,) = spectra(read(saved(tmp_path, spc(exponent=8, short=True))))
    assert trace.channel.values == pytest.approx(PERCENT, abs=2.0**-8)


@pytest.mark.parametrize(
    ("position", "value", "part"),
    [(1, 0x4D, "old layout"), (28, 4, "axis type 4"), (4, 39, "cut off or damaged"), (0, 0x40, "different abscissas")],
)
def test_rejects_unsupported_spc_by_name(tmp_path: Path, position: int, value: int, part: str) -> None:
    data = bytearray(spc())
    data[position] = value
    with pytest.raises(DataError, match=part):
        read(saved(tmp_path, bytes(data)))


def test_damaged_spc_is_read_or_rejected(tmp_path: Path) -> None:
    """Abscissas and values are floating-point numbers, so damage without a change of length is undetectable."""
    intact, outcomes = spc(spectra=2), []
    for seed in range(300):
        rng = random.Random(seed)  # noqa: S311
        data, _ = KINDS[rng.choice(["byte", "bit", "lost", "added", "part lost", "truncated"])](rng, intact)
        try:
            outcomes.append(len(spectra(read(saved(tmp_path, data)))))
        except DataError:
            outcomes.append(0)
        assert len(data) == len(intact) or outcomes[-1] == 0, f"seed {seed}: a file of another length was read"
    assert {0, 2} <= set(outcomes)


def test_discs_in_columns_equal_discs_in_rows(tmp_path: Path) -> None:
    depth = {2.0: (61.0, 63.0), 4.0: (131.0, 127.0), 8.0: (199.0, 201.0), 16.0: (268.0, 271.0)}
    wide = "dose_mJ_per_cm2,disc 1 (um),disc 2 (um)\n" + "".join(f"{e},{a},{b}\n" for e, (a, b) in depth.items())
    long = "dose_mJ_per_cm2,thickness_um,disc\n"
    long += "".join(f"{e},{pair[n]},{n + 1}\n" for n in (0, 1) for e, pair in depth.items())
    trace, other = (curve_of_discs(read(saved(tmp_path, text)), CureOptions()) for text in (wide, long))
    assert (trace.Dp_um, trace.u_Dp_um, trace.Ec_mJ_per_cm2) == (other.Dp_um, other.u_Dp_um, other.Ec_mJ_per_cm2)


def test_discs_in_columns_need_unit(tmp_path: Path) -> None:
    text = "dose_mJ_per_cm2,disc 1,disc 2\n2,61,63\n4,131,127\n8,199,201\n"
    with pytest.raises(DataError, match="unit of thickness"):
        curve_of_discs(read(saved(tmp_path, text)), CureOptions())


@pytest.mark.parametrize(
    ("header", "scale"),
    [("T_2s (%),T_4s (%)", 1.0), ("T 2000 ms,T 4000 ms", 0.01), ("T_2_s,T_4_s", 0.01), ("2 s %T,4 s %T", 1.0)],
)
def test_exposures_in_column_names(tmp_path: Path, header: str, scale: float) -> None:
    rows = "".join(f"{w},{scale * t:.6f},{scale * (t - 1):.6f}\n" for w, t in zip(WAVES, PERCENT, strict=True))
    layers = samples_of(read(saved(tmp_path, f"wavelength_nm,{header}\n{rows}")))
    assert [layer.exposure_s for layer in layers] == [2.0, 4.0]
    assert layers[0].transmittance == pytest.approx(0.01 * np.array(PERCENT), abs=1e-8)


def test_maps_column_to_another_name(tmp_path: Path) -> None:
    text = "clock (s),way (mm),reading\n" + "".join(
        f"{a},{b},{c}\n" for a, b, c in zip(TIME, TRAVEL, FORCE, strict=True)
    )
    recording = read(saved(tmp_path, text))
    options = RowOptions(map=("way=displacement", "reading=force_N"))
    rows = chosen_rows(recording, options)
    assert rows.need("displacement").to("mm").tolist() == TRAVEL
    assert (rows.need("force").quantity, rows.need("force").to("N").tolist()) == ("force", FORCE)


@pytest.mark.parametrize(
    ("pair", "part"),
    [
        ("way", "stroke=displacement"),
        ("wy=force", "no such column"),
        ("way=force_N", "'N'.* mm"),
        ("way=clock", "clock already"),
    ],
)
def test_rejects_invalid_mapping(tmp_path: Path, pair: str, part: str) -> None:
    text = "clock (s),way (mm)\n" + "".join(f"{a},{b}\n" for a, b in zip(TIME, TRAVEL, strict=True))
    with pytest.raises(SolenError, match=part):
        chosen_rows(read(saved(tmp_path, text)), RowOptions(map=(pair,)))


def test_rows_match_specimens_by_number(tmp_path: Path) -> None:
    """The list has rows 1, 2 and 4 for four specimens, under other names."""
    text = programs.trapezium(4)
    lines = [line for line in text.split("\r\n") if not line.startswith('"1 _ 3","2')]
    lines = [line.replace('"1 _ ', '"', 1) if line.count(",") == 3 else line for line in lines]
    parts = read_parts(saved(tmp_path, "\r\n".join(lines)))
    assert [trace.provenance.metadata.get("Width", "") for _, trace in parts] == ["6.0 mm", "6.1 mm", "", "6.3 mm"]


def test_rejects_fewer_rows_than_unnamed_specimens(tmp_path: Path) -> None:
    text = programs.bluehill(4).replace('3,"2.2","3.2"\r\n', "")
    with pytest.raises(DataError, match="none of the 4 specimens"):
        list(read_parts(saved(tmp_path, text)))


@pytest.mark.parametrize(("right", "wrong", "part"), [("1.0", "2.0", "y factor"), ("0.0", "0.5", "y offset")])
def test_rejects_scaled_values_of_perkin_elmer(right: str, wrong: str, part: str, tmp_path: Path) -> None:
    text = programs.perkin_elmer().replace(f"\r\n{right}\r\n", f"\r\n{wrong}\r\n")
    with pytest.raises(DataError, match=part):
        read(saved(tmp_path, text))
