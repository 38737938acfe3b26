"""Simulated files that pages assume a reader has, written when a block first names one."""

import csv
import io
import json
import re
import tomllib
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
import tifffile
import tomlkit
from PIL import Image

from solen.cli import run_command
from solen.lens import LineFocusLens
from solen.samples import sample, sample_files
from solen.spec import template
from tests.house.page_support import ROOT, blocks
from tests.recording.exports import tensile

Maker = Callable[[], bytes | str]
SHIPPED = sample_files()


@cache
def _columns(name: str) -> dict[str, list[str]]:
    """Columns of a sample, keyed by heading."""
    rows = csv.reader(line for line in sample(name).decode().splitlines() if not line.startswith("#"))
    headings, *values = rows
    return dict(zip(headings, map(list, zip(*values, strict=True)), strict=True))


def _table(columns: dict[str, list[str]] | dict[str, np.ndarray]) -> str:
    rows = zip(*columns.values(), strict=True)
    return "\n".join(["# simulated: yes", ",".join(columns), *(",".join(map(str, row)) for row in rows)]) + "\n"


def _rotation(headings: dict[str, str], sensor: str = "S1", time_scale: float = 1.0) -> Maker:
    """Return a maker of a recording of one sensor of the samples, with headings keyed by quantity."""

    def make() -> str:
        columns = _columns("rotation-simulated.csv")
        values = {"time": [f"{float(t) * time_scale:.6g}" for t in columns["time_s"]], "angle": columns["angle_deg"]}
        values |= {side: columns[f"{sensor}.{side} (V)"] for side in ("left", "right")}
        return _table({heading: values[name] for name, heading in headings.items()})

    return make


HEADINGS = {"time": "time_s", "angle": "angle_deg", "left": "left (V)", "right": "right (V)"}
LOGGED = {"time": "Clock (ms)", "angle": "stage", "left": "ai0", "right": "ai1"}
WITHOUT_ANGLE = {name: heading for name, heading in HEADINGS.items() if name != "angle"}


def _pressed() -> str:
    """Six presses with a load cell of 0.5 N per V that reads 0.8 V without load."""
    time = np.arange(0.0, 31.0, 0.02)
    depth = np.interp((time - 0.5) % 5.0, [0.0, 1.0, 2.0, 3.0, 5.0], [0.0, 0.3, 0.3, 0.0, 0.0]) * (time > 0.5)
    noise = np.random.default_rng(1).normal(0.0, 1e-4, (3, time.size))
    left, right = 2.0 + 2.0 * depth + noise[0], 3.0 - 3.0 * depth + noise[1]
    volts = 0.8 + 1.6 * depth + noise[2]
    table = {"time_s": time, "depth_mm": depth, "load cell (V)": volts, "left (V)": left, "right (V)": right}
    return _table({name: values.round(6) for name, values in table.items()})


def _waveform() -> str:
    """Two receivers with an emitter that is switched at 200 Hz."""
    time = np.arange(10_000) / 10_000.0
    lit = (time * 200.0) % 1.0 < 0.5
    noise = np.random.default_rng(2).normal(0.0, 1e-3, (2, time.size))
    return _table({"time_s": time, "left (V)": 4.0 - 1.5 * lit + noise[0], "right (V)": 4.0 - lit + noise[1]})


def _image() -> bytes:
    """The sample micrograph without its scale."""
    with io.BytesIO() as file:
        Image.fromarray(tifffile.imread(io.BytesIO(sample("lens-simulated.ome.tif")))).save(file, "PNG")
        return file.getvalue()


def _profile() -> str:
    """The 860 nm lens, with a deviation of 5 µm at its edges."""
    x = np.linspace(-2.0, 2.0, 401)
    lens = LineFocusLens(distance_mm=1.0, focus_mm=20.0, half_width_mm=2.0, design_index=1.44, y_focus_mm=20.0)
    z = lens.z_at(x, np.zeros_like(x)) - 0.005 * (x / 2.0) ** 2
    profile = {"solen": "lens profile", "schema": 1, "name": "print 3", "simulated": True, "edge": "top"}
    return json.dumps(profile | {"x_mm": x.tolist(), "z_mm": z.tolist(), "u_mm": [0.0005] * 401, "sources": []})


