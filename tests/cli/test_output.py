"""Output of commands: one JSON object, or lines with the same content; and exit codes."""

import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

import solen
from solen.cli import run_command
from solen.pipeline.design import check as pipeline
from solen.report.design import html
from solen.sensor import traced
from solen.spec import loads, template
from solen.trace import convergence
from tests.command_support import without_waiting

STEP = ("--set", "motion.step_deg=6")
HELP_COMMANDS = ("trace", "convergence", "sensitivity", "run")


@pytest.fixture(autouse=True)
def few_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reduce the comparison in a run to one number of the design; more numbers give the same lines."""
    monkeypatch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm",))
    monkeypatch.setattr("solen.sensor.effects.HOLDS", {})


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> str:
    target = tmp_path_factory.mktemp("my design") / "sensor.toml"
    target.write_text(template("paper-860"), encoding="utf-8")
    return str(target)


class CommandRunner:
    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def lines(self, *arguments: str) -> list[str]:
        """Lines on stdout of a command that succeeds and prints nothing on stderr."""
        self.capsys.readouterr()
        code = run_command(list(arguments))
        printed = self.capsys.readouterr()
        assert (code, printed.err) == (0, "")
        return printed.out.splitlines()

    def json(self, *arguments: str) -> dict[str, Any]:
        """The JSON object on stdout."""
        text = "\n".join(self.lines(*arguments))

        def refuse(constant: str) -> None:
            raise AssertionError(constant)

        result = json.loads(text, parse_constant=refuse)
        assert isinstance(result, dict)
        return result


@pytest.fixture
def runner(capsys: pytest.CaptureFixture[str]) -> CommandRunner:
    return CommandRunner(capsys)


def test_design_commands_print_one_json_object(runner: CommandRunner, design: str, tmp_path: Path) -> None:
    assert runner.json("new", str(tmp_path / "new"), "--json") == {
        "design": str(tmp_path / "new" / "sensor.toml"),
        "example": "solen-860",
        "files": {"schema": str(tmp_path / "new" / "sensor.schema.json")},
    }
    assert runner.json("schema", "--json")["title"] == "solen design file"
    assert runner.json("schema") == runner.json("schema", "--json")
    assert runner.json("check", design, "--json")["angles"] == 25
    assert runner.json("lens", design, "--json")["lens"]["focus_mm"] == 20.0
    assert runner.json("trace", design, "--json")["rays"] == 100
    result = runner.json("run", design, "--out", str(tmp_path / "out"), *STEP, "--json")
    assert result["summary"]["lens"]["to_deg"] == 3.0
    assert all(Path(name).is_file() for name in result["files"].values())


def test_json_contains_paths_of_files(runner: CommandRunner, design: str, tmp_path: Path) -> None:
    table, figure = tmp_path / "lens.csv", tmp_path / "rays.svg"
    assert runner.json("lens", design, "--csv", str(table), "--json")["files"] == {"profile": str(table)}
    assert runner.json("trace", design, "--figure", str(figure), "--json")["files"] == {"figure": str(figure)}
    assert table.is_file()
    assert figure.is_file()


@pytest.mark.parametrize("mode", ["count", "power"])
def test_trace_has_expected_keys(runner: CommandRunner, design: str, mode: str) -> None:
    result = runner.json("trace", design, "--angle-deg", "-1", "--rays", "50", "--mode", mode, "--json")
    assert set(result["detectors"]) == {"left", "right"}
    for detector in result["detectors"].values():
        assert (detector["power_by_angle"], detector["power_by_position"]) == ([], [])
        assert isinstance(detector["rays"], int)
    assert set(result["ledger"]) == {"detected", "escaped", "absorbed", "truncated"}
    assert sum(result["ledger"].values()) == pytest.approx(1.0, abs=1e-12)
    assert (result["rays"], result["mode"], result["angle_deg"]) == (50, mode, -1.0)
    assert result["branches"] is None


AT = {"angle_deg", "depth_mm", "force_N"}
TRACED = AT | {
    *("name", "lens", "mode", "method", "rays", "detectors", "ledger", "hits", "undefined", "truncated"),
    *("undefined_at_mm", "truncated_at_mm", "single_error", "pieces", "reached", "why", "warnings", "monitors"),
    *(
        "missed",
        "leaked",
        "reflected",
        "u_ledger",
        "u_missed",
        "u_leaked",
        "in_space",
        "faces",
        "branches",
        "simulated",
        "u_power",
        "files",
    ),
}


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--mode", "roulette", "--seed", "3"],
        ["--sampling", "sobol", "--mode", "power"],
        ["--sampling", "sobol", "--seed", "9223372036854775807"],
        ["--sampling", "adaptive", "--tolerance", "1e-3", "--mode", "power"],
        ["--sampling", "adaptive"],
        ["--sampling", "adaptive", "--tolerance", "1e-11", "--mode", "power"],
        ["--precision", "single", "--mode", "power"],
        ["--rays", "1"],
    ],
    ids=" ".join,
)
def test_all_trace_options_give_the_same_keys(runner: CommandRunner, design: str, arguments: list[str]) -> None:
    result = runner.json("trace", design, "--angle-deg", "0.2", *arguments, "--json")
    assert set(result) == TRACED
    assert sum(result["ledger"].values()) == pytest.approx(1.0, abs=1e-7 if "single" in arguments else 1e-12)
    assert (result["single_error"] is None) == ("single" not in arguments)
    assert (result["pieces"] > 0) == ("adaptive" in arguments)
    assert (result["why"] == "") == result["reached"]
    lines = runner.lines("trace", design, "--angle-deg", "0.2", *arguments)
    assert lines[0].startswith(f"Paper 860 nm at 0.2 deg, {result['rays']} rays, mode {result['mode']}")
    assert any("single precision" in line for line in lines) == ("single" in arguments)
    assert any("tolerance was not reached" in line for line in lines) == (not result["reached"])


def test_unknown_uncertainty_is_null(runner: CommandRunner, design: str) -> None:
    result = runner.json("trace", design, "--rays", "1", "--json")
    assert [detector["u_power"] for detector in result["detectors"].values()] == [None, None]


def test_uncertainty_is_within_tolerance(runner: CommandRunner, design: str) -> None:
    arguments = ("--sampling", "adaptive", "--mode", "power", "--angle-deg", "0.2", "--json")
    loose, tight, default = (runner.json("trace", design, *arguments, *options) for options in
                           (("--tolerance", "1e-2"), ("--tolerance", "1e-9"), ()))  # fmt: skip
    for result, tolerance in ((loose, 1e-2), (tight, 1e-9), (default, 1e-6)):
        assert result["method"] == "adaptive"
        assert result["reached"]
        for side in ("right", "left"):
            assert result["detectors"][side]["u_power"] <= tolerance
            difference = abs(result["detectors"][side]["power"] - tight["detectors"][side]["power"])
            assert difference <= result["detectors"][side]["u_power"] + 1e-9
    assert loose["rays"] < default["rays"] < tight["rays"]


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
def test_seed_determines_sample(runner: CommandRunner, design: str, mode: str) -> None:
    arguments = ("--mode", mode, "--sampling", "sobol", "--rays", "200", "--angle-deg", "0.2", "--json")
    first, repeated, second = (runner.json("trace", design, *arguments, "--seed", seed) for seed in ("1", "1", "2"))
    assert first == repeated
    assert first["detectors"] != second["detectors"]
    assert first["rays"] == 256
    assert all(detector["u_power"] > 0.0 for detector in first["detectors"].values())


def test_histogram_adds_up_to_power(runner: CommandRunner, design: str) -> None:
    result = runner.json("trace", design, "--rays", "500", "--mode", "power", "--histogram", "7", "--json")
    for side, detector in result["detectors"].items():
        assert result["faces"][side] == [f"receiver-{side}"]
        (by_position,) = detector["power_by_position"]
        assert len(detector["power_by_angle"]) == len(by_position) == 7
        assert sum(detector["power_by_angle"]) == pytest.approx(detector["power"], abs=1e-12)
        assert sum(by_position) == pytest.approx(detector["power"], abs=1e-12)


def test_netcdf_file_contains_trace_and_design(runner: CommandRunner, design: str, tmp_path: Path) -> None:
    target = tmp_path / "a trace.nc"
    arguments = ("--angle-deg", "0.2", "--mode", "power", "--histogram", "5", "--paths", "--netcdf", str(target))
    result = runner.json("trace", design, *arguments, "--json")
    assert result["files"] == {"netcdf": str(target)}
    dataset = xr.load_dataset(target, engine="h5netcdf")
    assert (dataset.attrs["name"], dataset.attrs["angle_deg"], dataset.attrs["simulated"]) == ("Paper 860 nm", 0.2, 1)
    assert loads(dataset.attrs["design"]).trace.mode == "power"
    for side, detector in result["detectors"].items():
        assert float(dataset["power"].sel(receiver=side)) == detector["power"]
        assert list(dataset["power_by_angle"].sel(receiver=side).values) == detector["power_by_angle"]
    faces = dataset.attrs["interfaces"].split(", ")
    first = dataset.isel(segment=0)
    assert (
        result["branches"][0]["faces"][:1]
        == [faces[int(first["segment_interface"])]][: int(first["segment_interface"] >= 0)]
    )
    assert result["branches"][0]["points_mm"][0] == [float(first["segment_x_mm"]), float(first["segment_z_mm"])]
    first_bytes = target.read_bytes()
    assert runner.lines("trace", design, *arguments)[-1] == f"netcdf: {target}"
    assert target.read_bytes() == first_bytes


def test_convergence_agrees_in_lines_and_json_and_draws_figure(
    runner: CommandRunner, design: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(traced, "convergence", partial(convergence, max_rays=64))
    figure = tmp_path / "convergence.svg"
    arguments = ("convergence", design, "--angle-deg", "0.2", "--figure", str(figure))
    result, lines = runner.json(*arguments, "--json"), runner.lines(*arguments)
    assert set(result) == AT | {"name", "emitter", "mode", "reference", "series", "warnings", "files"}
    assert (result["mode"], result["angle_deg"], result["files"]) == ("power", 0.2, {"figure": str(figure)})
    assert set(result["reference"]["detectors"]) == {"left", "right"}
    assert result["reference"]["method"] == "adaptive"
    assert [series["method"] for series in result["series"]] == ["fan", "sobol", "adaptive"]
    assert result["series"][0]["rays"] == [16, 32, 64]
    rows = [line.split() for line in lines[1:-1]]
    assert [row[0] for row in rows] == [series["method"] for series in result["series"] for _ in series["rays"]]
    assert [int(row[1]) for row in rows] == [rays for series in result["series"] for rays in series["rays"]]
    errors = [error for series in result["series"] for error in series["error"]]
    assert [float(row[4]) for row in rows] == pytest.approx(errors, rel=0.06)
    assert lines[-1] == f"figure: {figure}"
    assert figure.read_bytes().startswith(b"<?xml")
    assert runner.json("convergence", design, "--mode", "count", "--json")["mode"] == "count"


def test_sensitivity_agrees_in_lines_and_json(runner: CommandRunner, design: str) -> None:
    arguments = ("sensitivity", design, "--angle-deg", "0.2")
    result, lines = runner.json(*arguments, "--json"), runner.lines(*arguments)
    assert set(result) == AT | {"name", "sensitivities", "skipped", "warnings", "simulated", "files"}
    rows = {line.split()[0]: line.split()[1:] for line in lines[2:]}
    for row in result["sensitivities"]:
        assert set(row) == {"key", "value", "right", "left", "contrast", "why", "tolerance", "effect"}
        columns = rows[row["key"]]
        assert float(columns[0]) == pytest.approx(row["value"], rel=1e-5)
        if row["why"] is None:
            expected = [row[name]["value"] for name in ("right", "left", "contrast")]
            assert [float(text) for text in columns[1:4]] == pytest.approx(expected, rel=1e-5)
        else:
            assert row["contrast"] == {"value": None, "u_value": None}
            assert row["why"].split() == columns[1:]
    assert [line for line in lines if line.startswith("omitted: ")] == [
        f"omitted: {key}: {why}" for key, why in result["skipped"].items()
    ]
    selected = runner.json(*arguments, "body.arm_width_mm", "lens.focus_mm", "--json")
    by_key = {row["key"]: row for row in result["sensitivities"]}
    assert selected["sensitivities"] == [by_key["body.arm_width_mm"], by_key["lens.focus_mm"]]
    assert selected["skipped"] == {}


def test_sensitivity_without_light_has_no_contrast(runner: CommandRunner, design: str) -> None:
    dark = ("--set", "material.absorption_per_mm=1000.0")
    (row,) = runner.json("sensitivity", design, "body.arm_width_mm", *dark, "--json")["sensitivities"]
    assert (row["right"]["value"], row["contrast"]["value"], row["why"]) == (0.0, None, None)
    assert "none" in runner.lines("sensitivity", design, "body.arm_width_mm", *dark)[2]


def test_trace_reproduces_numbers_of_paper(runner: CommandRunner, design: str) -> None:
    result = runner.json("trace", design, "--angle-deg", "-3", "--rays", "100000", "--json")
    assert result["detectors"]["right"]["power"] == pytest.approx(0.5905, abs=0.003)
    left = result["detectors"]["left"]
    assert (left["power"], left["u_power"], left["rays"], left["optical_path_mm"]) == (0.0, 1e-5, 0, None)
    assert result["detectors"]["right"]["rays"] == round(result["detectors"]["right"]["power"] * 100_000)
    at_rest = runner.json("trace", design, "--rays", "100000", "--json")["detectors"]
    assert at_rest["left"]["power"] == pytest.approx(0.5905 / 2, abs=0.0015)
    assert at_rest["right"]["power"] == pytest.approx(0.5905 / 2, abs=0.0015)
    power = runner.json("trace", design, "--angle-deg", "-3", "--rays", "20000", "--mode", "power", "--json")
    assert power["ledger"]["detected"] == pytest.approx(0.5207, abs=0.003)


def test_receivers_hardly_differ_without_lens(runner: CommandRunner, design: str) -> None:
    result = runner.json("trace", design, "--angle-deg", "-3", "--no-lens", "--rays", "20000", "--json")
    right, left = (result["detectors"][side]["power"] for side in ("right", "left"))
    assert result["lens"] == "none"
    assert 0.0 < (right - left) / (right + left) < 0.12
    by_set = runner.json("trace", design, "--angle-deg", "-3", "--set", "lens.shape=none", "--rays", "20000", "--json")
    assert by_set == result


def test_paths_are_added_to_json(runner: CommandRunner, design: str) -> None:
    default = runner.json("trace", design, "--rays", "8", "--angle-deg", "1", "--json")
    result = runner.json("trace", design, "--rays", "8", "--angle-deg", "1", "--paths", "--json")
    paths = result.pop("branches")
    lengths = [result["detectors"]["left"].pop("optical_path_mm") for result in (result, default)]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-12)
    assert result | {"branches": None} == default
    assert [path["ray"] for path in paths] == list(range(8))
    for path in paths:
        assert set(path) == {"ray", "branch", "parent", "fate", "power", "faces", "points_mm", "exit_direction"}
        assert len(path["points_mm"]) == len(path["faces"]) + 1
        assert (path["exit_direction"] is None) == (path["fate"] != "escaped")
    arrived = [path["faces"][-1] for path in paths if path["fate"] == "detected"]
    assert arrived.count("receiver-left") == default["detectors"]["left"]["rays"] > 0


def test_paths_of_axial_ray_cause_no_warning(runner: CommandRunner, design: str) -> None:
    assert len(runner.json("trace", design, "--rays", "3", "--mode", "power", "--paths", "--json")["branches"]) >= 3


@pytest.mark.parametrize(
    ("assignments", "where", "value"),
    [
        (["emitter.rays=40"], ("rays",), 40),
        (["trace.mode=power"], ("mode",), "power"),
        (["trace.mode=roulette"], ("mode",), "roulette"),
        (['trace.mode="power"'], ("mode",), "power"),
        (["name=A name of words"], ("name",), "A name of words"),
        (['name="5"'], ("name",), "5"),
        (["name=a=b"], ("name",), "a=b"),
        ([" lens.shape = none "], ("lens",), "none"),
        (["emitter.rays=40", "emitter.rays=30"], ("rays",), 30),
        (["emitter={rays=20}"], ("rays",), 20),
        (["motion.pivot=[0.0, 1.0]"], ("rays",), 100),
        (["receivers.coupling=air-gap", "receivers.gap_mm=0.5"], ("rays",), 100),
        (["motion.moves=['emitter']"], ("rays",), 100),
        (["material.resin=pmma"], ("rays",), 100),
    ],
    ids=str,
)
def test_set_accepts_toml_or_string(
    runner: CommandRunner, design: str, assignments: list[str], where: tuple[str], value: object
) -> None:
    options = [part for assignment in assignments for part in ("--set", assignment)]
    result: Any = runner.json("trace", design, "--json", *options)
    for key in where:
        result = result[key]
    assert result == value


def test_option_overrides_set(runner: CommandRunner, design: str) -> None:
    result = runner.json("trace", design, "--rays", "20", "--set", "emitter.rays=30", "--json")
    assert result["rays"] == 20


def test_lines_agree_with_json(runner: CommandRunner, design: str) -> None:
    arguments = ["trace", design, "--angle-deg", "-3", "--rays", "1000"]
    result, lines = runner.json(*arguments, "--json"), runner.lines(*arguments)
    assert lines[0] == "Paper 860 nm at -3 deg, 1000 rays, mode count"
    columns = {line.split()[0]: float(line.split()[1]) for line in lines[1:]}
    assert columns["right"] == pytest.approx(result["detectors"]["right"]["power"], abs=1e-6)
    for key, value in result["ledger"].items():
        assert columns[key] == pytest.approx(value, abs=1e-6)
    lens, lines = runner.json("lens", design, "--json"), runner.lines("lens", design)
    for line in lines:
        key, text = line.split()
        expected = (lens["lens"] | lens["foci"][1])[key]
        assert text == expected if isinstance(expected, str) else float(text) == pytest.approx(expected, rel=1e-5)


def test_run_ends_with_path_of_report(
    runner: CommandRunner, design: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html, "figures", lambda *_: dict.fromkeys(("response", "rays", "rays-at-the-lens"), "<svg/>"))
    lines = runner.lines("run", design, "--out", str(tmp_path / "o u t"), *STEP, "--set", "lens.shape=none")
    assert lines[0].startswith("Paper 860 nm: index 1.44 at 860 nm")
    assert lines[-1] == f"report: {tmp_path / 'o u t' / 'report.html'}"
    assert lines[1] == "what to expect"
    assert lines[2].split()[:5] == ["contrast", "+0.0440", "±", "<", "0.0001"]
    (built,) = [line for line in lines if line.startswith("  as built (chip 0.2 × 0.2 mm, lambertian within ±60°")]
    assert "per degree at the null" in built
    head = next(number for number, line in enumerate(lines) if line.startswith("what matters"))
    assert lines[head].split("  ")[-1] == "light"
    assert any(line.startswith("  decentre of the emitter") and " 10 µm " in line for line in lines[head:])


UNCERTAIN = """
schema = 1
name = "unsure"
[index]
kind = "number"
mode = "as-published"
n = 1.46
u_n = 0.02
warnings = ["no reflectance went into it"]
"""


def test_reports_missing_properties_of_resin(
    runner: CommandRunner, design: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html, "figures", lambda *_: dict.fromkeys(("response", "rays", "rays-at-the-lens"), "<svg/>"))
    (Path(design).parent / "unsure.toml").write_text(UNCERTAIN, encoding="utf-8")
    resin = ("--set", "material.resin=unsure.toml")
    warning = "warning: index: no reflectance went into it"
    for command in ("check", "lens", "trace"):
        assert warning in runner.lines(command, design, *resin)
    result = runner.json("check", design, *resin, "--json")
    assert result["material"]["warnings"] == ["index: no reflectance went into it"]
    for command in ("lens", "trace"):
        assert runner.json(command, design, *resin, "--json")["warnings"] == result["material"]["warnings"]
    assert ["mode", "as-published"] in [line.split() for line in runner.lines("check", design, *resin)]
    foci = [line for line in runner.lines("lens", design, *resin) if line.startswith("  index ")]
    assert [line.split()[1] for line in foci] == ["1.44", "1.48"]
    run = runner.lines("run", design, "--out", str(tmp_path / "out"), *STEP, *resin)
    assert run[0] == "Paper 860 nm: index 1.46 ± 0.02 at 860 nm; in the plane"
    assert warning in run[-3:]


def test_reports_keys_without_effect(runner: CommandRunner, design: str) -> None:
    keys = ["--set", "receivers.height_mm=2", "--set", "material.absorption_per_mm=0.1"]
    height = 'receivers.height_mm = 2 has no effect in the plane; set trace.dimension = "extruded"'
    absorption = 'material.absorption_per_mm = 0.1 has no effect in mode "count"; set trace.mode = "power"'
    assert runner.json("trace", design, *keys, "--json")["warnings"] == [height, absorption]
    assert runner.json("trace", design, *keys, "--mode", "power", "--json")["warnings"] == [height]
    assert runner.json("trace", design, "--json")["warnings"] == []
    assert runner.json("check", design, *keys, "--json")["warnings"] == [height]
    assert f"warning: {height}" in runner.lines("trace", design, *keys)
    assert f"warning: {height}" in runner.lines("check", design, *keys)


def test_check_reports_valid_sensor_at_all_angles(runner: CommandRunner, design: str) -> None:
    lines = runner.lines("check", design)
    assert lines[0] == "Paper 860 nm: a valid sensor at all 25 angles"
    assert any(line.split() == ["arm_angle_deg", "7.38437"] for line in lines)


def test_paths_are_relative_to_working_folder(
    runner: CommandRunner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sub").mkdir()
    monkeypatch.chdir(tmp_path / "sub")
    assert runner.lines("new", "../a b")[0] == f"wrote {Path('..') / 'a b' / 'sensor.toml'}"
    runner.lines("lens", "../a b/sensor.toml", "--csv", "lens.csv")
    assert sorted(path.name for path in (tmp_path / "sub").iterdir()) == ["lens.csv"]


def test_resin_file_is_relative_to_design(
    runner: CommandRunner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resin = 'schema = 1\nname = "mine"\n[index]\nkind = "number"\nn = 1.5\n'
    (tmp_path / "designs").mkdir()
    (tmp_path / "designs" / "mine.toml").write_text(resin, encoding="utf-8")
    text = 'schema = 1\nname = "x"\n[material]\nresin = "mine.toml"\n'
    (tmp_path / "designs" / "sensor.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert runner.json("check", "designs/sensor.toml", "--json")["material"]["index"] == 1.5


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"], *([name, "--help"] for name in HELP_COMMANDS)], ids=str)
def test_help_succeeds(runner: CommandRunner, arguments: list[str]) -> None:
    assert any("Usage: solen" in line for line in runner.lines(*arguments))


def test_version(runner: CommandRunner) -> None:
    assert runner.lines("--version") == [solen.__version__]


def test_interrupt_gives_one_line_and_exit_code_130(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, design: str
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "open_design", interrupted)
    code = run_command(["check", design])
    printed = capsys.readouterr()
    assert (code, printed.out) == (130, "")
    assert printed.err.startswith("solen: interrupted")
    assert len(printed.err.splitlines()) == 1


def process(*arguments: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "solen", *arguments]
    return subprocess.run(command, capture_output=True, env=os.environ | environment, check=False)


def test_process_prints_only_one_json_object(design: str) -> None:
    process_run = process("trace", design, "--angle-deg", "-3", "--json")
    assert (process_run.returncode, without_waiting(process_run.stderr)) == (0, "")
    assert process_run.stdout.count(b"\n") == 1
    assert json.loads(process_run.stdout)["detectors"]["right"]["power"] == pytest.approx(0.6)


def test_closed_pipe_is_not_error(design: str) -> None:
    command = [sys.executable, "-m", "solen", "trace", design, "--rays", "3000", "--paths", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        assert running.stdout.read(10) == b'{"mode": "'
        running.stdout.close()
        errors = running.stderr.read()
    assert without_waiting(errors) == ""
    assert running.returncode == 0


@pytest.mark.parametrize("columns", [20, 40])
def test_help_fits_narrow_terminal(columns: int) -> None:
    process_run = process("trace", "--help", COLUMNS=str(columns), PYTHONUTF8="1")
    assert (process_run.returncode, without_waiting(process_run.stderr)) == (0, "")
    assert max(len(line) for line in process_run.stdout.decode("utf-8").splitlines()) <= columns


def test_json_with_any_name_is_printed_on_ascii_terminal(design: str) -> None:
    process_run = process("trace", design, "--set", "name=Ω – 1", "--json", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert (process_run.returncode, without_waiting(process_run.stderr)) == (0, "")
    assert json.loads(process_run.stdout)["name"] == "Ω – 1"


def test_lines_with_any_name_are_printed_on_ascii_terminal(design: str) -> None:
    process_run = process("trace", design, "--set", "name=Ω – 1", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert (process_run.returncode, without_waiting(process_run.stderr)) == (0, "")
