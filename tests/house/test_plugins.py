"""A laboratory's own package adds a printer, a format, a body, a finish and an instrument: each one file and one line.

The package of this test is a folder on the path with the metadata that pip would write; solen is run on it as a user
would, in an interpreter of its own.
"""

import json
import os
import re
import subprocess
import sys
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

from solen.spec import template

ENTRY_POINTS = """
[solen.printers]
lab-dlp = mylab.printers

[solen.formats]
lab-spectrum = mylab.spectrum:SPECTRUM

[solen.body_kinds]
lab-bar = mylab.bar:BAR

[solen.finishes]
lab-velvet = mylab.velvet:VELVET
lab-film = mylab.velvet:FILM

[solen.instruments]
lab-stage = mylab.stage:STAGE
lab-board = mylab.stage:BOARD
"""

SPECTRUM = """
from dataclasses import replace

from solen.recording import Format
from solen.recording.grid import of_text
from solen.recording.layout import find
from solen.recording.table import read


def from_bytes(source):
    if not source.data.startswith(b"LABSPEC"):
        return None
    rows = source.text().replace("|", ",").splitlines()[1:]
    grid = of_text(replace(source, data="\\n".join(["wavelength_nm,T,R", *rows, ""]).encode()))
    return read(grid, find(grid))


SPECTRUM = Format(from_bytes=from_bytes)
"""

BAR = """
from solen.curve import Segment
from solen.geometry import drawn_kind
from solen.geometry.drawing import Drawing, Lamp, Stroke

def draw(numbers):
    half, length = numbers["width_mm"] / 2, numbers["length_mm"]
    corners = [(-half, 0.0), (half, 0.0), (half, length), (0.0, length), (-half, length)]
    names = ["lens", "wall", "receiver-right", "receiver-left", "wall"]
    ends = corners[1:] + corners[:1]
    strokes = tuple(Stroke(n, Segment(a, b), n) for n, a, b in zip(names, corners, ends, strict=True))
    return Drawing(strokes, (Lamp((0.0, -1.0)),), (("pivot", (0.0, 0.0)),))

BAR = drawn_kind(draw, {"width_mm": 4.0, "length_mm": 20.0})
"""

STAGE = """
import numpy as np

from solen.bench.drivers import Driver
from solen.bench.frames import Layout, Losses, Periods
from solen.bench.simulated.stage import SimulatedStage


class Stage(SimulatedStage):
    last = None

    def __init__(self, clock, port):
        super().__init__(clock, "deg", name=f"lab stage at {port}")
        Stage.last = self


class Board:
    volts_per_count = 1e-4
    name = "lab board"

    def __init__(self, clock, layout, period_s):
        self.clock, self.layout, self.period_s, self.losses = clock, layout, period_s, Losses()
        self.next = 0

    def start(self):
        self.begun_s = self.clock.now_s()

    def read(self):
        due = int((self.clock.now_s() - self.begun_s) / self.period_s)
        number = np.arange(self.next, due)
        self.next = due
        angle = Stage.last.axis.positions(self.begun_s + number * self.period_s)
        counts = np.full((len(number), self.layout.emitters, 2, self.layout.receivers), 30_000, np.uint16)
        counts[:, 0, 0, 0] = 20_000 + 1_000 * angle
        counts[:, 0, 0, 1] = 20_000 - 1_000 * angle
        start_us = np.rint(number * self.period_s * 1e6).astype(np.int64)
        return Periods(number, start_us, np.zeros(len(number), np.uint8), counts)

    def stop(self):
        pass

    close = stop


STAGE = Driver("stage", lambda rig, clock: Stage(clock, rig.stage.port), needs="port")
BOARD = Driver("board", lambda rig, clock: Board(clock, Layout(rig.emitters, rig.inputs), 1.0 / rig.board.rate_hz))
"""

VELVET = """
from solen.scene import AngleTable, Finish, ScatterTable, Surface

VELVET = Finish(
    "mirror", Surface(table=AngleTable((0.0, 45.0, 90.0), (0.7, 0.7, 0.7))), wavelength_nm=(800.0, 900.0)
)
FILM = Finish(
    "refracting",
    Surface(
        table=AngleTable((0.0, 40.0, 90.0), (0.1, 0.3, 0.9), (0.8, 0.5, 0.0)),
        table_right=AngleTable((0.0, 90.0), (0.1, 0.9), (0.8, 0.0)),
        scatter=ScatterTable((0.0, 0.1, 0.5), (1.0, 0.2, 0.0), 0.5),
    ),
)
"""

