"""Every command is run once, on small files: its output fits its schema, and its figure can be drawn.

The commands run in an order in which later ones read files that earlier ones wrote.
"""

import inspect
import io
import json
import os
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
from solen.cli.app import SHOWN, show_outcome
from solen.cli.design.schema import commands, result_schema, result_type
from solen.report import canvas
from solen.report.options import FigureOptions
from solen.report.plot import FIGURES
from solen.results import Outcome, Result
from solen.spec import template
from tests.analysis.diagnosis_support import response
from tests.command_support import misfits
from tests.house.page_support import differences, paint_coarsely
from tests.report.lettering import faults
from tools.command_pages import MACHINE_DEPENDENT, SAMPLES, calls

EXTRA = {
    "check #network": "hand.toml",
    "trace #network": "hand.toml --rays 64 --set trace.dimension=2d --figure net.svg",
    "sensitivity #network": "hand.toml network.guides[2].width_mm --set trace.dimension=2d --figure slopes.svg",
    "readout #network": "hand.toml --set trace.dimension=2d --set network.motion[0].steps=2 "
    "--set network.motion[1].steps=2 --figure volts.svg",
    "run #network": "hand.toml --out net-ran --set trace.dimension=2d --set network.motion=[]",
    "trace #scene": "scene.json --mode power --figure scene.svg",
}
"""Arguments of further calls; the part of the key after # distinguishes calls of the same command."""
CALLS = {name: call for name, call in calls().items() if result_type(commands()[name]) is not None}
ROWS = {name: arguments for name, (arguments, _) in CALLS.items()} | {
    row: [*row.partition(" #")[0].split(), *arguments.split()] for row, arguments in EXTRA.items()
}
"""Command lines: the calls on the pages of docs/commands, and further ones."""
SHORTENED = {"run", "bench check", "bench watch", "bench run", "bench recordings", "bench diagnose"}
"""Commands whose output differs here, because less is traced."""


@dataclass
class Output:
    """The output of a command with ``--json``, its outcome, the lines without ``--json``, and its figures."""

    printed: Any
    outcome: Outcome[Result]
    lines: list[str]
    figures: list[Figure]


def output_of(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> Output:
    outcomes: list[Outcome[Result]] = []
    figures: list[Figure] = []
    show, encoded = show_outcome, canvas.encoded

    def keep(outcome: Outcome[Result]) -> None:
        outcomes.append(outcome)
        show(outcome)

    def keep_figure(figure: Figure, *options: Any) -> bytes:
        figures.append(figure)
        return encoded(figure, *options)

    printed = io.StringIO()
    with monkeypatch.context() as patch, redirect_stdout(printed):
        patch.setattr("solen.cli.show_outcome", keep)
        patch.setattr(canvas, "encoded", keep_figure)
        assert solen.cli.run_command([*arguments, "--json"]) == 0, arguments
        patch.setattr(SHOWN, "as_json", False)
        with redirect_stdout(io.StringIO()) as text:
            show(outcomes[0])
    lines = text.getvalue().replace(os.sep, "/").splitlines()
    return Output(json.loads(printed.getvalue()), outcomes[0], lines, figures)


@pytest.fixture(scope="module")
def outputs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Output]]:
    """Outputs of all calls, keyed by row."""
    folder = tmp_path_factory.mktemp("workshop")
    found = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for name in ("HOME", "USERPROFILE"):
            patch.setenv(name, str(folder))
        patch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm",))  # the others differ only in their names
        patch.setattr("solen.sensor.effects.HOLDS", {})
        patch.setattr("solen.bench.simulated.sensors.MAX_INTERPOLATION_ERROR", 0.02)
        patch.setattr("solen.bench.simulated.sensors.TOLERANCE", 0.01)
        paint_coarsely(patch)
        closed_form = response()
        patch.setattr(Response, "of", lambda *_: closed_form)  # a traced one takes minutes
        for row, arguments in ROWS.items():
            found[row] = output_of(arguments, patch)
            if row == SAMPLES:
                patch.chdir(folder / "samples")
                Path("bench/sensor.toml").write_text(template("paper-860"), encoding="utf-8")
        yield found


@pytest.mark.parametrize("row", sorted(CALLS.keys() - SHORTENED - MACHINE_DEPENDENT))
def test_output_agrees_with_page(outputs: dict[str, Output], row: str) -> None:
    assert not differences(CALLS[row][1], outputs[row].lines)


@pytest.mark.parametrize("row", ROWS)
def test_output_fits_schema(outputs: dict[str, Output], row: str) -> None:
    assert misfits(result_schema(tuple(row.partition(" #")[0].split())), outputs[row].printed) == []


@pytest.mark.parametrize("row", ROWS)
def test_command_draws_its_figure(outputs: dict[str, Output], row: str) -> None:
    module, _, function = commands()[row.partition(" #")[0]].partition(":")
    parameters = inspect.signature(getattr(import_module(f"solen.cli.{module}"), function)).parameters
    if "figure" in parameters:
        assert "--figure" in ROWS[row]  # so `test_figure_is_legible` plots the result
        assert outputs[row].outcome.files["figure"].stat().st_size > 1000
    if row == "run":
        assert isinstance(solen.plot(outputs[row].outcome.result), Figure)


WITH_FIGURE = [row for row, arguments in ROWS.items() if "--figure" in arguments and row != "project reproduce"]


@pytest.mark.parametrize("width_mm", [None, 85.0])
@pytest.mark.parametrize("row", WITH_FIGURE)
def test_figure_is_legible(outputs: dict[str, Output], row: str, width_mm: float | None) -> None:
    """No text is clipped, below 6 pt or overlapping, and no legend covers data; also in a column of a journal."""
    figures = outputs[row].figures
    if width_mm is not None:
        figures = [solen.plot(outputs[row].outcome.result, FigureOptions(width_mm=width_mm))]
        assert figures[0].get_figwidth() == pytest.approx(width_mm / 25.4)
    assert [faults(figure) for figure in figures] == [[]] * len(figures)
    assert figures


def test_parts_of_results_can_be_drawn(outputs: dict[str, Output]) -> None:
    study: Any = outputs["run"].outcome.result
    for part in (study.practice, study.case.power, study.sensor, study.sensor.cut):
        assert isinstance(solen.plot(part), Figure)


def test_type_names_with_figures_are_unique() -> None:
    """The figure of a result is selected by the name of its type."""
    types: dict[str, set[type]] = {}
    waiting: list[type] = [Result]
    while waiting:
        kind = waiting.pop()
        waiting += kind.__subclasses__()
        if kind.__module__.startswith("solen."):
            types.setdefault(kind.__name__, set()).add(kind)
    assert [name for name in FIGURES if len(types.get(name, ())) > 1] == []


def test_figures_are_not_kept_open(outputs: dict[str, Output]) -> None:
    """Figures are created without pyplot, which would keep them in memory."""
    assert outputs
    if "matplotlib.pyplot" in sys.modules:
        assert sys.modules["matplotlib.pyplot"].get_fignums() == []
