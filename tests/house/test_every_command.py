"""Every command once, on small files: what it prints fits its schema, and a result that has a figure is drawn.

The commands run in the order of a workshop, so that later ones read what earlier ones wrote.
"""

import inspect
import io
import json
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

import solen
import solen.cli
from solen.analysis.diagnosis import Response
from solen.cli.app import show_outcome
from solen.cli.design.schema import commands, result_schema, result_type
from solen.report.options import FigureOptions
from solen.report.plot import FIGURES
from solen.results import Outcome, Result
from solen.spec import template
from tests.analysis.diagnosis_support import response
from tests.bench.rig_support import PROTOCOL, RIG
from tests.command_support import misfits
from tests.fabricate.test_printed_command import sure
from tests.report.lettering import faults

SCENE = Path(__file__).resolve().parents[1] / "scenes" / "oval-relay.json"
DESIGN = "part/sensor.toml"
IN = "samples"
LENS, ROTATION = f"{IN}/lens-simulated.ome.tif", f"{IN}/rotation-simulated.csv"
CALIBRATION = f"{IN}/rotation-simulated.S1.calibration.json"

ROWS = {
    "project examples": f"--out {IN}",
    "project pack": f"{IN}/sensor.toml {ROTATION} --out sensor.zip --author Author --licence MIT",
    "project unpack": "sensor.zip --out unpacked",
    "project reproduce": "--out paper --figure S2",
    "new": "part",
    "new #soft": "soft --example press-860",
    "new #network": "net --example hand-860",
    "check #network": "net/sensor.toml",
    "trace #network": "net/sensor.toml --rays 64 --set trace.dimension=2d --figure net.svg",
    "sensitivity #network": "net/sensor.toml network.guides[2].width_mm --set trace.dimension=2d --figure slopes.svg",
    "readout #network": "net/sensor.toml --set trace.dimension=2d --set network.motion[0].steps=2 --figure volts.svg",
    "run #network": "net/sensor.toml --out net-ran --set trace.dimension=2d --set network.motion=[]",
    "deform": "soft/sensor.toml --set trace.dimension=2d --figure shape.svg",
    "check": DESIGN,
    "lens": f"{DESIGN} --csv profile.csv --figure lens.svg",
    "trace": f"{DESIGN} --rays 50 --mode power --figure trace.svg",
    "trace #scene": f"{SCENE} --mode power --figure scene.svg",
    "convergence": f"{DESIGN} --set trace.dimension=2d --figure convergence.svg",
    "sensitivity": f"{DESIGN} body.arm_width_mm --angle-deg 0.2 --set trace.dimension=2d --figure sensitivity.svg",
    "run": f"{DESIGN} --out ran --set motion.step_deg=6 --set emitter.width_mm=0.2",
    "studio": (
        f"{DESIGN} --export page.html --over lens.focus_mm=18,20 --set motion.step_deg=3 --set trace.dimension=2d"
    ),
    "readout": f"{DESIGN} --set motion.step_deg=3 --figure readout.svg --out readout.json",
    "export": f"{DESIGN} --out solid --stl --figure solid.png",
    "doctor": "",
    "completion": "bash",
    "resin spectra": f"{IN}/layer-simulated.csv --figure spectra.svg",
    "resin index": f"{IN}/layer-simulated.csv --thickness-um 50 --figure index.svg --out index.json",
    "resin refractometer": "1.49 --u 0.001 --figure refractometer.svg --out refractometer.json",
    "resin cutback": f"{IN}/guides-simulated.csv --launched 800 --figure cutback.svg --out cutback.json",
    "resin cure": (
        f"{IN}/discs-simulated.csv --irradiance-mW-per-cm2 13 --layer-um 25 --exposure-s 2 --figure cure.svg "
        "--out cure.json"
    ),
    "resin penetration": (
        f"{IN}/absorbance-simulated.csv --path-um 93 --led-nm 400 --led-fwhm-nm 12 --figure penetration.svg"
    ),
    "resin exposures": (f"{IN}/exposures-simulated.csv --wavelength-nm 450 --wavelength-nm 860 --figure exposures.svg"),
    "resin stiffness": (f"{IN}/cube-simulated.csv --cube-mm 10 --fit yeoh --figure stiffness.svg --out stiffness.json"),
    "resin build": (
        "own.toml --name own --index index.json --cutback cutback.json --cure cure.json --stiffness stiffness.json"
    ),
    "resin mix": "a:60 b:40",
    "resin list": "",
    "resin show": "own.toml --at-nm 860 --figure resin.svg",
    "print layers": f"{DESIGN} --out stack --layer-um 200 --exposure-s 2 --figure layers.png",
    "print coupons": "--out coupons --only group-a --figure plans.svg",
    "print fidelity": (
        f"{IN}/pillars-simulated.png --job coupons/group-a.json --um-per-px 14 --figure fidelity.svg --out a.json"
    ),
    "print calibrate": f"{IN}/features-simulated.json --figure printer.svg --out process.toml",
    "print grey": f"{IN}/greys-simulated.csv --u-thickness-um 2 --out greys.toml",
    "print predict": f"{DESIGN} --process sure/process.toml --no-response --figure printed.svg --out printed.json",
    "print scale": f"{IN}/micrometer-simulated.png --spacing-mm 0.01 --out scale.toml",
    "print inspect": f"{LENS} --design {DESIGN} --figure inspected.svg --out lens.json",
    "print tune": (f"{LENS} --design {DESIGN} --out tuned --no-response --sheet-only --figure tuned.svg"),
    "print printers": "",
    "bench new": "bench",
    "bench firmware": "board --board uno",
    "bench check": "--rig rig/rig.toml --seconds 1",
    "bench watch": "--rig rig/rig.toml --seconds 1",
    "bench jog": "--rig rig/rig.toml --to 0.1",
    "bench run": "rig/protocol.toml --rig rig/rig.toml --out recorded",
    "bench recover": f"{IN}/interrupted-simulated.journal",
    "bench recordings": "recorded",
    "bench video": f"{IN}/marker-simulated.avi --out turn.csv",
    "bench demodulate": f"{IN}/switched-simulated.csv --figure switched.svg --out readings.csv",
    "bench analyse": f"{ROTATION} --figure response.svg --traces traces.svg --out analysis.json",
    "bench diagnose": f"{ROTATION} --sensor S1 --design {DESIGN} --figure diagnosis.svg --out diagnosis.json",
    "bench calibrate": f"{ROTATION} --sensor S1 --design {DESIGN} --figure calibration.svg",
    "bench table": f"{CALIBRATION} coded",
    "bench decode": f"{CALIBRATION} {IN}/again-simulated.csv --out angles.csv",
    "explore sweep": f"{DESIGN} --out swept --over lens.focus_mm=18,20 --set motion.step_deg=2 --figure swept.svg",
    "explore tolerance": (
        f"{DESIGN} --out prints --vary emitter.offset_mm=normal:0:0.02 --prints 32 --set motion.step_deg=2 "
        "--set trace.dimension=2d --tolerance 1e-2 --require light>0.1 --figure prints.svg"
    ),
    "explore optimise": (
        f"{DESIGN} --out better --maximise light --free lens.focus_mm=15:25 --evaluations 20 --set motion.step_deg=3 "
        "--prints 32 --require light>0.1 --set trace.dimension=2d --tolerance 1e-2 --figure better.svg"
    ),
}
"""Arguments of each command; after # what tells two of one command apart."""