RIG = """
schema = 1
name = "lab"
[stage]
driver = "lab-stage"
port = "COM9"
[board]
driver = "lab-board"
[[sensor]]
name = "A"
design = "sensor.toml"
emitter = 1
right = 1
left = 2
"""
DESIGN = """
schema = 1
name = "bar"
[material]
index = 1.5
[body]
kind = "lab-bar"
[body.parameters]
length_mm = 9.0
"""
PROTOCOL = """
schema = 1
name = "short"
cycles = 1
rest_s = 0.2
[[step]]
to_deg = -3.0
velocity_deg_per_s = 15.0
[[step]]
to_deg = 3.0
velocity_deg_per_s = 15.0
[[step]]
to_deg = 0.0
velocity_deg_per_s = 15.0
"""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """Folder with the distribution `mylab`, as pip would install it."""
    package, info = tmp_path / "site" / "mylab", tmp_path / "site" / "mylab-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mylab\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text(ENTRY_POINTS, encoding="utf-8")
    (package / "printers").mkdir(parents=True)
    for folder in (package, package / "printers"):
        (folder / "__init__.py").write_text("", encoding="utf-8")
    for name, text in (("spectrum", SPECTRUM), ("bar", BAR), ("velvet", VELVET), ("stage", STAGE)):
        (package / f"{name}.py").write_text(text, encoding="utf-8")
    shipped = (files("solen.parts") / "printers" / "asiga-max-x27.toml").read_text(encoding="utf-8")
    printer = re.sub(r'(?m)^name = ".*"$', 'name = "Lab DLP"', shipped)
    (package / "printers" / "lab-dlp.toml").write_text(printer, encoding="utf-8")
    (tmp_path / "sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    return tmp_path


EACH = """
import contextlib, io, json, sys
from solen.cli import run_command
answers = []
for line in json.load(sys.stdin):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run_command(line)
    answers.append((code, out.getvalue(), err.getvalue()))
print(json.dumps(answers))
"""
"""Runs several command lines in one interpreter, which starts once."""


def run(lab: Path, *arguments: str, given: str = "") -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join(filter(None, [str(lab / "site"), os.environ.get("PYTHONPATH", "")]))
    return subprocess.run(
        [sys.executable, *arguments],
        input=given,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        cwd=lab,
        env=os.environ | {"PYTHONPATH": path},
    )


def ran(lab: Path, *arguments: str, code: int = 0) -> subprocess.CompletedProcess[str]:
    done = run(lab, "-m", "solen", *arguments)
    assert done.returncode == code, done.stderr
    return done


def answers(lab: Path, *lines: tuple[str, ...], code: int) -> list[tuple[str, str]]:
    """What each command line prints, and what it says on the other stream."""
    done = run(lab, "-c", EACH, given=json.dumps(lines))
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert [each for each, _, _ in found] == [code] * len(lines), found
    return [(out, err) for _, out, err in found]


def printed(lab: Path, *lines: tuple[str, ...]) -> list[str]:
    return [out for out, _ in answers(lab, *lines, code=0)]


def refused(lab: Path, *lines: tuple[str, ...]) -> list[str]:
    return [err for _, err in answers(lab, *lines, code=2)]


def answer(lab: Path, *arguments: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(ran(lab, *arguments, "--json").stdout)
    return found


def test_the_doctor_lists_what_was_added(lab: Path) -> None:
    assert answer(lab, "doctor")["plugins"] == {
        "solen.instruments": ["lab-board", "lab-stage"],
        "solen.formats": ["lab-spectrum"],
        "solen.body_kinds": ["lab-bar"],
        "solen.printers": ["lab-dlp"],
        "solen.finishes": ["lab-film", "lab-velvet"],
    }


def test_a_printer_is_listed_and_used(lab: Path) -> None:
    names, one = printed(lab, ("print", "printers"), ("print", "printers", "lab-dlp"))
    assert "lab-dlp" in names
    assert "Lab DLP" in one


def test_a_file_of_the_format_is_read_by_a_command(lab: Path) -> None:
    rows = "".join(f"{nm}|0.9|0.04\n" for nm in range(800, 900, 10))
    (lab / "layer.lab").write_text(f"LABSPEC 1\n{rows}", encoding="utf-8")
    said = ran(lab, "resin", "spectra", "layer.lab").stdout
    assert "800" in said
    assert "890" in said


def test_a_body_is_checked_and_its_parameters_are_refused_by_name(lab: Path) -> None:
    (lab / "bar.toml").write_text(DESIGN, encoding="utf-8")
    checked, traced = printed(lab, ("check", "bar.toml"), ("trace", "bar.toml", "--json"))
    assert "bar" in checked
    assert "right" in traced
    values = ("body.parameters.lenght_mm=3", "lens.focus_mm=25", "body.kind=lab-bra")
    parameter, lens, kind = refused(lab, *(("check", "bar.toml", "--set", value) for value in values))
    assert "body.parameters.lenght_mm" in parameter
    assert "length_mm" in parameter.partition(";")[2]
    assert "focus_mm" in lens
    assert "lab-bar" in kind


def test_a_rig_runs_on_the_instruments(lab: Path) -> None:
    (lab / "rig.toml").write_text(RIG, encoding="utf-8")
    (lab / "protocol.toml").write_text(PROTOCOL, encoding="utf-8")
    found = answer(lab, "bench", "run", "protocol.toml", "--rig", "rig.toml", "--out", "out")
    assert (found["outcome"], found["simulated"]) == ("done", False)
    assert found["periods"] > 100
    (lab / "rig.toml").write_text(RIG.replace('port = "COM9"', ""), encoding="utf-8")
    line = ran(lab, "bench", "run", "protocol.toml", "--rig", "rig.toml", "--out", "two", code=2).stderr
    assert "stage.port" in line
    (lab / "rig.toml").write_text(RIG.replace('"lab-stage"', '"lab-board"'), encoding="utf-8")
    line = ran(lab, "bench", "run", "protocol.toml", "--rig", "rig.toml", "--out", "two", code=2).stderr
    assert "stage.driver" in line
    assert "lab-stage" in line


def test_a_broken_package_is_named_when_it_is_used_and_not_before(lab: Path) -> None:
    (lab / "site" / "mylab" / "bar.py").write_text("import no_such_module\n", encoding="utf-8")
    assert ran(lab, "check", "sensor.toml").returncode == 0
    line = ran(lab, "check", "sensor.toml", "--set", "body.kind=lab-bar", code=2).stderr
    assert "lab-bar" in line
    assert "no_such_module" in line
    assert "mylab" in line


def walled(lab: Path, name: str, finish: str, more: str = "") -> str:
    """A sensor whose stem has a finish."""
    text = (lab / "sensor.toml").read_text(encoding="utf-8")
    (lab / name).write_text(f'{text}\n[[wall]]\nface = "[so]*-*"\nfinish = "{finish}"\n{more}', encoding="utf-8")
    return name


def powers(printed: str) -> dict[str, float]:
    found = json.loads(printed)
    assert abs(sum(found["ledger"].values()) - 1.0) < 1e-9
    detectors = {side: reading["power"] for side, reading in found["detectors"].items()}
    return detectors | {"absorbed": found["ledger"]["absorbed"]}


@pytest.mark.parametrize("dimension", ["2d", "extruded"])
def test_a_finish_by_a_table_does_what_the_table_says(lab: Path, dimension: str) -> None:
    """A table of 0.7 at all angles is a mirror of 0.7, in the plane and in space."""
    table = walled(lab, "table.toml", "lab-velvet")
    grey = walled(lab, "grey.toml", "mirror", "reflectance = 0.7")
    emitter = ("--set", "emitter.pattern=lambertian", "--set", "emitter.rays=512")
    options = ("--set", f"trace.dimension={dimension}", *emitter)
    names = (table, grey, walled(lab, "film.toml", "lab-film"))
    trace = ("--angle-deg", "-1", "--mode", "power", *options, "--json")
    one, other, film = map(powers, printed(lab, *(("trace", name, *trace) for name in names)))
    assert one == pytest.approx(other, abs=1e-12)
    assert one["absorbed"] > 0.003
    assert film["absorbed"] > 0.003
    assert film["right"] != pytest.approx(one["right"], abs=1e-3)


def test_a_finish_is_refused_where_it_says_nothing(lab: Path) -> None:
    light = ("--set", "emitter.wavelength_nm=650", "--set", "material.index=1.44")
    unknown, scattering, other = refused(
        lab,
        ("check", walled(lab, "a.toml", "lab-satin")),
        ("check", walled(lab, "b.toml", "lab-velvet", 'scatter = "lambertian"')),
        ("trace", walled(lab, "c.toml", "lab-velvet"), *light),
    )
    for name in ("lab-satin", "clear", "lab-velvet"):
        assert name in unknown
    assert "wall[0].scatter" in scattering
    assert "lab-velvet" in scattering
    assert "light of 650 nm" in other
    assert "800 to 900 nm" in other
    counted = ran(lab, "trace", walled(lab, "d.toml", "lab-velvet"), "--mode", "count").stdout
    assert 'wall[0].finish = "lab-velvet" has no effect' in counted