def _pixel() -> str:
    """Light of a 27 µm pixel, blurred by 16 µm, at steps of 2 µm."""
    x_um = np.arange(81) * 2.0 - 80.0
    inside = np.abs(x_um) <= 13.5
    profile = np.convolve(inside, np.exp(-((x_um / 16.0) ** 2) / 2.0), "same")
    return "\n".join(",".join(f"{value:.6g}" for value in row) for row in np.outer(profile, profile)) + "\n"


def _doses() -> str:
    discs = _columns("discs-simulated.csv")
    doses = [f"{13.0 * float(s):.6g}" for s in discs["exposure_s"]]
    return _table({"dose_mJ_per_cm2": doses, "thickness_um": discs["thickness_um"]})


def _compressed_cubes() -> str:
    """Strain and stress of the sample cube of 10 mm."""
    cube = _columns("cube-simulated.csv")
    strain, stress = (np.array(cube[name], float) for name in ("displacement (mm)", "force (N)"))
    return _table({"strain": strain / 10.0, "stress (MPa)": stress / 100.0})


def by_command(*line: str) -> None:
    """Run a command of solen that makes a file."""
    assert run_command([*line, "--quiet"]) == 0, line


def _layered() -> str:
    design = tomlkit.parse(template("solen-860"))
    design.setdefault("lens", {})["shape"] = "layered"
    return tomlkit.dumps(design)


def _loaded() -> str:
    """The 860 nm sensor with the tables in the first block of its page."""
    page = (ROOT / "docs" / "loads.md").read_text(encoding="utf-8")
    tables = next(block for block in blocks(page) if block.language == "toml")
    return tomlkit.dumps(tomllib.loads(template("paper-860")) | tomllib.loads(tables.text))


def _many_cycles() -> str:
    """Four hundred cycles of 2 s, whose amplitude decreases by 1 %."""
    time = np.arange(0.0, 800.0, 0.1)
    angle = np.interp(time % 2.0, [0.0, 0.5, 1.5, 2.0], [0.0, 3.0, -3.0, 0.0])
    noise = np.random.default_rng(3).normal(0.0, 1e-3, (2, time.size))
    swing = np.tanh(0.6 * angle) * (1.0 - 0.01 * time / 800.0)
    table = {
        "time_s": time,
        "angle_deg": angle,
        "left (V)": 2.5 - swing + noise[0],
        "right (V)": 2.5 + swing + noise[1],
    }
    return _table({name: values.round(6) for name, values in table.items()})


def _misprinted() -> str:
    """A spectrum with a letter within a number in line 33."""
    lines = ["wavelength_nm,T,R,A (%)", *(f"{nm},0.91,0.08,91.37" for nm in range(400, 480, 2))]
    lines[32] = lines[32].replace("91.37", "9l.37")
    return "\n".join(lines) + "\n"


def _written_by(file: str, *line: str) -> Maker:
    """Return a maker of a file that a command writes."""

    def make() -> bytes:
        by_command(*line)
        return Path(file).read_bytes()

    return make


def _calibration() -> bytes:
    Path("rotation.csv").write_bytes(sample("rotation-simulated.csv"))
    by_command("bench", "calibrate", "rotation.csv", "--sensor", "S1")
    return Path("rotation.S1.calibration.json").read_bytes()


def _rubber(power: float) -> Maker:
    """Return a maker of the nominal stress of a neo-Hookean rubber, 0.4 MPa (λ − λ^−power)."""

    def make() -> str:
        strain = np.linspace(0.0, 0.5, 60)
        stress = 0.4 * (1.0 + strain - (1.0 + strain) ** -power)
        return _table({"strain": strain.round(6), "stress (MPa)": stress.round(6)})

    return make