@dataclass
class Answer:
    """What a command printed with ``--json``, and its outcome."""

    printed: Any
    outcome: Outcome[Result]


def write_rig(folder: Path) -> None:
    """A small rig."""
    (folder / "rig").mkdir()
    files = {"sensor.toml": template("paper-860"), "rig.toml": RIG, "protocol.toml": PROTOCOL}
    for name, text in files.items():
        (folder / "rig" / name).write_text(text, encoding="utf-8")


def answer(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> Answer:
    outcomes: list[Outcome[Result]] = []
    show = show_outcome

    def keep(outcome: Outcome[Result]) -> None:
        outcomes.append(outcome)
        show(outcome)

    printed = io.StringIO()
    with monkeypatch.context() as patch, redirect_stdout(printed):
        patch.setattr("solen.cli.show_outcome", keep)
        assert solen.cli.run_command([*arguments, "--json"]) == 0, arguments
    return Answer(json.loads(printed.getvalue()), outcomes[0])


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Answer]]:
    """Answers of all commands, by their rows."""
    folder = tmp_path_factory.mktemp("workshop")
    (folder / "sure").mkdir()
    sure(folder / "sure")
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name in ("HOME", "USERPROFILE"):
            patch.setenv(name, str(folder))
        patch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm",))  # the others differ in their names alone
        patch.setattr("solen.sensor.effects.HOLDS", {})
        closed_form = response()
        patch.setattr(Response, "of", lambda *_: closed_form)  # a traced one takes minutes
        for row, arguments in ROWS.items():
            if row == "bench check":
                write_rig(folder)
            found[row] = answer([*row.partition(" #")[0].split(), *arguments.split()], patch)
        yield found


