"""JCAMP-DX files: pairs, and a uniform axis with plain or compressed values."""

from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.recording import read, spectra

COUNTS = [round(5000.0 + 4000.0 * np.sin(0.2 * n)) for n in range(60)] + [900] * 6


def squeezed(value: int) -> str:
    """Return a number whose first digit is a pseudo-digit with the sign."""
    letters = "@ABCDEFGHI" if value >= 0 else "@abcdefghi"
    digits = str(abs(value))
    return letters[int(digits[0])] + digits[1:]


def difference(value: int) -> str:
    letters = "%JKLMNOPQR" if value >= 0 else "%jklmnopqr"
    digits = str(abs(value))
    return letters[int(digits[0])] + digits[1:]


def repeated(count: int) -> str:
    return " STUVWXYZs"[int(str(count)[0])] + str(count)[1:]


def uniform_lines(form: str, first: float, step: float, per_line: int = 9) -> list[str]:
    """Return the lines of COUNTS; a line of differences begins with the last value of the previous one."""
    lines, position = [], 0
    while position < len(COUNTS):
        part = COUNTS[position : position + per_line]
        first_index = position
        if form == "differences" and position:
            part, first_index = [COUNTS[position - 1], *part], position - 1
        x = f"{first + step * first_index:.3f}"
        if form == "plain":
            lines.append(" ".join([x, *map(str, part)]))
        elif form == "squeezed":
            lines.append(x + "".join(map(squeezed, part)))
        else:
            steps = np.diff(part).tolist()
            text, number = x + squeezed(part[0]), 0
            while number < len(steps):
                run = next((n for n in range(number, len(steps)) if steps[n] != steps[number]), len(steps)) - number
                text += difference(steps[number]) + (repeated(run) if run > 1 else "")
                number += run
            lines.append(text)
        position += per_line
    return lines


def jcamp(form: str = "plain", x_units: str = "NANOMETERS", y_units: str = "TRANSMITTANCE", step: float = 2.0) -> str:
    first, factor = 400.0, 1e-4
    last = first + step * (len(COUNTS) - 1)
    head = ["##TITLE=film 1", "##JCAMP-DX=4.24 $$ of a test", "##DATA TYPE=UV/VIS SPECTRUM", "##ORIGIN=nobody"]
    head += [f"##XUNITS={x_units}", f"##YUNITS={y_units}", f"##FIRSTX={first}", f"##LASTX={last}"]
    head += [f"##NPOINTS={len(COUNTS)}", f"##FIRSTY={factor * COUNTS[0]:.6f}"]
    head += [f"##MAXY={factor * max(COUNTS):.6f}", f"##MINY={factor * min(COUNTS):.6f}"]
    if form == "pairs":
        body = [f"{first + step * n:.3f}, {factor * count:.4f}" for n, count in enumerate(COUNTS)]
        return "\r\n".join([*head, "##XYPOINTS=(XY..XY)", *body, "##END=", ""])
    head += ["##XFACTOR=1.0", f"##YFACTOR={factor}", f"##DELTAX={step}"]
    return "\r\n".join([*head, "##XYDATA=(X++(Y..Y))", *uniform_lines(form, first, step), "##END=", ""])


def saved(folder: Path, text: str) -> Path:
    (folder / "file.jdx").write_text(text, encoding="utf-8", newline="")
    return folder / "file.jdx"


@pytest.mark.parametrize("form", ["pairs", "plain", "squeezed", "differences"])
@pytest.mark.parametrize("step", [2.0, -0.5])
def test_reads_all_numbers(tmp_path: Path, form: str, step: float) -> None:
    recording = read(saved(tmp_path, jcamp(form, step=step)))
    assert recording.provenance.format == "jcamp-dx"
    (trace,) = spectra(recording)
    assert trace.channel.quantity == "transmittance"
    assert trace.wavelength_nm == pytest.approx(400.0 + step * np.arange(len(COUNTS)), abs=1e-9)
    assert trace.ratio() == pytest.approx(1e-4 * np.array(COUNTS), abs=1e-12)


def test_rejects_pairs_out_of_order(tmp_path: Path) -> None:
    text = jcamp("pairs")
    for position in ("402.000", "430.000"):
        with pytest.raises(DataError, match="reverses at"):
            read(saved(tmp_path, text.replace("432.000,", f"{position},", 1)))


def test_all_forms_of_a_line() -> None:
    """The numbers 1, 2, 3, 3: plain, squeezed, as differences, and with a repetition."""
    from solen.recording.jcamp import read as reader
    from solen.recording.source import Source

    for line in ("1 1 2 3 3", "1+1+2+3+3", "1ABCC", "1AJJ%", "1ABCT"):
        head = "##TITLE=x\n##XUNITS=NANOMETERS\n##FIRSTX=1\n##LASTX=4\n##NPOINTS=4\n"
        text = f"{head}##XYDATA=(X++(Y..Y))\n{line}\n##END=\n"
        assert reader(Source(Path("x"), text.encode())).channels[-1].values.tolist() == [1.0, 2.0, 3.0, 3.0]


def test_wavelengths_from_wavenumbers(tmp_path: Path) -> None:
    recording = read(saved(tmp_path, jcamp(x_units="1/CM", y_units="% TRANSMITTANCE", step=10.0)))
    (trace,) = spectra(recording)
    assert trace.wavelength_nm[0] == pytest.approx(25_000.0)
    assert trace.channel.unit == "%"
    assert recording.need("wavenumber").unit == "1/cm"


@pytest.mark.parametrize(
    ("before", "after", "part"),
    [
        ("##NPOINTS=66", "##NPOINTS=67", "66 points|begins at|comes next"),
        ("##END=", "", "no END"),
        ("##DATA TYPE=UV/VIS SPECTRUM", "##DATA TYPE=LINK", "several blocks"),
        ("##XUNITS=NANOMETERS", "##XUNITS=SECONDS", "SECONDS"),
        ("(X++(Y..Y))", "(X++(R..R))", r"X\+\+\(R"),
        ("418.000 ", "436.000 ", "418 is expected"),
        ("##FIRSTY=0.5", "##FIRSTY=0.7", "FIRSTY"),
    ],
)
def test_checks_header_against_numbers(tmp_path: Path, before: str, after: str, part: str) -> None:
    text = jcamp()
    assert before in text
    with pytest.raises(DataError, match=part):
        read(saved(tmp_path, text.replace(before, after, 1)))