SCENE = json.dumps(
    {
        "version": 5,
        "objs": [
            {"type": "PointSource", "x": 100, "y": 100},
            {"type": "IdealLens", "p1": {"x": 200, "y": 50}, "p2": {"x": 200, "y": 150}, "focalLength": 100},
            {"type": "Detector", "p1": {"x": 400, "y": 50}, "p2": {"x": 400, "y": 150}},
        ],
    }
)
FILES: dict[str, Maker] = {
    "sensor.toml": lambda: template("paper-860"),
    "design.toml": lambda: template("paper-860"),
    "my-sensor/sensor.toml": lambda: template("paper-860"),
    "hand/sensor.toml": lambda: template("hand-860"),
    "lens.toml": _layered,
    "lens.json": _profile,
    "lens.png": _image,
    "log.csv": _rotation(LOGGED, time_scale=1000.0),
    "daq.csv": _rotation(WITHOUT_ANGLE),
    "stage.csv": _rotation({name: HEADINGS[name] for name in ("time", "angle")}),
    "press.csv": _pressed,
    "cell.toml": lambda: "[load_cell]\nN_per_V = 0.5\nu_sensitivity_percent = 0.5\n",
    "S1_lens_1.csv": _rotation(HEADINGS, "S1"),
    "S2_lens_1.csv": _rotation(HEADINGS, "S2"),
    "S3_lens_1.csv": _rotation(HEADINGS, "S3"),
    "S4_nolens_1.csv": _rotation(HEADINGS, "C"),
    "measured.csv": lambda: sample("layer-simulated.csv"),
    "resin.csv": lambda: sample("absorbance-simulated.csv"),
    "layers.csv": lambda: sample("exposures-simulated.csv"),
    "layer-on-pet.csv": lambda: sample("layer-simulated.csv"),
    "steps.csv": lambda: sample("greys-simulated.csv"),
    "curve.csv": _doses,
    "cubes.csv": _compressed_cubes,
    "film.csv": _misprinted,
    "long.csv": _many_cycles,
    "tension.tra": tensile,
    "tension.csv": _rubber(2.0),
    "shear.csv": _rubber(3.0),
    "bulge.csv": _rubber(5.0),
    "S1.calibration.json": _calibration,
    "sensor.calibration.json": _calibration,
    "coupon.stl": _written_by("made/grey-steps.stl", "print", "coupons", "--out", "made", "--only", "grey-steps"),
    "cure-discs.json": _written_by("made/cure-discs.json", "print", "coupons", "--out", "made", "--only", "cure-discs"),
    "pixel.csv": _pixel,
    "pillars.json": lambda: sample("features-simulated.json"),
    "holes.json": lambda: sample("features-simulated.json"),
    "turn.mp4": lambda: sample("marker-simulated.avi"),
    "scene.json": lambda: SCENE,
    **{f"cube{number}.csv": lambda: sample("cube-simulated.csv") for number in (1, 2, 3)},
    **{name.replace("-simulated", ""): partial(SHIPPED.__getitem__, name) for name in SHIPPED if "-simulated" in name},
}
"""Makers of files, keyed by their names on the pages; ``layer.csv`` is the sample ``layer-simulated.csv``."""
FILES_OF_PAGES: dict[str, dict[str, Maker]] = {
    "docs/ambient-light.md": {"log.csv": lambda: sample("switched-simulated.csv"), "daq.csv": _waveform},
    "docs/archive.md": {"recordings/rotation.csv": lambda: sample("rotation-simulated.csv")},
    "docs/loads.md": {"sensor.toml": _loaded},
    "docs/networks.md": {"sensor.toml": lambda: template("hand-860")},
    "docs/readout.md": {"my-sensor/sensor.toml": lambda: template("solen-860")},
}
"""Makers of files that differ on some pages."""


def give(page: str, text: str) -> None:
    """Write the files that a block names and that do not exist."""
    makers = FILES | FILES_OF_PAGES.get(page, {})
    for name, maker in makers.items():
        path = Path(name)
        mention = name if "recordings/" not in name else "recordings"
        if not path.exists() and re.search(rf"(?<![\w./-]){re.escape(mention)}(?!\w)", text):
            path.parent.mkdir(parents=True, exist_ok=True)
            content = maker()
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
    if "samples/" in text and not Path("samples").exists():
        by_command("project", "examples", "--out", "samples")