def test_every_command_with_a_result_has_a_row() -> None:
    answering = {name for name, place in commands().items() if result_type(place) is not None}
    assert {row.partition(" #")[0] for row in ROWS} == answering


@pytest.mark.parametrize("row", ROWS)
def test_what_a_command_prints_fits_its_schema(answers: dict[str, Answer], row: str) -> None:
    assert misfits(result_schema(tuple(row.partition(" #")[0].split())), answers[row].printed) == []


@pytest.mark.parametrize("row", ROWS)
def test_a_result_is_drawn_where_its_command_draws(answers: dict[str, Answer], row: str) -> None:
    module, _, function = commands()[row.partition(" #")[0]].partition(":")
    parameters = inspect.signature(getattr(import_module(f"solen.cli.{module}"), function)).parameters
    if "figure" in parameters:
        assert "--figure" in ROWS[row]  # so `test_every_figure_is_legible` plots the result
        assert answers[row].outcome.files["figure"].stat().st_size > 1000
    if row == "run":
        assert isinstance(solen.plot(answers[row].outcome.result), Figure)


DRAWN = [row for row, arguments in ROWS.items() if "--figure" in arguments and row != "project reproduce"]


@pytest.mark.parametrize("width_mm", [None, 85.0])
@pytest.mark.parametrize("row", DRAWN)
def test_every_figure_is_legible(answers: dict[str, Answer], row: str, width_mm: float | None) -> None:
    """No text cut off, under 6 pt or on another, no legend on data; also in a column of a journal."""
    figure = solen.plot(answers[row].outcome.result, FigureOptions(width_mm=width_mm))
    assert width_mm is None or figure.get_figwidth() == pytest.approx(width_mm / 25.4)
    assert faults(figure) == []


def test_parts_of_results_are_drawn(answers: dict[str, Answer]) -> None:
    study: Any = answers["run"].outcome.result
    for part in (study.practice, study.case.power, study.sensor, study.sensor.cut):
        assert isinstance(solen.plot(part), Figure)


def test_names_of_figures_are_names_of_one_type() -> None:
    """A figure is chosen by the name of the type alone."""
    types: dict[str, set[type]] = {}
    waiting: list[type] = [Result]
    while waiting:
        kind = waiting.pop()
        waiting += kind.__subclasses__()
        if kind.__module__.startswith("solen."):
            types.setdefault(kind.__name__, set()).add(kind)
    assert [name for name in FIGURES if len(types.get(name, ())) > 1] == []


def test_figures_of_the_commands_leave_nothing_open(answers: dict[str, Answer]) -> None:
    """Figures are made without pyplot, which would keep them all."""
    assert answers
    if "matplotlib.pyplot" in sys.modules:
        assert sys.modules["matplotlib.pyplot"].get_fignums() == []
