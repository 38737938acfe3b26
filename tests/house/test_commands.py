"""The table of commands, their pages, their help and their schemas."""

import inspect
import json
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from solen.cli import run_command
from solen.cli.commands import COMMANDS, GROUPS
from solen.cli.design.schema import commands
from solen.spec.strict import Options
from tests.command_support import refusal
from tools.command_pages import page_of

ROOT = Path(__file__).resolve().parents[2]
ROWS = [(group, name, place, text) for group, rows in COMMANDS.items() for name, place, text in rows]


@pytest.mark.parametrize(("group", "name", "place", "text"), ROWS, ids=lambda value: str(value)[:30])
def test_row_names_documented_function(group: str, name: str, place: str, text: str) -> None:
    module, _, function = place.partition(":")
    assert inspect.getdoc(getattr(import_module(f"solen.cli.{module}"), function)), place
    assert function.rstrip("_") == name
    assert module.startswith(f"{group or 'design'}.")
    assert text.endswith(".")
    assert len(text) < 80, "one line of a help screen"


def test_names_within_group_are_unique() -> None:
    for group, rows in COMMANDS.items():
        names = [name for name, _, _ in rows]
        assert len(set(names)) == len(names)
        assert not set(names) & set(GROUPS) or group


@pytest.mark.parametrize("command", commands())
def test_command_has_page_and_entry_in_list(command: str) -> None:
    page = page_of(command)
    title = re.match(rf"# `solen {command}`: (.+)\n", page.read_text(encoding="utf-8"))
    assert title
    listed = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert f"- [`solen {command}`](commands/{page.name}): {title[1]}\n" in listed


def test_no_page_or_image_is_unused() -> None:
    pages = {page_of(command) for command in commands()}
    assert set((ROOT / "docs" / "commands").iterdir()) == pages
    shown = {
        name for page in pages for name in re.findall(r"images/commands/(\S+?)\)", page.read_text(encoding="utf-8"))
    }
    images = list((ROOT / "docs" / "images" / "commands").iterdir())
    assert {image.name for image in images} == shown
    assert sum(image.stat().st_size for image in images) < 3_000_000


@pytest.mark.parametrize("command", commands())
def test_page_shows_figure_of_command(command: str) -> None:
    module, _, function = commands()[command].partition(":")
    draws = "figure" in inspect.signature(getattr(import_module(f"solen.cli.{module}"), function)).parameters
    page = page_of(command)
    assert not draws or f"images/commands/{page.stem}.webp" in page.read_text(encoding="utf-8")


QUERIES = {
    "new": "new design file example",
    "check": "check design errors build angle",
    "run": "simulate sensor response report",
    "trace": "trace rays angle scene",
    "deform": "soft body deform strain force",
    "lens": "lens profile focus acceptance",
    "sensitivity": "sensitivity dimension matters most",
    "convergence": "how many rays are enough",
    "readout": "receiver voltage noise resolution load resistor",
    "studio": "browser interactive drag lens",
    "export": "export stl step cad solid",
    "schema": "json schema result keys",
    "doctor": "check installation bug report",
    "completion": "shell completion bash tab",
    "resin spectra": "plot spectrum spectrophotometer file",
    "resin index": "refractive index from transmission spectrum",
    "resin refractometer": "refractometer index other wavelengths",
    "resin cutback": "waveguide loss cut-back db/cm",
    "resin cure": "working curve cure depth exposure dose",
    "resin penetration": "penetration depth absorbance resin",
    "resin exposures": "exposure time transmittance layers compare",
    "resin stiffness": "young modulus hyperelastic compression test",
    "resin build": "own material resin file",
    "resin mix": "mixing ratio weigh resin",
    "resin list": "list materials resins library",
    "resin show": "show resin index at wavelength",
    "print layers": "slice layer png printer",
    "print coupons": "test parts printer resolution coupons",
    "print fidelity": "measure printed coupon image resolution",
    "print calibrate": "calibrate printer shrinkage blur",
    "print grey": "grey pixels light transmission",
    "print predict": "predict printed lens compensate drawing",
    "print scale": "microscope scale stage micrometer",
    "print inspect": "wrong lens why micrograph",
    "print tune": "correct drawing next print image",
    "print printers": "supported printers pixel plate",
    "bench new": "example protocol rig start measuring",
    "bench firmware": "wiring of the board firmware",
    "bench check": "check rig before run wires noise",
    "bench watch": "live voltage receivers plot",
    "bench jog": "move stage position travel",
    "bench run": "record sensor stage protocol",
    "bench recover": "recover interrupted run recording",
    "bench recordings": "list recordings folder",
    "bench video": "angle from video marker aruco",
    "bench demodulate": "remove ambient light flicker recording",
    "bench analyse": "response curve hysteresis recording angle",
    "bench diagnose": "what is wrong with sensor decentre",
    "bench calibrate": "calibrate sensor voltage to angle",
    "bench decode": "decode recording to angle live",
    "bench table": "microcontroller code arduino calibration",
    "explore sweep": "parameter sweep design",
    "explore tolerance": "tolerance yield monte carlo prints",
    "explore optimise": "optimise design inverse search",
    "project examples": "sample data try examples",
    "project pack": "pack sensor for sharing archive data",
    "project unpack": "unpack archive check sensor",
    "project reproduce": "reproduce paper figures",
}
"""Search queries of users who do not know the command, keyed by command."""


