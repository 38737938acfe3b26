"""Bad input to every command: one line on stderr, nothing on stdout, exit code 2, and no files left behind."""

import os
import stat
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from solen.cli import run_command
from solen.sensor import traced
from solen.spec import template
from solen.trace import convergence
from tests.command_support import refusal, snapshot, without_waiting

GOOD = "".join(line for line in template().splitlines(keepends=True) if "(*)" not in line)  # a point source
HEAD = 'schema = 1\nname = "x"\n'
FILE_COMMANDS = ["check", "lens", "trace", "convergence", "sensitivity", "run"]
OUTPUT_OPTION = {
    "check": [],
    "lens": ["--csv", "lens.csv"],
    "trace": ["--figure", "rays.svg", "--netcdf", "rays.nc"],
    "convergence": ["--figure", "convergence.svg"],
    "sensitivity": [],
    "run": ["--out", "out"],
}


def command(name: str, file: Path | str) -> list[str]:
    """Arguments of a command that reads a file and writes all its output files into the working folder."""
    return [name, str(file), *OUTPUT_OPTION[name]]


class Refusal:
    """Runs a command in the folder of the test, and checks that it prints one line and leaves no files."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capsys = folder, capsys

    def __call__(self, *arguments: str) -> str:
        return refusal(self.capsys, self.folder, *arguments)


@pytest.fixture
def refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Refusal:
    folder = tmp_path / "a folder of one's own"
    folder.mkdir()
    (folder / "sensor.toml").write_text(GOOD, encoding="utf-8")
    monkeypatch.chdir(folder)
    return Refusal(folder, capsys)


def text_file(text: str) -> Callable[[], str]:
    def write() -> str:
        Path("bad.toml").write_text(text, encoding="utf-8")
        return "bad.toml"

    return write


def bytes_file() -> str:
    Path("bad.toml").write_bytes(b'schema = 1\nname = "caf\xe9"\n')
    return "bad.toml"


def folder() -> str:
    Path("folder").mkdir()
    return "folder"


def missing() -> str:
    return "missing.toml"


def under_a_file() -> str:
    return str(Path("sensor.toml") / "sensor.toml")


FILES: dict[str, tuple[Callable[[], str], str]] = {
    "missing": (missing, "missing.toml; no such file"),
    "a folder": (folder, "folder; "),
    "under a file": (under_a_file, "sensor.toml"),
    "empty": (text_file(""), "schema is missing"),
    "bad toml": (text_file(HEAD + "[material\nindex = 1.44"), "not valid TOML"),
    "twice the same key": (text_file(HEAD + "[material]\nindex = 1.44\nindex = 1.5"), "not valid TOML"),
    "not utf-8": (bytes_file, "not UTF-8"),
    "binary": (text_file("\0\1\2"), "not valid TOML"),
    "newer schema": (text_file(GOOD.replace("schema = 1 ", "schema = 9 ")), "newer solen"),
    "no material": (text_file(HEAD), "material"),
    "unknown table": (text_file(GOOD + "\n[lense]\nfocus_mm = 3\n"), "did you mean lens?"),
    "several emitters": (
        text_file(HEAD + "[material]\nindex = 1.44\n[[emitters]]\nrays = 3\n"),
        "did you mean network.emitters?",
    ),
    "missing resin file": (text_file(HEAD + '[material]\nresin = "none.toml"\n'), "none.toml"),
    "unknown resin": (text_file(HEAD + '[material]\nresin = "pmna"\n'), "did you mean pmma?"),
}


@pytest.mark.parametrize("name", FILE_COMMANDS)
@pytest.mark.parametrize("case", FILES)
def test_refuses_invalid_design_file(refused: Refusal, name: str, case: str) -> None:
    make, message = FILES[case]
    assert message in refused(*command(name, make()))


OVERLAPPING_ARMS = {"body.stem_curve_per_mm": "-0.008", "body.arm_angle_deg": "7.4", "body.arm_width_mm": "1"}
PIVOT_OUTSIDE = {"motion.moves": '["emitter"]', "motion.pivot": "[30.0, 0.0]"}
VALUES: dict[str, tuple[dict[str, str], str]] = {
    "unknown key": ({"lens.focus": "20"}, "did you mean lens.focus_mm?"),
    "key of another table": ({"lens.distance_mm": "1"}, "did you mean emitter.distance_mm?"),
    "reserved key": ({"emitter.power_mW": "50"}, "emitter.power_mW; is not yet supported"),
    "unknown kind": ({"motion.kind": '"shift"'}, "motion.kind"),
    "reserved seed": ({"trace.seed": "1"}, "trace.seed; is not yet supported"),
    "index below 1": ({"material.index": "0.99"}, "material.index = 0.99; must be at least 1"),
    "index of 1": ({"material.index": "1"}, "= 1.0; must be above 1"),
    "index nan": ({"material.index": "nan"}, "material.index = nan; must be a finite number"),
    "index infinite": ({"material.index": "inf"}, "finite"),
    "index text": ({"material.index": '"1.44"'}, "must be a number"),
    "index true": ({"material.index": "true"}, "must be a number"),
    "zero rays": ({"emitter.rays": "0"}, "at least 1"),
    "fractional rays": ({"emitter.rays": "1.5"}, "emitter.rays = 1.5; must be an integer"),
    "negative rays": ({"emitter.rays": "-3"}, "emitter.rays = -3"),
    "no cone": ({"emitter.cone_deg": "0"}, "emitter.cone_deg"),
    "negative distance": ({"emitter.distance_mm": "-1.0"}, "emitter.distance_mm"),
    "focus inside the lens": ({"lens.focus_mm": "1.9"}, "lens.focus_mm = 1.9; must be behind the lens"),
    "beyond tangency": ({"lens.half_width_mm": "2.95"}, "must be below 2.932 mm"),
    "bad shape": ({"lens.shape": '"sphere"'}, "'layered', 'measured' or 'none'"),
    "from above to": ({"motion.from_deg": "4"}, "must be less than motion.to_deg"),
    "from is to": ({"motion.from_deg": "3"}, "must be less than motion.to_deg"),
    "zero step": ({"motion.step_deg": "0"}, "motion.step_deg"),
    "too many steps": ({"motion.step_deg": "1e-6"}, "more than 100,000 steps"),
    "nothing moves": ({"motion.moves": "[]"}, "motion.moves"),
    "pivot of one number": ({"motion.pivot": "[1.0]"}, "motion.pivot"),
    "gap without air": ({"receivers.gap_mm": "0.5"}, "receivers.gap_mm"),
    "air without gap": ({"receivers.coupling": '"air-gap"'}, "receivers.gap_mm"),
    "bad mode": ({"trace.mode": '"bogus"'}, "'count', 'power' or 'roulette'"),
    "two lines of name": ({"name": '"a\\nb"'}, "one line"),
}
BODIES: dict[str, tuple[dict[str, str], str]] = {
    "self-crossing body": (OVERLAPPING_ARMS, "intersects itself"),
    "arms that never part": ({"body.arm_width_mm": "9"}, "body.arm_width_mm = 9"),
    "arms without an angle": ({"body.stem_curve_per_mm": "0"}, "body.arm_angle_deg"),
}


def in_file(values: dict[str, str]) -> str:
    """The example with these values replaced or added."""
    lines = GOOD.splitlines()
    for key, value in values.items():
        table, _, last = key.rpartition(".")
        head = lines.index(next(line for line in lines if line.startswith(f"[{table}]"))) if table else 0
        ends = next((i for i in range(head + 1, len(lines)) if lines[i].startswith("[")), len(lines))
        lines[head + 1 : ends] = [line for line in lines[head + 1 : ends] if line.split("=")[0].strip() != last]
        lines.insert(head + 1, f"{last} = {value}")
    return text_file("\n".join(lines) + "\n")()


def as_options(values: dict[str, str]) -> list[str]:
    return [part for key, value in values.items() for part in ("--set", f"{key}={value}")]


@pytest.mark.parametrize("name", FILE_COMMANDS)
@pytest.mark.parametrize("case", VALUES)
def test_refuses_invalid_value(refused: Refusal, name: str, case: str) -> None:
    values, message = VALUES[case]
    from_file = refused(*command(name, in_file(values)))
    assert message in from_file
    from_option = refused(*command(name, "sensor.toml"), *as_options(values))
    assert message in from_option
    assert from_file.replace("bad.toml: ", "") == from_option


@pytest.mark.parametrize("case", BODIES)
@pytest.mark.parametrize("name", FILE_COMMANDS)
def test_refuses_body_that_cannot_be_built(refused: Refusal, name: str, case: str) -> None:
    values, message = BODIES[case]
    assert message in refused(*command(name, in_file(values)))
    assert message in refused(*command(name, "sensor.toml"), *as_options(values))


@pytest.mark.parametrize("arguments", [["check"], ["trace", "--angle-deg", "-3"], ["run", "--out", "out"]], ids=str)
def test_refuses_motion_that_moves_emitter_into_body(refused: Refusal, arguments: list[str]) -> None:
    name, *options = arguments
    assert "inside the body" in refused(name, "sensor.toml", *options, *as_options(PIVOT_OUTSIDE))


@pytest.mark.parametrize("name", FILE_COMMANDS)
@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("lens.focus_mm", "not of the form key=value"),
        ("=3", "not of the form key=value"),
        ("", "key=value"),
        ("bogus=3", "bogus; unknown key"),
        ("lens.bogus=3", "lens.bogus; unknown key"),
        ("lens=3", "lens = 3; must be a table"),
        ("name.x=3", "name"),
        ("emitter.rays.x=3", "emitter.rays"),
        ("lens.focus_mm=", "must be a number"),
        ("lens.focus_mm=20 mm", "must be a number"),
    ],
)
def test_refuses_invalid_assignment(refused: Refusal, name: str, assignment: str, message: str) -> None:
    assert message in refused(*command(name, "sensor.toml"), "--set", assignment)


@pytest.mark.parametrize("name", ["new", *FILE_COMMANDS])
def test_reports_missing_argument(refused: Refusal, name: str) -> None:
    assert "requires an argument" in refused(name)


@pytest.mark.parametrize("name", ["new", "schema", *FILE_COMMANDS])
def test_reports_unknown_option(refused: Refusal, name: str) -> None:
    file = [] if name == "schema" else ["sensor.toml"]
    out = ["--out", "out"] if name == "run" else []
    assert "--bogus" in refused(name, *file, *out, "--bogus")


@pytest.mark.parametrize("name", ["new", "schema", *(name for name in FILE_COMMANDS if name != "sensitivity")])
def test_reports_surplus_argument(refused: Refusal, name: str) -> None:
    file = [] if name == "schema" else ["x"]
    out = ["--out", "out"] if name == "run" else []
    assert "extra" in refused(name, *file, "extra", *out)


ADAPTIVE = ["--sampling", "adaptive"]
SAMPLINGS = [
    (["--sampling", "bogus"], "bogus"),
    (["--sampling", ""], "--sampling"),
    (["--seed", "1"], "seed = 1; mode count with a fan uses"),
    (["--seed", "1", "--mode", "power"], "mode power with a fan uses"),
    *((["--sampling", "sobol", "--seed", seed], "--seed") for seed in
      ("-1", "1.5", "x", "", "²", "9223372036854775808", "9" * 40)),
    (["--tolerance", "1e-6"], "--tolerance = 1e-06; applies only to adaptive sampling"),
    (["--sampling", "sobol", "--tolerance", "1e-6"], "applies only to adaptive sampling"),
    *(([*ADAPTIVE, "--tolerance", text], "tolerance = ") for text in ("nan", "0", "-1", "1", "inf", "1e-13")),
    ([*ADAPTIVE, "--tolerance", "fine"], "--tolerance"),
    ([*ADAPTIVE, "--mode", "roulette"], "mode = 'roulette'; must be count or power for adaptive integration"),
    *(([*ADAPTIVE, *options_given], "adaptive") for options_given in
      (["--seed", "1"], ["--precision", "single"], ["--histogram", "4"], ["--rays", "50"], ["--paths", "--json"])),
    (["--precision", "half"], "half"),
    *((["--histogram", bins], "--histogram") for bins in
      ("0", "-1", "1.5", "ten", "10001")),
    (["--netcdf", "x.cdf"], "x.cdf; a netCDF file must end in .nc; rename it"),
    (["--netcdf", "x"], "a netCDF file must end in .nc"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["bogus"], "bogus"),
        (["--bogus"], "--bogus"),
        (["tarce", "sensor.toml"], "trace"),
        (["run", "sensor.toml"], "--out"),
        (["run", "sensor.toml", "--out"], "--out"),
        (["check", "sensor.toml", "--set"], "--set"),
        (["trace", "sensor.toml", "--angle-deg"], "--angle-deg"),
        (["trace", "sensor.toml", "--angle-deg", "nan"], "--angle-deg = nan; must be between -90 and 90"),
        (["trace", "sensor.toml", "--angle-deg", "200"], "--angle-deg = 200.0; must be between -90 and 90"),
        (["trace", "sensor.toml", "--angle-deg", "-90"], "must be between -90 and 90"),
        (["trace", "sensor.toml", "--angle-deg", "-3mm"], "--angle-deg = -3mm; must be a number"),
        (["trace", "sensor.toml", "--angle-deg", "three"], '--angle-deg: unable to convert "three"'),
        (["trace", "sensor.toml", "--mode", "bogus"], "bogus"),
        (["trace", "sensor.toml", "--mode", ""], "--mode"),
        (["trace", "sensor.toml", "--rays", "0"], "at least 1"),
        (["trace", "sensor.toml", "--rays", "-1"], "at least 1"),
        (["trace", "sensor.toml", "--rays", "many"], "--rays"),
        (["trace", "sensor.toml", "--rays", "nan"], "--rays"),
        (["trace", "sensor.toml", "--rays", "1.5"], "--rays"),
        (["trace", "sensor.toml", "--rays", ""], "--rays"),
        (["trace", "sensor.toml", "--rays"], "--rays"),
        (["trace", "sensor.toml", "--paths"], "--paths; can only be written as JSON or netCDF; add --json"),
        (["trace", "sensor.toml", "--rays", "2000000000"], "at most 1000000000"),
        (["trace", "sensor.toml", "--paths", "--json", "--rays", "100001"], "at most 100000"),
        (["trace", "sensor.toml", "--figure", "rays.jpg"], ".svg, .pdf"),
        (["trace", "sensor.toml", "--figure", "rays"], ".svg, .pdf"),
        *((["trace", "sensor.toml", *arguments], message) for arguments, message in SAMPLINGS),
        (["convergence", "sensor.toml", "--mode", "bogus"], "bogus"),
        (["convergence", "sensor.toml", "--angle-deg", "inf"], "--angle-deg = inf"),
        (["convergence", "sensor.toml", "--figure", "x.jpg"], ".svg, .pdf"),
        (["sensitivity", "sensor.toml", "--angle-deg", "90"], "--angle-deg = 90.0"),
        (["sensitivity", "sensor.toml", "bogus"], "bogus; unknown key"),
        (["sensitivity", "sensor.toml", "lens.bogus"], "lens.bogus; unknown key"),
        (["sensitivity", "sensor.toml", "emitter.rays"], "emitter.rays = 100; "),
        (["sensitivity", "sensor.toml", "lens.shape"], "real number"),
        (["sensitivity", "sensor.toml", "lens.design_index"], "lens.design_index; "),
        (["sensitivity", "sensor.toml", "lens.focus_mm", "receivers.gap_mm"], "has no air gap; omit receivers.gap_mm"),
        (["lens", "sensor.toml", "--csv", "x.csv", "--tolerance-mm", "0"], "--tolerance-mm"),
        (["lens", "sensor.toml", "--csv", "x.csv", "--tolerance-mm", "nan"], "--tolerance-mm"),
        (["lens", "sensor.toml", "--csv", "x.csv", "--tolerance-mm", "fine"], "--tolerance-mm"),
        (["new", "x", "--example", "solen-680"], "solen-860"),
        (["new", "x", "--example", "../solen-860"], "solen-860"),
        (["new", "."], "already exists"),
        (["new", "sensor.toml"], "cannot be written"),
        (["new", "sensor.toml/x"], "cannot be written"),
    ],
    ids=lambda value: value if isinstance(value, str) else " ".join(value),
)
def test_refuses_invalid_option(refused: Refusal, arguments: list[str], message: str) -> None:
    assert message in refused(*arguments)


def test_sensitivity_requires_converged_integral(refused: Refusal, monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit on rays is reduced here; light that leaks from an air gap reaches the real limit only after seconds."""
    monkeypatch.setattr("solen.sensor.derivatives.MAX_SEGMENTS", 4000)
    gap = ("--set", "receivers.coupling=air-gap", "--set", "receivers.gap_mm=0.5")
    line = refused("sensitivity", "sensor.toml", *gap)
    assert "1e-09" in line
    assert "another angle" in line


