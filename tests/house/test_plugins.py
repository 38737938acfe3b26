"""A laboratory's own package adds a printer, a format, a body, a finish and an instrument: each one file and one line.

The package of this test is a folder on the path with the metadata that pip would write; solen runs beside it in
an interpreter of its own.
"""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
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
from solen.recording.layout import find_layout
from solen.recording.table import read


def from_bytes(source):
    if not source.data.startswith(b"LABSPEC"):
        return None
    rows = source.text().replace("|", ",").splitlines()[1:]
    grid = of_text(replace(source, data="\\n".join(["wavelength_nm,T,R", *rows, ""]).encode()))
    return read(grid, find_layout(grid))


SPECTRUM = Format(from_bytes=from_bytes)
"""

BAR = """
from solen.curve import Segment
from solen.geometry import drawn_kind
from solen.geometry.drawing import Drawing, DrawnEmitter, Stroke

def draw(numbers):
    half, length = numbers["width_mm"] / 2, numbers["length_mm"]
    corners = [(-half, 0.0), (half, 0.0), (half, length), (0.0, length), (-half, length)]
    names = ["lens", "wall", "receiver-right", "receiver-left", "wall"]
    ends = corners[1:] + corners[:1]
    strokes = tuple(Stroke(n, Segment(a, b), n) for n, a, b in zip(names, corners, ends, strict=True))
    return Drawing(strokes, (DrawnEmitter((0.0, -1.0)),), (("pivot", (0.0, 0.0)),))

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


SERVED = """
import contextlib, io, json, sys
from solen.cli import run_command
for line in sys.stdin:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run_command(json.loads(line))
    print(json.dumps([code, out.getvalue(), err.getvalue()]), flush=True)
"""
"""Runs each command line that it is sent."""


class Lab:
    """Folder with the distribution `mylab`, as pip would install it, and an interpreter that finds it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        package, info = folder / "site" / "mylab", folder / "site" / "mylab-1.0.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: mylab\nVersion: 1.0\n", encoding="utf-8")
        (info / "entry_points.txt").write_text(ENTRY_POINTS, encoding="utf-8")
        (package / "printers").mkdir(parents=True)
        for inner in (package, package / "printers"):
            (inner / "__init__.py").write_text("", encoding="utf-8")
        for name, text in (("spectrum", SPECTRUM), ("bar", BAR), ("velvet", VELVET), ("stage", STAGE)):
            (package / f"{name}.py").write_text(text, encoding="utf-8")
        shipped = (files("solen.parts") / "printers" / "asiga-max-x27.toml").read_text(encoding="utf-8")
        printer = re.sub(r'(?m)^name = ".*"$', 'name = "Lab DLP"', shipped)
        (package / "printers" / "lab-dlp.toml").write_text(printer, encoding="utf-8")
        self.write("sensor.toml", template("paper-860"))
        path = os.pathsep.join(filter(None, [str(folder / "site"), os.environ.get("PYTHONPATH", "")]))
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVED],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            encoding="utf-8",
            cwd=folder,
            env=os.environ | {"PYTHONPATH": path},
        )

    def write(self, name: str, text: str) -> str:
        (self.folder / name).write_text(text, encoding="utf-8")
        return name

    def run(self, *arguments: str, code: int) -> tuple[str, str]:
        """What a command prints, and what it says on the other stream."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(json.dumps(arguments), file=self.process.stdin, flush=True)
        found, out, err = json.loads(self.process.stdout.readline())
        assert found == code, err
        return out, err

    def printed(self, *arguments: str) -> str:
        return self.run(*arguments, code=0)[0]

    def refused(self, *arguments: str) -> str:
        return self.run(*arguments, code=2)[1]

    def answer(self, *arguments: str) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.printed(*arguments, "--json"))
        return found


@contextmanager
def opened(folder: Path) -> Iterator[Lab]:
    made = Lab(folder)
    with made.process:
        yield made


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with opened(tmp_path_factory.mktemp("lab")) as made:
        yield made


def test_the_doctor_lists_what_was_added(lab: Lab) -> None:
    assert lab.answer("doctor")["plugins"] == {
        "solen.instruments": ["lab-board", "lab-stage"],
        "solen.formats": ["lab-spectrum"],
        "solen.body_kinds": ["lab-bar"],
        "solen.printers": ["lab-dlp"],
        "solen.finishes": ["lab-film", "lab-velvet"],
    }


def test_a_printer_is_listed_and_used(lab: Lab) -> None:
    assert "lab-dlp" in lab.printed("print", "printers")
    assert "Lab DLP" in lab.printed("print", "printers", "lab-dlp")