@pytest.mark.parametrize("command", commands())
def test_search_finds_command(command: str) -> None:
    """The search lists pages that contain all words of a query, in descending order of matches in the title."""
    title, _, text = page_of(command).read_text(encoding="utf-8").lower().partition("\n")
    words = QUERIES[command].split()
    assert [word for word in words if word not in f"{title}{text.partition('```')[0]}"] == []
    assert sum(word in title for word in words) >= 2


def option_classes(kind: type[Options] = Options) -> Iterator[type[Options]]:
    for derived in kind.__subclasses__():
        if derived.__module__.startswith("solen."):
            yield derived
        yield from option_classes(derived)


def test_help_contains_limits_of_options() -> None:
    """The description in the help contains the limits in the JSON Schema of an option, at any depth."""
    for _, _, place, _ in ROWS:
        import_module(f"solen.cli.{place.partition(':')[0]}")
    missing, count = [], 0
    for options in option_classes():
        for name, field in options.model_json_schema()["properties"].items():
            limits = re.findall(r"'(?:exclusiveM|m)(?:in|ax)imum': ([-+.\w]+)", str(field))
            count += len(limits)
            description = options.model_fields[name].description or ""
            missing += [f"{options.__name__}.{name}" for limit in limits if f"{float(limit):g}" not in description]
    assert count > 100
    assert missing == []


def test_help_shows_choices_defaults_and_limits(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["print", "layers", "--help"]) == 0
    text = " ".join(re.sub(r"[^\x20-\x7e]", " ", capsys.readouterr().out).split())
    assert "[choices: flat, upright, on-edge] [default: flat]" in text
    assert "--exposure-s FLOAT" in text
    assert "Above 0, at most 3600. [default: 2.0]" in text
    assert "False" not in text
    assert "()" not in text
    assert "[default: None]" not in text
    assert "[default: ]" not in text


def test_schema_without_command_is_that_of_design(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["schema"]) == 0
    assert "lens" in json.loads(capsys.readouterr().out)["properties"]


def test_schema_of_command_fits_its_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["schema", "doctor"]) == 0
    schema: dict[str, Any] = json.loads(capsys.readouterr().out)
    assert run_command(["doctor", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert schema["title"] == "solen doctor"
    assert result.keys() == schema["properties"].keys() == set(schema["required"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["nonsense"], "nonsense"), (["bench"], "bench analyse"), (["ben", "analyse"], "bench analyse")],
)
def test_refuses_schema_of_unknown_command(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], message: str
) -> None:
    assert message in refusal(capsys, tmp_path, "schema", *arguments)


def test_refuses_schema_of_command_without_result(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert "schema" in refusal(capsys, tmp_path, "schema", "schema")


def test_option_names_of_command_are_unique() -> None:
    """A command has options of its stage and of its figure, which must not share a name."""
    for name, place in commands().items():
        module, _, function = place.partition(":")
        hints = get_type_hints(getattr(import_module(f"solen.cli.{module}"), function))
        fields = [list(getattr(kind, "model_fields", [key])) for key, kind in hints.items() if key != "return"]
        flat = [option for part in fields for option in part]
        assert len(set(flat)) == len(flat), name
