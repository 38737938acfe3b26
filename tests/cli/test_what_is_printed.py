"""What a command prints: one JSON object and nothing else, or lines that say the same; and what it ends with."""

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
HELPED = ("trace", "convergence", "sensitivity", "run")


@pytest.fixture(autouse=True)
def few_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run compares one number of the design here: its lines are the same with more."""
    monkeypatch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm",))
    monkeypatch.setattr("solen.sensor.effects.HOLDS", {})


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> str:
    target = tmp_path_factory.mktemp("my design") / "sensor.toml"
    target.write_text(template("paper-860"), encoding="utf-8")
    return str(target)


class Told:
    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def lines(self, *arguments: str) -> list[str]:
        """Lines of stdout of a command that succeeds without a word on stderr."""
        self.capsys.readouterr()
        code = run_command(list(arguments))
        printed = self.capsys.readouterr()
        assert (code, printed.err) == (0, "")
        return printed.out.splitlines()

    def json(self, *arguments: str) -> dict[str, Any]:
        """The one JSON object on stdout."""
        text = "\n".join(self.lines(*arguments))

        def refuse(constant: str) -> None:
            raise AssertionError(constant)

        found = json.loads(text, parse_constant=refuse)
        assert isinstance(found, dict)
        return found


@pytest.fixture
def told(capsys: pytest.CaptureFixture[str]) -> Told:
    return Told(capsys)


def test_commands_of_a_design_print_one_json_object(told: Told, design: str, tmp_path: Path) -> None:
    assert told.json("new", str(tmp_path / "new"), "--json") == {
        "design": str(tmp_path / "new" / "sensor.toml"),
        "example": "solen-860",
        "files": {"schema": str(tmp_path / "new" / "sensor.schema.json")},
    }
    assert told.json("schema", "--json")["title"] == "solen design file"
    assert told.json("schema") == told.json("schema", "--json")
    assert told.json("check", design, "--json")["angles"] == 25
    assert told.json("lens", design, "--json")["lens"]["focus_mm"] == 20.0
    assert told.json("trace", design, "--json")["rays"] == 100
    found = told.json("run", design, "--out", str(tmp_path / "out"), *STEP, "--json")
    assert found["summary"]["lens"]["to_deg"] == 3.0
    assert all(Path(name).is_file() for name in found["files"].values())


def test_json_with_csv_and_figure_says_where_they_are(told: Told, design: str, tmp_path: Path) -> None:
    table, figure = tmp_path / "lens.csv", tmp_path / "rays.svg"
    assert told.json("lens", design, "--csv", str(table), "--json")["files"] == {"profile": str(table)}
    assert told.json("trace", design, "--figure", str(figure), "--json")["files"] == {"figure": str(figure)}
    assert table.is_file()
    assert figure.is_file()


@pytest.mark.parametrize("mode", ["count", "power"])
def test_a_trace_has_the_keys_it_is_asked_for(told: Told, design: str, mode: str) -> None:
    found = told.json("trace", design, "--angle-deg", "-1", "--rays", "50", "--mode", mode, "--json")
    assert set(found["detectors"]) == {"left", "right"}
    for detector in found["detectors"].values():
        assert (detector["power_by_angle"], detector["power_by_position"]) == ([], [])
        assert isinstance(detector["rays"], int)
    assert set(found["ledger"]) == {"detected", "escaped", "absorbed", "truncated"}
    assert sum(found["ledger"].values()) == pytest.approx(1.0, abs=1e-12)
    assert (found["rays"], found["mode"], found["angle_deg"]) == (50, mode, -1.0)
    assert found["branches"] is None


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
def test_every_way_to_trace_has_the_same_keys(told: Told, design: str, arguments: list[str]) -> None:
    found = told.json("trace", design, "--angle-deg", "0.2", *arguments, "--json")
    assert set(found) == TRACED
    assert sum(found["ledger"].values()) == pytest.approx(1.0, abs=1e-7 if "single" in arguments else 1e-12)
    assert (found["single_error"] is None) == ("single" not in arguments)
    assert (found["pieces"] > 0) == ("adaptive" in arguments)
    assert (found["why"] == "") == found["reached"]
    lines = told.lines("trace", design, "--angle-deg", "0.2", *arguments)
    assert lines[0].startswith(f"Paper 860 nm at 0.2 deg, {found['rays']} rays, mode {found['mode']}")
    assert any("single precision" in line for line in lines) == ("single" in arguments)
    assert any("tolerance was not reached" in line for line in lines) == (not found["reached"])


def test_an_uncertainty_that_is_not_known_is_null(told: Told, design: str) -> None:
    found = told.json("trace", design, "--rays", "1", "--json")
    assert [one["u_power"] for one in found["detectors"].values()] == [None, None]


def test_a_tolerance_is_what_the_uncertainty_stays_below(told: Told, design: str) -> None:
    how = ("--sampling", "adaptive", "--mode", "power", "--angle-deg", "0.2", "--json")
    loose, tight, plain = (told.json("trace", design, *how, *more) for more in
                           (("--tolerance", "1e-2"), ("--tolerance", "1e-9"), ()))  # fmt: skip
    for found, tolerance in ((loose, 1e-2), (tight, 1e-9), (plain, 1e-6)):
        assert found["method"] == "adaptive"
        assert found["reached"]
        for side in ("right", "left"):
            assert found["detectors"][side]["u_power"] <= tolerance
            off = abs(found["detectors"][side]["power"] - tight["detectors"][side]["power"])
            assert off <= found["detectors"][side]["u_power"] + 1e-9
    assert loose["rays"] < plain["rays"] < tight["rays"]


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
def test_a_seed_makes_the_sample(told: Told, design: str, mode: str) -> None:
    how = ("--mode", mode, "--sampling", "sobol", "--rays", "200", "--angle-deg", "0.2", "--json")
    one, same, other = (told.json("trace", design, *how, "--seed", seed) for seed in ("1", "1", "2"))
    assert one == same
    assert one["detectors"] != other["detectors"]
    assert one["rays"] == 256
    assert all(detector["u_power"] > 0.0 for detector in one["detectors"].values())


def test_a_histogram_adds_up_to_the_power(told: Told, design: str) -> None:
    found = told.json("trace", design, "--rays", "500", "--mode", "power", "--histogram", "7", "--json")
    for side, detector in found["detectors"].items():
        assert found["faces"][side] == [f"receiver-{side}"]
        (by_position,) = detector["power_by_position"]
        assert len(detector["power_by_angle"]) == len(by_position) == 7
        assert sum(detector["power_by_angle"]) == pytest.approx(detector["power"], abs=1e-12)
        assert sum(by_position) == pytest.approx(detector["power"], abs=1e-12)


def test_a_netcdf_file_holds_what_was_traced_and_the_design(told: Told, design: str, tmp_path: Path) -> None:
    target = tmp_path / "a trace.nc"
    how = ("--angle-deg", "0.2", "--mode", "power", "--histogram", "5", "--paths", "--netcdf", str(target))
    found = told.json("trace", design, *how, "--json")
    assert found["files"] == {"netcdf": str(target)}
    held = xr.load_dataset(target, engine="h5netcdf")
    assert (held.attrs["name"], held.attrs["angle_deg"], held.attrs["simulated"]) == ("Paper 860 nm", 0.2, 1)
    assert loads(held.attrs["design"]).trace.mode == "power"
    for side, detector in found["detectors"].items():
        assert float(held["power"].sel(receiver=side)) == detector["power"]
        assert list(held["power_by_angle"].sel(receiver=side).values) == detector["power_by_angle"]
    faces = held.attrs["interfaces"].split(", ")
    first = held.isel(leg=0)
    assert found["branches"][0]["faces"][:1] == [faces[int(first["leg_interface"])]][: int(first["leg_interface"] >= 0)]
    assert found["branches"][0]["points_mm"][0] == [float(first["leg_x_mm"]), float(first["leg_z_mm"])]
    first_bytes = target.read_bytes()
    assert told.lines("trace", design, *how)[-1] == f"netcdf: {target}"
    assert target.read_bytes() == first_bytes


def test_convergence_says_the_same_in_lines_in_json_and_draws_it(
    told: Told, design: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(traced, "convergence", partial(convergence, most_rays=64))
    figure = tmp_path / "convergence.svg"
    how = ("convergence", design, "--angle-deg", "0.2", "--figure", str(figure))
    found, lines = told.json(*how, "--json"), told.lines(*how)
    assert set(found) == AT | {"name", "emitter", "mode", "reference", "series", "warnings", "files"}
    assert (found["mode"], found["angle_deg"], found["files"]) == ("power", 0.2, {"figure": str(figure)})
    assert set(found["reference"]["detectors"]) == {"left", "right"}
    assert found["reference"]["method"] == "adaptive"
    assert [series["method"] for series in found["series"]] == ["fan", "sobol", "adaptive"]
    assert found["series"][0]["rays"] == [16, 32, 64]
    rows = [line.split() for line in lines[1:-1]]
    assert [row[0] for row in rows] == [series["method"] for series in found["series"] for _ in series["rays"]]
    assert [int(row[1]) for row in rows] == [rays for series in found["series"] for rays in series["rays"]]
    errors = [error for series in found["series"] for error in series["error"]]
    assert [float(row[4]) for row in rows] == pytest.approx(errors, rel=0.06)
    assert lines[-1] == f"figure: {figure}"
    assert figure.read_bytes().startswith(b"<?xml")
    assert told.json("convergence", design, "--mode", "count", "--json")["mode"] == "count"


def test_sensitivity_says_the_same_in_lines_and_in_json(told: Told, design: str) -> None:
    how = ("sensitivity", design, "--angle-deg", "0.2")
    found, lines = told.json(*how, "--json"), told.lines(*how)
    assert set(found) == AT | {"name", "sensitivities", "skipped", "warnings", "simulated", "files"}
    rows = {line.split()[0]: line.split()[1:] for line in lines[2:]}
    for row in found["sensitivities"]:
        assert set(row) == {"key", "value", "right", "left", "contrast", "why", "tolerance", "effect"}
        shown = rows[row["key"]]
        assert float(shown[0]) == pytest.approx(row["value"], rel=1e-5)
        if row["why"] is None:
            wanted = [row[name]["value"] for name in ("right", "left", "contrast")]
            assert [float(text) for text in shown[1:4]] == pytest.approx(wanted, rel=1e-5)
        else:
            assert row["contrast"] == {"value": None, "u_value": None}
            assert row["why"].split() == shown[1:]
    assert [line for line in lines if line.startswith("omitted: ")] == [
        f"omitted: {key}: {why}" for key, why in found["skipped"].items()
    ]
    two = told.json(*how, "body.arm_width_mm", "lens.focus_mm", "--json")
    by_key = {row["key"]: row for row in found["sensitivities"]}
    assert two["sensitivities"] == [by_key["body.arm_width_mm"], by_key["lens.focus_mm"]]
    assert two["skipped"] == {}


def test_in_the_dark_there_is_no_contrast_to_change(told: Told, design: str) -> None:
    dark = ("--set", "material.absorption_per_mm=1000.0")
    (row,) = told.json("sensitivity", design, "body.arm_width_mm", *dark, "--json")["sensitivities"]
    assert (row["right"]["value"], row["contrast"]["value"], row["why"]) == (0.0, None, None)
    assert "none" in told.lines("sensitivity", design, "body.arm_width_mm", *dark)[2]


def test_the_paper_s_numbers_come_out_of_the_command(told: Told, design: str) -> None:
    found = told.json("trace", design, "--angle-deg", "-3", "--rays", "100000", "--json")
    assert found["detectors"]["right"]["power"] == pytest.approx(0.5905, abs=0.003)
    left = found["detectors"]["left"]
    assert (left["power"], left["u_power"], left["rays"], left["optical_path_mm"]) == (0.0, 1e-5, 0, None)
    assert found["detectors"]["right"]["rays"] == round(found["detectors"]["right"]["power"] * 100_000)
    rest = told.json("trace", design, "--rays", "100000", "--json")["detectors"]
    assert rest["left"]["power"] == pytest.approx(0.5905 / 2, abs=0.0015)
    assert rest["right"]["power"] == pytest.approx(0.5905 / 2, abs=0.0015)
    power = told.json("trace", design, "--angle-deg", "-3", "--rays", "20000", "--mode", "power", "--json")
    assert power["ledger"]["detected"] == pytest.approx(0.5207, abs=0.003)


def test_without_lens_the_receivers_hardly_differ(told: Told, design: str) -> None:
    found = told.json("trace", design, "--angle-deg", "-3", "--no-lens", "--rays", "20000", "--json")
    right, left = (found["detectors"][side]["power"] for side in ("right", "left"))
    assert found["lens"] == "none"
    assert 0.0 < (right - left) / (right + left) < 0.12
    by_set = told.json("trace", design, "--angle-deg", "-3", "--set", "lens.shape=none", "--rays", "20000", "--json")
    assert by_set == found


def test_paths_are_added_with_json(told: Told, design: str) -> None:
    plain = told.json("trace", design, "--rays", "8", "--angle-deg", "1", "--json")
    found = told.json("trace", design, "--rays", "8", "--angle-deg", "1", "--paths", "--json")
    paths = found.pop("branches")
    lengths = [result["detectors"]["left"].pop("optical_path_mm") for result in (found, plain)]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-12)
    assert found | {"branches": None} == plain
    assert [path["ray"] for path in paths] == list(range(8))
    for path in paths:
        assert set(path) == {"ray", "branch", "parent", "fate", "power", "faces", "points_mm", "exit_direction"}
        assert len(path["points_mm"]) == len(path["faces"]) + 1
        assert (path["exit_direction"] is None) == (path["fate"] != "escaped")
    arrived = [path["faces"][-1] for path in paths if path["fate"] == "detected"]
    assert arrived.count("receiver-left") == plain["detectors"]["left"]["rays"] > 0


def test_paths_of_a_ray_straight_ahead_warn_of_nothing(told: Told, design: str) -> None:
    assert len(told.json("trace", design, "--rays", "3", "--mode", "power", "--paths", "--json")["branches"]) >= 3


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
def test_set_takes_toml_else_text(
    told: Told, design: str, assignments: list[str], where: tuple[str], value: object
) -> None:
    options = [part for assignment in assignments for part in ("--set", assignment)]
    found: Any = told.json("trace", design, "--json", *options)
    for key in where:
        found = found[key]
    assert found == value


def test_an_option_of_its_own_is_stronger_than_set(told: Told, design: str) -> None:
    found = told.json("trace", design, "--rays", "20", "--set", "emitter.rays=30", "--json")
    assert found["rays"] == 20


def test_lines_say_what_json_says(told: Told, design: str) -> None:
    arguments = ["trace", design, "--angle-deg", "-3", "--rays", "1000"]
    found, lines = told.json(*arguments, "--json"), told.lines(*arguments)
    assert lines[0] == "Paper 860 nm at -3 deg, 1000 rays, mode count"
    shown = {line.split()[0]: float(line.split()[1]) for line in lines[1:]}
    assert shown["right"] == pytest.approx(found["detectors"]["right"]["power"], abs=1e-6)
    for key, value in found["ledger"].items():
        assert shown[key] == pytest.approx(value, abs=1e-6)
    lens, lines = told.json("lens", design, "--json"), told.lines("lens", design)
    for line in lines:
        key, text = line.split()
        wanted = (lens["lens"] | lens["foci"][1])[key]
        assert text == wanted if isinstance(wanted, str) else float(text) == pytest.approx(wanted, rel=1e-5)


def test_a_run_ends_with_where_its_report_is(
    told: Told, design: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html, "figures", lambda *_: dict.fromkeys(("response", "rays", "rays-at-the-lens"), "<svg/>"))
    lines = told.lines("run", design, "--out", str(tmp_path / "o u t"), *STEP, "--set", "lens.shape=none")
    assert lines[0].startswith("Paper 860 nm: index 1.44 at 860 nm")
    assert lines[-1] == f"report: {tmp_path / 'o u t' / 'report.html'}"
    assert lines[1] == "what to expect"
    assert lines[2].split()[:5] == ["contrast", "+0.0440", "±", "<", "0.0001"]
    (built,) = [line for line in lines if line.startswith("  as built (chip 0.2 × 0.2 mm, lambertian within ±60°")]
    assert "per degree at the null" in built
    head = next(place for place, line in enumerate(lines) if line.startswith("what matters"))
    assert lines[head].split("  ")[-1] == "light"
    assert any(line.startswith("  decentre of the emitter") and " 10 µm " in line for line in lines[head:])


UNSURE = """
schema = 1
name = "unsure"
[index]
kind = "number"
mode = "as-published"
n = 1.46
u_n = 0.02
warnings = ["no reflectance went into it"]
"""


def test_a_command_that_uses_a_resin_reports_what_is_missing_in_it(
    told: Told, design: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(html, "figures", lambda *_: dict.fromkeys(("response", "rays", "rays-at-the-lens"), "<svg/>"))
    (Path(design).parent / "unsure.toml").write_text(UNSURE, encoding="utf-8")
    resin = ("--set", "material.resin=unsure.toml")
    warning = "warning: index: no reflectance went into it"
    for command in ("check", "lens", "trace"):
        assert warning in told.lines(command, design, *resin)
    found = told.json("check", design, *resin, "--json")
    assert found["material"]["warnings"] == ["index: no reflectance went into it"]
    for command in ("lens", "trace"):
        assert told.json(command, design, *resin, "--json")["warnings"] == found["material"]["warnings"]
    assert ["mode", "as-published"] in [line.split() for line in told.lines("check", design, *resin)]
    foci = [line for line in told.lines("lens", design, *resin) if line.startswith("  index ")]
    assert [line.split()[1] for line in foci] == ["1.44", "1.48"]
    run = told.lines("run", design, "--out", str(tmp_path / "out"), *STEP, *resin)
    assert run[0] == "Paper 860 nm: index 1.46 ± 0.02 at 860 nm; in the plane"
    assert warning in run[-3:]


def test_keys_without_effect_are_reported(told: Told, design: str) -> None:
    keys = ["--set", "receivers.height_mm=2", "--set", "material.absorption_per_mm=0.1"]
    height = 'receivers.height_mm = 2 has no effect in the plane; set trace.dimension = "extruded"'
    absorption = 'material.absorption_per_mm = 0.1 has no effect in mode "count"; set trace.mode = "power"'
    assert told.json("trace", design, *keys, "--json")["warnings"] == [height, absorption]
    assert told.json("trace", design, *keys, "--mode", "power", "--json")["warnings"] == [height]
    assert told.json("trace", design, "--json")["warnings"] == []
    assert told.json("check", design, *keys, "--json")["warnings"] == [height]
    assert f"warning: {height}" in told.lines("trace", design, *keys)
    assert f"warning: {height}" in told.lines("check", design, *keys)


def test_check_says_that_all_angles_work(told: Told, design: str) -> None:
    lines = told.lines("check", design)
    assert lines[0] == "Paper 860 nm: a valid sensor at all 25 angles"
    assert any(line.split() == ["arm_angle_deg", "7.38437"] for line in lines)


def test_paths_and_folders_are_relative_to_where_one_is(
    told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sub").mkdir()
    monkeypatch.chdir(tmp_path / "sub")
    assert told.lines("new", "../a b")[0] == f"wrote {Path('..') / 'a b' / 'sensor.toml'}"
    told.lines("lens", "../a b/sensor.toml", "--csv", "lens.csv")
    assert sorted(path.name for path in (tmp_path / "sub").iterdir()) == ["lens.csv"]


def test_a_resin_file_lies_beside_its_design(told: Told, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    resin = 'schema = 1\nname = "mine"\n[index]\nkind = "number"\nn = 1.5\n'
    (tmp_path / "designs").mkdir()
    (tmp_path / "designs" / "mine.toml").write_text(resin, encoding="utf-8")
    text = 'schema = 1\nname = "x"\n[material]\nresin = "mine.toml"\n'
    (tmp_path / "designs" / "sensor.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert told.json("check", "designs/sensor.toml", "--json")["material"]["index"] == 1.5


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"], *([name, "--help"] for name in HELPED)], ids=str)
def test_help_ends_well(told: Told, arguments: list[str]) -> None:
    assert any("Usage: solen" in line for line in told.lines(*arguments))


def test_version(told: Told) -> None:
    assert told.lines("--version") == [solen.__version__]


def test_ctrl_c_is_one_line_and_130(
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


def test_a_true_process_prints_one_json_object_alone(design: str) -> None:
    done = process("trace", design, "--angle-deg", "-3", "--json")
    assert (done.returncode, without_waiting(done.stderr)) == (0, "")
    assert done.stdout.count(b"\n") == 1
    assert json.loads(done.stdout)["detectors"]["right"]["power"] == pytest.approx(0.6)


def test_a_reader_that_has_enough_is_no_error(design: str) -> None:
    command = [sys.executable, "-m", "solen", "trace", design, "--rays", "3000", "--paths", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        assert running.stdout.read(10) == b'{"mode": "'
        running.stdout.close()
        complaint = running.stderr.read()
    assert without_waiting(complaint) == ""
    assert running.returncode == 0


@pytest.mark.parametrize("columns", [20, 40])
def test_help_fits_a_narrow_terminal(columns: int) -> None:
    done = process("trace", "--help", COLUMNS=str(columns), PYTHONUTF8="1")
    assert (done.returncode, without_waiting(done.stderr)) == (0, "")
    assert max(len(line) for line in done.stdout.decode("utf-8").splitlines()) <= columns


def test_json_of_any_name_goes_through_any_terminal(design: str) -> None:
    done = process("trace", design, "--set", "name=Ω – 1", "--json", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert (done.returncode, without_waiting(done.stderr)) == (0, "")
    assert json.loads(done.stdout)["name"] == "Ω – 1"


def test_lines_of_any_name_go_through_any_terminal(design: str) -> None:
    done = process("trace", design, "--set", "name=Ω – 1", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert (done.returncode, without_waiting(done.stderr)) == (0, "")