@pytest.mark.parametrize("name", FILE_COMMANDS)
def test_file_is_positional_only(refused: Refusal, name: str) -> None:
    assert "Unknown option: --file" in refused(name, "--file", "sensor.toml", *OUTPUT_OPTION[name])


def test_folder_is_positional_only(refused: Refusal) -> None:
    assert "Unknown option: --folder" in refused("new", "--folder", "x")


def test_suggests_only_similar_options(refused: Refusal) -> None:
    for wrong, suggestion in (
        ("--figur", "--figure"),
        ("--angle", "--angle-deg"),
        ("--angel", "--angle-deg"),
        ("--width", "--width-mm"),
        ("--heigth-mm", "--height-mm"),
        ("--no-len", "--no-lens"),
        ("--fontt", "--font"),
    ):
        assert f"Unknown option: {wrong}; did you mean {suggestion}?" in refused("trace", "sensor.toml", wrong, "3")
    for wrong in ("--out", "--outt", "--save", "--foo"):
        assert f"Unknown option: {wrong}; see the command's --help" in refused("trace", "sensor.toml", wrong, "x")
    assert "did you mean --out?" in refused("run", "sensor.toml", "--output", "x", "--out", "y")


OUTPUTS = {
    "under a file": "sensor.toml/x.svg",
    "in a folder that is not": "nowhere/x.svg",
    "a folder": "folder.svg",
    "too long a name": "x" * 253 + ".svg",
}
FILE_OPTIONS = [["lens", "--csv"], ["trace", "--figure"], ["convergence", "--figure"], ["trace", "--netcdf"]]


