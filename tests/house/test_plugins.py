"""A plug-in package adds a printer, a file format, a body kind, finishes and instruments.

The package of this test is a folder on the path with the metadata that pip would write; solen runs in a separate
interpreter that finds it.
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


SERVER = """
import contextlib, io, json, sys
from solen.cli import run_command
for line in sys.stdin:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run_command(json.loads(line))
    print(json.dumps([code, out.getvalue(), err.getvalue()]), flush=True)
"""
"""Program that runs each command line that it receives."""


class Lab:
    """Folder with the distribution `mylab` as installed by pip, and an interpreter that finds it."""

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
            [sys.executable, "-c", SERVER],
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
        """Run a command; return its stdout and stderr."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(json.dumps(arguments), file=self.process.stdin, flush=True)
        exit_code, out, err = json.loads(self.process.stdout.readline())
        assert exit_code == code, err
        return out, err

    def printed(self, *arguments: str) -> str:
        return self.run(*arguments, code=0)[0]

    def refused(self, *arguments: str) -> str:
        return self.run(*arguments, code=2)[1]

    def json(self, *arguments: str) -> dict[str, Any]:
        result: dict[str, Any] = json.loads(self.printed(*arguments, "--json"))
        return result


@contextmanager
def running_lab(folder: Path) -> Iterator[Lab]:
    lab = Lab(folder)
    with lab.process:
        yield lab


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    with running_lab(tmp_path_factory.mktemp("lab")) as running:
        yield running


def test_doctor_lists_plugins(lab: Lab) -> None:
    assert lab.json("doctor")["plugins"] == {
        "solen.instruments": ["lab-board", "lab-stage"],
        "solen.formats": ["lab-spectrum"],
        "solen.body_kinds": ["lab-bar"],
        "solen.printers": ["lab-dlp"],
        "solen.finishes": ["lab-film", "lab-velvet"],
    }


def test_printer_is_listed(lab: Lab) -> None:
    assert "lab-dlp" in lab.printed("print", "printers")
    assert "Lab DLP" in lab.printed("print", "printers", "lab-dlp")


def test_command_reads_file_of_plugin_format(lab: Lab) -> None:
    rows = "".join(f"{nm}|0.9|0.04\n" for nm in range(800, 900, 10))
    lines = lab.printed("resin", "spectra", lab.write("layer.lab", f"LABSPEC 1\n{rows}"))
    assert "800" in lines
    assert "890" in lines


def test_body_kind_is_used_and_its_parameters_are_checked(lab: Lab) -> None:
    bar = lab.write("bar.toml", DESIGN)
    assert "bar" in lab.printed("check", bar)
    assert "right" in lab.printed("trace", bar, "--json")
    values = ("body.parameters.lenght_mm=3", "lens.focus_mm=25", "body.kind=lab-bra")
    parameter, lens, kind = (lab.refused("check", bar, "--set", value) for value in values)
    assert "body.parameters.lenght_mm" in parameter
    assert "length_mm" in parameter.partition(";")[2]
    assert "focus_mm" in lens
    assert "lab-bar" in kind


def test_rig_runs_with_plugin_instruments(lab: Lab) -> None:
    protocol = lab.write("protocol.toml", PROTOCOL)
    result = lab.json("bench", "run", protocol, "--rig", lab.write("rig.toml", RIG), "--out", "out")
    assert (result["outcome"], result["simulated"]) == ("done", False)
    assert result["periods"] > 100
    rig = lab.write("rig.toml", RIG.replace('port = "COM9"', ""))
    assert "stage.port" in lab.refused("bench", "run", protocol, "--rig", rig, "--out", "two")
    rig = lab.write("rig.toml", RIG.replace('"lab-stage"', '"lab-board"'))
    line = lab.refused("bench", "run", protocol, "--rig", rig, "--out", "two")
    assert "stage.driver" in line
    assert "lab-stage" in line


def test_broken_plugin_is_reported_only_when_used(tmp_path: Path) -> None:
    with running_lab(tmp_path) as lab:
        lab.write("site/mylab/bar.py", "import no_such_module\n")
        lab.printed("check", "sensor.toml")
        line = lab.refused("check", "sensor.toml", "--set", "body.kind=lab-bar")
    assert "lab-bar" in line
    assert "no_such_module" in line
    assert "mylab" in line


def with_wall(lab: Lab, name: str, finish: str, further: str = "") -> str:
    """Write a design whose stem has a finish."""
    return lab.write(name, f'{template("paper-860")}\n[[wall]]\nface = "[so]*-*"\nfinish = "{finish}"\n{further}')


def powers(printed: str) -> dict[str, float]:
    result = json.loads(printed)
    assert abs(sum(result["ledger"].values()) - 1.0) < 1e-9
    detectors = {side: reading["power"] for side, reading in result["detectors"].items()}
    return detectors | {"absorbed": result["ledger"]["absorbed"]}


@pytest.mark.parametrize("dimension", ["2d", "extruded"])
def test_finish_with_table_agrees_with_mirror(lab: Lab, dimension: str) -> None:
    """A table of 0.7 at all angles equals a mirror of reflectance 0.7, in the plane and in space."""
    table = with_wall(lab, "table.toml", "lab-velvet")
    mirror = with_wall(lab, "grey.toml", "mirror", "reflectance = 0.7")
    emitter = ("--set", "emitter.pattern=lambertian", "--set", "emitter.rays=512")
    options = ("--set", f"trace.dimension={dimension}", *emitter)
    names = (table, mirror, with_wall(lab, "film.toml", "lab-film"))
    trace = ("--angle-deg", "-1", "--mode", "power", *options, "--json")
    by_table, by_mirror, film = (powers(lab.printed("trace", name, *trace)) for name in names)
    assert by_table == pytest.approx(by_mirror, abs=1e-12)
    assert by_table["absorbed"] > 0.003
    assert film["absorbed"] > 0.003
    assert film["right"] != pytest.approx(by_table["right"], abs=1e-3)


def test_refuses_unusable_finish(lab: Lab) -> None:
    red = ("--set", "emitter.wavelength_nm=650", "--set", "material.index=1.44")
    unknown = lab.refused("check", with_wall(lab, "a.toml", "lab-satin"))
    scattering = lab.refused("check", with_wall(lab, "b.toml", "lab-velvet", 'scatter = "lambertian"'))
    wavelength = lab.refused("trace", with_wall(lab, "c.toml", "lab-velvet"), *red)
    for name in ("lab-satin", "clear", "lab-velvet"):
        assert name in unknown
    assert "wall[0].scatter" in scattering
    assert "lab-velvet" in scattering
    assert "650 nm" in wavelength
    assert "800 to 900 nm" in wavelength
    counted = lab.printed("trace", with_wall(lab, "d.toml", "lab-velvet"), "--mode", "count")
    assert 'wall[0].finish = "lab-velvet" has no effect' in counted