def test_a_file_of_the_format_is_read_by_a_command(lab: Lab) -> None:
    rows = "".join(f"{nm}|0.9|0.04\n" for nm in range(800, 900, 10))
    said = lab.printed("resin", "spectra", lab.write("layer.lab", f"LABSPEC 1\n{rows}"))
    assert "800" in said
    assert "890" in said


def test_a_body_is_checked_and_its_parameters_are_refused_by_name(lab: Lab) -> None:
    bar = lab.write("bar.toml", DESIGN)
    assert "bar" in lab.printed("check", bar)
    assert "right" in lab.printed("trace", bar, "--json")
    values = ("body.parameters.lenght_mm=3", "lens.focus_mm=25", "body.kind=lab-bra")
    parameter, lens, kind = (lab.refused("check", bar, "--set", value) for value in values)
    assert "body.parameters.lenght_mm" in parameter
    assert "length_mm" in parameter.partition(";")[2]
    assert "focus_mm" in lens
    assert "lab-bar" in kind


def test_a_rig_runs_on_the_instruments(lab: Lab) -> None:
    protocol = lab.write("protocol.toml", PROTOCOL)
    found = lab.answer("bench", "run", protocol, "--rig", lab.write("rig.toml", RIG), "--out", "out")
    assert (found["outcome"], found["simulated"]) == ("done", False)
    assert found["periods"] > 100
    rig = lab.write("rig.toml", RIG.replace('port = "COM9"', ""))
    assert "stage.port" in lab.refused("bench", "run", protocol, "--rig", rig, "--out", "two")
    rig = lab.write("rig.toml", RIG.replace('"lab-stage"', '"lab-board"'))
    line = lab.refused("bench", "run", protocol, "--rig", rig, "--out", "two")
    assert "stage.driver" in line
    assert "lab-stage" in line


def test_a_broken_package_is_named_when_it_is_used_and_not_before(tmp_path: Path) -> None:
    with opened(tmp_path) as lab:
        lab.write("site/mylab/bar.py", "import no_such_module\n")
        lab.printed("check", "sensor.toml")
        line = lab.refused("check", "sensor.toml", "--set", "body.kind=lab-bar")
    assert "lab-bar" in line
    assert "no_such_module" in line
    assert "mylab" in line


def walled(lab: Lab, name: str, finish: str, more: str = "") -> str:
    """A sensor whose stem has a finish."""
    return lab.write(name, f'{template("paper-860")}\n[[wall]]\nface = "[so]*-*"\nfinish = "{finish}"\n{more}')


def powers(printed: str) -> dict[str, float]:
    found = json.loads(printed)
    assert abs(sum(found["ledger"].values()) - 1.0) < 1e-9
    detectors = {side: reading["power"] for side, reading in found["detectors"].items()}
    return detectors | {"absorbed": found["ledger"]["absorbed"]}


@pytest.mark.parametrize("dimension", ["2d", "extruded"])
def test_a_finish_by_a_table_does_what_the_table_says(lab: Lab, dimension: str) -> None:
    """A table of 0.7 at all angles is a mirror of 0.7, in the plane and in space."""
    table = walled(lab, "table.toml", "lab-velvet")
    grey = walled(lab, "grey.toml", "mirror", "reflectance = 0.7")
    emitter = ("--set", "emitter.pattern=lambertian", "--set", "emitter.rays=512")
    options = ("--set", f"trace.dimension={dimension}", *emitter)
    names = (table, grey, walled(lab, "film.toml", "lab-film"))
    trace = ("--angle-deg", "-1", "--mode", "power", *options, "--json")
    one, other, film = (powers(lab.printed("trace", name, *trace)) for name in names)
    assert one == pytest.approx(other, abs=1e-12)
    assert one["absorbed"] > 0.003
    assert film["absorbed"] > 0.003
    assert film["right"] != pytest.approx(one["right"], abs=1e-3)


def test_a_finish_is_refused_where_it_says_nothing(lab: Lab) -> None:
    light = ("--set", "emitter.wavelength_nm=650", "--set", "material.index=1.44")
    unknown = lab.refused("check", walled(lab, "a.toml", "lab-satin"))
    scattering = lab.refused("check", walled(lab, "b.toml", "lab-velvet", 'scatter = "lambertian"'))
    other = lab.refused("trace", walled(lab, "c.toml", "lab-velvet"), *light)
    for name in ("lab-satin", "clear", "lab-velvet"):
        assert name in unknown
    assert "wall[0].scatter" in scattering
    assert "lab-velvet" in scattering
    assert "650 nm" in other
    assert "800 to 900 nm" in other
    counted = lab.printed("trace", walled(lab, "d.toml", "lab-velvet"), "--mode", "count")
    assert 'wall[0].finish = "lab-velvet" has no effect' in counted