@pytest.mark.parametrize("option", FILE_OPTIONS, ids=" ".join)
@pytest.mark.parametrize("case", OUTPUTS)
def test_reports_file_that_cannot_be_written(
    refused: Refusal, option: list[str], case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(traced, "convergence", partial(convergence, max_rays=16))
    name, flag = option
    target = OUTPUTS[case].replace(".svg", {"--netcdf": ".nc", "--csv": ".csv"}.get(flag, ".svg"))
    for ending in (".svg", ".nc", ".csv"):
        (refused.folder / f"folder{ending}").mkdir()
    before = snapshot(refused.folder)
    code = run_command([name, "sensor.toml", flag, target])
    printed = refused.capsys.readouterr()
    assert (code, printed.out) == (2, "")
    assert "cannot be written" in printed.err or "already exists" in printed.err
    assert len(printed.err.splitlines()) == 1
    assert snapshot(refused.folder) == before


def test_writes_all_files_or_none(refused: Refusal) -> None:
    for figure, netcdf in (("rays.svg", "nowhere/rays.nc"), ("nowhere/rays.svg", "rays.nc")):
        assert "cannot be written" in refused("trace", "sensor.toml", "--figure", figure, "--netcdf", netcdf)


@pytest.mark.parametrize("missing", ["xarray", "h5netcdf", "h5py"])
def test_reports_missing_package_with_remedy(refused: Refusal, monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    line = refused("trace", "sensor.toml", "--netcdf", "rays.nc")
    assert f"netCDF; requires {missing}, which is not installed; pip install" in line


@pytest.mark.parametrize("table", ["", ".", "/", "l.xyz"])
def test_refuses_table_with_wrong_extension(refused: Refusal, table: str) -> None:
    assert "end in .csv" in refused("lens", "sensor.toml", "--csv", table)


def test_keeps_existing_table(refused: Refusal, tmp_path: Path) -> None:
    recording = tmp_path / "recording.csv"
    recording.write_text("t,u", encoding="utf-8")
    assert "--force" in refused("lens", "sensor.toml", "--csv", str(recording))
    assert recording.read_text(encoding="utf-8") == "t,u"


@pytest.mark.parametrize("out", ["sensor.toml", "sensor.toml/out"])
def test_refuses_invalid_output_folder(refused: Refusal, out: str) -> None:
    assert "cannot be written" in refused("run", "sensor.toml", "--out", out)


@pytest.mark.parametrize("arguments", [["new"], ["run", "sensor.toml", "--out"]], ids=" ".join)
def test_refuses_folder_name_that_is_too_long(refused: Refusal, arguments: list[str]) -> None:
    assert "cannot be written" in refused(*arguments, "x" * 300)


def test_removes_parents_of_folder_that_cannot_be_created(refused: Refusal) -> None:
    assert "cannot be written" in refused("run", "sensor.toml", "--out", "one/two/" + "x" * 300)


@pytest.mark.parametrize(
    "assignment",
    [
        *("lens.focus_mm=1e300", "lens.focus_mm=1e-16", "emitter.distance_mm=1e150", "lens.half_width_mm=1e300"),
        *("body.arm_length_mm=1e-16", "body.arm_length_mm=1e300", "body.stem_length_mm=1e300"),
    ],
)
def test_refuses_unrealistic_lengths(refused: Refusal, assignment: str) -> None:
    assert assignment.partition("=")[0] in refused("trace", "sensor.toml", "--set", assignment)


@pytest.mark.parametrize(
    "arguments",
    [
        ["lens", "sensor.toml", "--set", "lens.half_width_mm=2.95"],
        ["bogus"],
    ],
    ids=" ".join,
)
def test_process_ends_with_one_line_and_exit_code_2(tmp_path: Path, arguments: list[str]) -> None:
    (tmp_path / "sensor.toml").write_text(GOOD, encoding="utf-8")
    before = snapshot(tmp_path)
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONWARNINGS"}
    process_run = subprocess.run(
        [sys.executable, "-m", "solen", *arguments], cwd=tmp_path, env=environment, capture_output=True, check=False
    )
    assert process_run.returncode == 2
    assert process_run.stdout == b""
    errors = without_waiting(process_run.stderr)
    assert errors.count("\n") == 1
    assert errors.startswith("solen: ")
    assert snapshot(tmp_path) == before


@pytest.mark.skipif(sys.platform == "win32", reason="requires permission to create links")
def test_writes_target_of_link(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sensor.toml").write_text(GOOD, encoding="utf-8")
    (tmp_path / "real.csv").write_text("old", encoding="utf-8")
    (tmp_path / "link.csv").symlink_to("real.csv")
    assert run_command(["lens", str(tmp_path / "sensor.toml"), "--csv", str(tmp_path / "link.csv"), "--force"]) == 0
    assert capsys.readouterr().err == ""
    assert (tmp_path / "link.csv").is_symlink()
    assert (tmp_path / "real.csv").read_text(encoding="utf-8").startswith("x_mm")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="requires named pipes")
def test_never_replaces_pipe(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "sensor.toml").write_text(GOOD, encoding="utf-8")
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    assert run_command(["lens", str(tmp_path / "sensor.toml"), "--csv", str(pipe), "--force"]) == 2
    assert "cannot be written: not an ordinary file" in capsys.readouterr().err
    assert stat.S_ISFIFO(pipe.stat().st_mode)


def test_reports_surplus_arguments_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["print", "inspect", "a.tif", "b.tif", "--design", "sensor.toml"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("solen: b.tif; is a surplus argument")
    assert "--help" in error
