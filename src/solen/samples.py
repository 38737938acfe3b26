"""Sample data for every command, which `solen project examples` copies and the tutorials use.

All data are simulated. Tables state this in their first line, and the names of all files of data contain it. Designs,
protocols and rigs define what is simulated.
"""

from pathlib import Path
from typing import NamedTuple

from solen.bench.starter import starter_files
from solen.results import Result
from solen.spec import template

FOLDER = Path(__file__).parent / "examples"


class Sample(NamedTuple):
    """A file of simulated measurements: its name without ``-simulated``, its content, and a command for it."""

    name: str
    content: str
    command: str


MEASURED = (
    Sample(
        "layer.csv", "T and R of a printed layer of 50 µm", "resin index FILE --thickness-um 50 --u-T 0.001 --u-R 0.001"
    ),
    Sample("guides.csv", "power transmitted by guides of five lengths", "resin cutback FILE"),
    Sample("discs.csv", "thickness of cured discs", "resin cure FILE --irradiance-mW-per-cm2 13"),
    Sample("absorbance.csv", "absorbance of 93 µm of liquid resin", "resin penetration FILE --path-um 93 --led-nm 385"),
    Sample("exposures.csv", "T of layers exposed for 2, 4 and 6 s", "resin exposures FILE"),
    Sample(
        "cube.csv", "force on a cube of 10 mm, compressed twice", "resin stiffness FILE --cube-mm 10 --fit neo-hookean"
    ),
    Sample("pillars.png", "the group-a coupon", "print fidelity FILE --coupon group-a --um-per-px 14"),
    Sample("holes.png", "the holes coupon", "print fidelity FILE --coupon holes --um-per-px 14"),
    Sample("features.json", "measured sizes of a coupon", "print calibrate FILE --out printer.toml"),
    Sample("greys.csv", "discs of the grey-steps coupon", "print grey FILE --u-thickness-um 2"),
    Sample("micrometer.png", "a stage micrometer, 10 µm per line", "print scale FILE --spacing-mm 0.01"),
    Sample("lens.ome.tif", "a printed lens, with a bump and a dimple", "print inspect FILE --design sensor.toml"),
    Sample("rotation.csv", "three prints with a lens and one without", "bench analyse FILE"),
    Sample("rotation.csv", "part of this recording, S1, for calibration", "bench calibrate FILE --sensor S1"),
    Sample(
        "again.csv",
        "print S1 on another day, moved by hand",
        "bench decode rotation-simulated.S1.calibration.json FILE",
    ),
    Sample("switched.csv", "a receiver under a switched emitter", "bench demodulate FILE"),
    Sample("marker.avi", "a marker that turns by ±3°", "bench video FILE --out turn.csv"),
    Sample("interrupted.journal", "a run on a rig that was interrupted", "bench recover FILE"),
)
DESIGNS = {
    "sensor.toml": ("solen-860", "the 860 nm sensor with an LED, in space", "run sensor.toml --out results"),
    "press.toml": ("press-860", "a soft body under a finger", "deform press.toml"),
    "hand.toml": ("hand-860", "a network of guides", "check hand.toml"),
}
"""Template, description and command for each design file."""
SCENE = "scene.json"
BENCH = "bench"
"""Subfolder for protocols and simulated rigs, the same as those of `solen bench new`."""


class Samples(Result):
    """Sample data copied into a folder: the folder and the number of files; all data are simulated."""

    folder: Path
    count: int
    simulated: bool = True


def simulated_name(name: str) -> str:
    """Return the file name of a sample: ``layer-simulated.csv`` for ``layer.csv``."""
    stem, _, ending = name.partition(".")
    return f"{stem}-simulated.{ending}"


def sample(name: str) -> bytes:
    """Return the content of the sample with this file name: ``discs-simulated.csv``."""
    return (FOLDER / name).read_bytes()


def sample_files() -> dict[str, bytes]:
    """Return all sample data, keyed by path within the target folder, with a README.md that describes each file."""
    measured = {name: sample(name) for name in map(simulated_name, (sample_row.name for sample_row in MEASURED))}
    designs = {name: template(shipped).encode() for name, (shipped, _, _) in DESIGNS.items()}
    bench = {f"{BENCH}/{name}.toml": text.encode() for name, text in starter_files().items()}
    return {"README.md": readme().encode(), SCENE: sample(SCENE)} | designs | measured | bench


def readme() -> str:
    """Return the README: a table of the files with their contents, and a command for each."""
    rows = [(name, content, command) for name, (_, content, command) in DESIGNS.items()]
    rows.append((SCENE, "a scene: two ovals in glass, a source, a screen", f"trace {SCENE}"))
    named = ((simulated_name(sample_row.name), sample_row) for sample_row in MEASURED)
    rows += [(name, sample_row.content, sample_row.command.replace("FILE", name)) for name, sample_row in named]
    rows.append(
        (f"{BENCH}/", "protocols, simulated rigs and their designs", "bench run rotation.toml --rig rig.toml --out .")
    )
    table = "\n".join(f"| `{name}` | {content} | `solen {command}` |" for name, content, command in rows)
    return f"{INTRODUCTION}\n| File | Content | Command |\n|---|---|---|\n{table}\n"


INTRODUCTION = """\
# Sample data of solen

All data here are simulated; nothing was measured. Designs, rigs and a scene define what is simulated, and each file
whose name ends in `-simulated` represents the file of an instrument.
"""
