"""A calibration as code for a board: the angles in Python, MicroPython, C and on an AVR are those of the decoder."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from solen.analysis.calibration.decoder import Decoder
from solen.analysis.calibration.estimate import Calibration, calibrated
from solen.analysis.calibration.table import BoardTable
from solen.arrays import FloatArray
from tests.analysis.calibration_support import SHORT, training
from tests.analysis.simulated_support import Truth
from tests.bench.firmware_support import micropython


def calibration_of_truth() -> Calibration:
    return calibrated(training(Truth(noise_V=0.01, protocol=SHORT)))


def board_table(points: int = 33) -> BoardTable:
    calibration = calibration_of_truth()
    return BoardTable.of(calibration, points, name="S1", readings="in V, ambient light subtracted", version="0")


def readings() -> FloatArray:
    """Return readings on both branches with noise, and two far from any angle."""
    calibration, rng = calibration_of_truth(), np.random.default_rng(2)
    curve = calibration.curves_V[:, 2:-2:3].reshape(-1, 2)
    return np.concatenate([curve + rng.normal(0.0, 0.01, curve.shape), [[9.0, 9.0], [-4.0, 2.0]]])


def test_table_gives_angles_of_decoder() -> None:
    calibration, table, volts = calibration_of_truth(), board_table(), readings()
    expected = Decoder(calibration).decode(volts)
    angle_deg, u_deg, outside = run_python(table, volts).T
    spread_deg = 0.5 * (expected.high_deg[:, 0] - expected.low_deg[:, 0])
    inside = ~expected.outside
    assert np.abs(angle_deg - expected.angle_deg)[inside].max() < 0.5 * spread_deg[inside].max()
    assert (u_deg / spread_deg)[inside].mean() == pytest.approx(1.0, abs=0.3)
    assert outside[-2:].all()
    assert not outside[:-2].any()
    error_deg, sigma = table.deviation(calibration)
    assert error_deg < 0.1
    assert sigma < 0.5
    assert board_table(5).deviation(calibration)[0] > 2.0 * error_deg  # a coarse table has a larger error


def test_name_cannot_end_comment_of_source() -> None:
    table = BoardTable(np.ones((1, 9)), 1.0, name='S 1 (a)\\"\n""*/"\n#*/', readings='dark"""\\', version="0.1+b")
    assert table.python.startswith('"""Angles of a calibrated sensor: S 1 (a). Written by solen 0.1+b.')
    compile(table.python, "solen_decode.py", "exec")
    assert table.c.startswith("/* Angles of a calibrated sensor: S 1 (a). Written")
    assert "as in the calibration: dark." in table.c


PROGRAM = """
#include <stdio.h>
#include "solen_decode.h"
int main(void) {
    float left, right, angle, u;
    while (scanf("%f %f", &left, &right) == 2) {
        int on = solen_decode(left, right, &angle, &u);
        printf("%.6f %.6f %d\\n", angle, u, !on);
    }
}
"""


def run_python(table: BoardTable, volts: FloatArray) -> FloatArray:
    """Return angle, uncertainty and whether the reading is outside, (N, 3)."""
    namespace: dict[str, object] = {}
    exec(table.python, namespace)  # noqa: S102
    rows = [namespace["decode"](*row) for row in volts.tolist()]  # type: ignore[operator]
    return np.array(rows, np.float64)


def numbers(text: str) -> FloatArray:
    return np.array([row.split() for row in text.splitlines()], float)


def test_c_gives_same_angles(tmp_path: Path) -> None:
    compiler = shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("there is no C compiler")
    table, volts = board_table(), readings()
    (tmp_path / "solen_decode.h").write_text(table.c, encoding="utf-8")
    (tmp_path / "main.c").write_text(PROGRAM, encoding="utf-8")
    line = [compiler, "-std=c99", "-Wall", "-Wextra", "-Werror", str(tmp_path / "main.c")]
    subprocess.run([*line, "-lm", "-o", str(tmp_path / "main")], check=True)
    rows = "".join(f"{left:.7f} {right:.7f}\n" for left, right in volts.tolist())
    done = subprocess.run([str(tmp_path / "main")], input=rows, capture_output=True, text=True, check=True)
    assert numbers(done.stdout) == pytest.approx(run_python(table, volts), abs=2e-4)


@pytest.mark.evidence
def test_micropython_gives_same_angles(tmp_path: Path) -> None:
    command = micropython(tmp_path)
    if isinstance(command, str):
        pytest.skip(command)
    table, volts = board_table(), readings()
    loop = f"\nfor left, right in {volts.tolist()}:\n    print(*[float(value) for value in decode(left, right)])\n"
    done = subprocess.run(command, input=table.python + loop, capture_output=True, text=True, check=True)
    assert numbers(done.stdout) == pytest.approx(run_python(table, volts), abs=1e-6)


ON_AVR = """
#include <avr/io.h>
#include <avr/interrupt.h>
#include <avr/sleep.h>
#include <stdio.h>
#include "solen_decode.h"
static int put(char byte, FILE *to) {{
    (void)to;
    while (!(UCSR0A & (1 << UDRE0))) continue;
    UDR0 = byte;
    return 0;
}}
static FILE out = FDEV_SETUP_STREAM(put, NULL, _FDEV_SETUP_WRITE);
static const float volts[][2] = {{ {rows} }};
int main(void) {{
    UBRR0 = 3;
    UCSR0A = 1 << U2X0;
    UCSR0B = 1 << TXEN0;
    for (unsigned i = 0; i < sizeof volts / sizeof *volts; i++) {{
        float angle, u;
        int on = solen_decode(volts[i][0], volts[i][1], &angle, &u);
        fprintf(&out, "=%ld %ld %d\\n", (long)lroundf(angle * 1e4f), (long)lroundf(u * 1e4f), !on);
    }}
    cli();
    sleep_mode();
}}
"""


@pytest.mark.evidence
def test_avr_gives_same_angles(tmp_path: Path) -> None:
    missing = [name for name in ("avr-gcc", "simavr") if shutil.which(name) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)} not installed")
    table, volts = board_table(17), readings()[-24:]
    (tmp_path / "solen_decode.h").write_text(table.c, encoding="utf-8")
    rows = ", ".join(f"{{{left:.7f}f, {right:.7f}f}}" for left, right in volts.tolist())
    (tmp_path / "main.c").write_text(ON_AVR.format(rows=rows), encoding="utf-8")
    line = ["avr-gcc", "-mmcu=atmega328p", "-DF_CPU=16000000UL", "-Os", "-std=gnu99", str(tmp_path / "main.c")]
    subprocess.run([*line, "-lm", "-o", str(tmp_path / "main.elf")], check=True)
    run = ["simavr", "-m", "atmega328p", "-f", "16000000", str(tmp_path / "main.elf")]
    done = subprocess.run(run, capture_output=True, text=True, timeout=60, check=False)
    rows_out = np.array(re.findall(r"=(-?\d+) (-?\d+) ([01])", done.stdout + done.stderr), float)
    assert rows_out * [1e-4, 1e-4, 1.0] == pytest.approx(run_python(table, volts), abs=2e-3)
