"""The `solen resin` commands: output and files; bad input gives one line and leaves no files."""

import hashlib
import json
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.cli import run_command
from solen.material import Tabulated, load_resin
from solen.material.index.stack import forward
from solen.spec import template
from tests.command_support import refusal

INDEX: dict[str, Any] = {
    "kind": "index",
    "mode": "measured",
    "wavelength_nm": [450.0, 650.0, 900.0],
    "n": [1.52, 1.5, 1.49],
    "u_n": [0.012, 0.012, 0.012],
    "fit": None,
    "warnings": [],
    "sources": [{"file": "layer.csv", "sha256": "12" * 32, "instrument": "Cary 5000", "date": "2026-01-02"}],
}
CUTBACK: dict[str, Any] = {
    "kind": "cutback",
    "absorption_per_mm": 0.01 * math.log(10.0),
    "u_absorption_per_mm": 0.004,
    "loss_dB_per_cm": 1.0,
    "interval95_loss_dB_per_cm": [0.6, 1.4],
    "wavelength_nm": 860.0,
    "warnings": [],
    "sources": [{"file": "guides.csv", "sha256": "34" * 32, "simulated": True}],
}
CURE: dict[str, Any] = {
    "kind": "cure",
    "Dp_um": 181.0,
    "Ec_mJ_per_cm2": 12.0,
    "covariance": [[9.0, 1.0], [1.0, 0.25]],
    "interval95_Dp_um": [175.0, 187.0],
    "interval95_Ec_mJ_per_cm2": [11.0, 13.0],
}
STIFFNESS: dict[str, Any] = {
    "kind": "stiffness",
    "label": None,
    "modulus_MPa": 1.5,
    "u_modulus_MPa": 0.1,
    "strain_range": [0.02, 0.1],
    "model": None,
}
RESULTS = {"index": INDEX, "cutback": CUTBACK, "cure": CURE, "stiffness": STIFFNESS}


class Shell:
    """Runs commands in the folder of the test."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capsys = folder, capsys

    def lines(self, *arguments: str) -> list[str]:
        """Lines on stdout of a command that succeeds and prints nothing on stderr."""
        self.capsys.readouterr()
        code = run_command(list(arguments))
        printed = self.capsys.readouterr()
        assert (code, printed.err) == (0, "")
        return printed.out.splitlines()

    def json(self, *arguments: str) -> Any:
        """The JSON object on stdout."""
        return json.loads("\n".join(self.lines(*arguments, "--json")), parse_constant=pytest.fail)

    def refused(self, *arguments: str) -> str:
        """The line printed by a command that fails; it must leave no files."""
        return refusal(self.capsys, self.folder, *arguments).removeprefix("solen: ").rstrip("\n")


@pytest.fixture
def shell(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Shell:
    folder = tmp_path / "my resins"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for name, data in RESULTS.items():
        (folder / f"{name}.json").write_text(json.dumps(data), encoding="utf-8")
    return Shell(folder, capsys)


ALL_RESULTS = tuple(part for name in RESULTS for part in (f"--{name}", f"{name}.json"))
NAME = ("--name", "ma-PU, batch 3")


def test_resin_file_contains_results_and_sources(shell: Shell) -> None:
    formulation = ("--formulation", "RA-139:75, lauryl acrylate:25")
    result = shell.json(
        "resin", "build", "r.toml", *NAME, *ALL_RESULTS, *formulation, "--source", "our lab", "--note", "dry"
    )
    assert set(result) == {
        *("resin", "name", "source", "notes", "index", "loss", "cure", "stiffness", "formulation", "sources", "at"),
        *("simulated", "warnings", "files"),
    }
    resin = load_resin("r.toml")
    assert (resin.name, resin.source, resin.notes) == ("ma-PU, batch 3", "our lab", "dry")
    assert isinstance(resin.index, Tabulated)
    assert resin.index.index(860.0) == pytest.approx(1.5 - 0.01 * 210 / 250)
    assert resin.index.u_index(860.0) == pytest.approx(0.012)
    assert (resin.loss.absorption_per_mm, resin.loss.wavelength_nm) == pytest.approx((0.0230259, 860.0), abs=1e-7)
    assert resin.cure is not None
    assert (resin.cure.Dp_um, resin.cure.covariance) == (181.0, ((9.0, 1.0), (1.0, 0.25)))
    assert resin.stiffness is not None
    assert resin.stiffness.modulus_MPa == 1.5
    assert [(part.component, part.wt_percent) for part in resin.formulation] == [
        ("RA-139", 75.0),
        ("lauryl acrylate", 25.0),
    ]
    assert [(item.of, item.file) for item in resin.sources] == [("index", "layer.csv"), ("loss", "guides.csv")]
    assert resin.sources[0].instrument == "Cary 5000"
    assert resin.warnings == ("loss: from simulated data, not measured",)
    text = Path("r.toml").read_text(encoding="utf-8")
    assert text.startswith("# Written by solen ")
    assert tomllib.loads(text)["schema"] == 1


def k_of(loss_dB_per_cm: float, nm: float) -> float:
    """Extinction coefficient for a loss: the absorption is 4πk/λ, and the loss is 10 lg e times the absorption."""
    return loss_dB_per_cm * math.log(10.0) / 10.0 / 1e7 * nm / (4.0 * math.pi)


@pytest.mark.parametrize(("layer", "guide", "differ"), [(12.7, 1.8, True), (1.9, 1.8, False), (None, 1.8, False)])
def test_compares_k_of_layer_with_cutback(layer: float | None, guide: float, differ: bool, shell: Shell) -> None:
    nm = [850.0, 860.0, 870.0]
    k = [None if layer is None else k_of(layer, item) for item in nm]
    index = INDEX | {"wavelength_nm": nm, "k": k, "u_k": [k_of(1.0, item) for item in nm]}
    index["interval95_k"] = [[0.0, k_of(20.0, item)] for item in nm]
    per_mm = guide * math.log(10.0) / 100.0
    cutback = CUTBACK | {"loss_dB_per_cm": guide, "absorption_per_mm": per_mm, "u_absorption_per_mm": 0.1 * per_mm}
    for name, data in (("index", index), ("cutback", cutback)):
        Path(f"{name}.json").write_text(json.dumps(data), encoding="utf-8")
    result = shell.json("resin", "build", "r.toml", *NAME, "--index", "index.json", "--cutback", "cutback.json")
    messages = [text for text in result["warnings"] if "cut-back gives 1.8 ± 0.2 dB/cm" in text]
    assert bool(messages) is differ
    assert all("13 ± 1" in text for text in messages)
    assert load_resin("r.toml").loss.absorption_per_mm == pytest.approx(per_mm)


def test_reports_guide_loss_above_bound_from_layer(shell: Shell) -> None:
    index = INDEX | {"wavelength_nm": [860.0], "n": [1.49], "u_n": [0.01], "k": [None], "u_k": [k_of(0.1, 860.0)]}
    index |= {"interval95_k": [[0.0, k_of(0.2, 860.0)]], "fit": FORMULA}
    Path("index.json").write_text(json.dumps(index), encoding="utf-8")
    cutback = CUTBACK | {"u_absorption_per_mm": 0.001}
    Path("cutback.json").write_text(json.dumps(cutback), encoding="utf-8")
    result = shell.json("resin", "build", "r.toml", *NAME, "--index", "index.json", "--cutback", "cutback.json")
    assert any("above the upper bound from the layer's spectra, 0.2 dB/cm" in text for text in result["warnings"])


FORMULA = {"kind": "cauchy", "A": 1.48, "B_um2": 0.005, "C_um4": 0.0, "covariance": [[1e-6, 0, 0], [0] * 3, [0] * 3]}


@pytest.mark.parametrize(("n", "differ"), [(1.4945, False), (1.52, True)])
def test_compares_index_from_spectra_with_refractometer(n: float, differ: bool, shell: Shell) -> None:
    Path("index.json").write_text(json.dumps(INDEX | {"fit": FORMULA}), encoding="utf-8")
    shell.lines("resin", "refractometer", str(n), "--u", "0.0002", "--out", "refractometer.json")
    options = ("--index", "index.json", "--refractometer", "refractometer.json")
    result = shell.json("resin", "build", "r.toml", *NAME, *options)
    assert any("from the refractometer" in text for text in result["warnings"]) is differ
    assert load_resin("r.toml").index.mode == "measured"
    shell.lines("resin", "build", "s.toml", *NAME, *options[2:])
    assert load_resin("s.toml").index.mode == "refractometer"


@pytest.mark.parametrize(("absorbance", "differ"), [(0.223, False), (0.35, True)])
def test_compares_working_curve_with_absorbance(absorbance: float, differ: bool, shell: Shell) -> None:
    rows = "".join(f"{nm},{absorbance}\n" for nm in range(380, 431, 5))
    Path("liquid.csv").write_text(f"wavelength_nm,absorbance\n{rows}", encoding="utf-8")
    shell.lines("resin", "penetration", "liquid.csv", "--path-um", "93", "--led-nm", "405", "--out", "liquid.json")
    line = shell.refused("resin", "build", "r.toml", *NAME, "--penetration", "liquid.json")
    assert "--cure" in line
    result = shell.json("resin", "build", "r.toml", *NAME, "--cure", "cure.json", "--penetration", "liquid.json")
    assert any("Dp is 181 µm" in text for text in result["warnings"]) is differ


def test_existing_file_is_replaced_only_with_force(shell: Shell) -> None:
    shell.lines("resin", "build", "r.toml", *NAME, "--index", "index.json")
    line = shell.refused("resin", "build", "r.toml", *NAME, "--cure", "cure.json")
    assert line == "r.toml; already exists; specify another file, or add --force"
    shell.lines("resin", "build", "r.toml", *NAME, "--cure", "cure.json", "--force")
    assert load_resin("r.toml").cure is not None


def test_reports_use_of_resin_without_index(shell: Shell) -> None:
    shell.lines("resin", "build", "r.toml", "--name", "dose only", "--cure", "cure.json")
    assert shell.json("resin", "show", "./r.toml")["at"][0]["n"] is None
    Path("sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    line = shell.refused("check", "sensor.toml", "--set", "material.resin=r.toml")
    assert line.startswith("resin dose only: index at 860 nm; is unknown: the resin has no index; add [index]")
    assert "no index to draw" in shell.refused("resin", "show", "./r.toml", "--figure", "r.png")


def damaged(name: str, **changes: Any) -> Callable[[], list[str]]:
    def write() -> list[str]:
        Path("bad.json").write_text(json.dumps(RESULTS[name] | changes), encoding="utf-8")
        return [f"--{name}", "bad.json"]

    return write


def file_with(text: bytes, option: str = "index") -> Callable[[], list[str]]:
    def write() -> list[str]:
        Path("bad.json").write_bytes(text)
        return [f"--{option}", "bad.json"]

    return write


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            list,
            "solen resin build; ... --index, --cutback, --cure, --stiffness, --refractometer or --formulation",
        ),
        (
            lambda: ["--index", "cure.json"],
            "cure.json: kind = 'cure'; must be index or refractometer for --index; use the file with",
        ),
        (lambda: ["--cure", "index.json"], "index.json: kind = 'index'; must be cure for --cure; use the file with"),
        (lambda: ["--cure", "none.json"], "none.json; no such file"),
        (damaged("cure", kind="spectra"), "bad.json: kind = 'spectra'; must be cure for --cure"),
        (file_with(b"{}"), "bad.json: kind; ... solen resin index --out"),
        (file_with(b"[1, 2]", "cure"), "bad.json: kind; ... solen resin cure --out"),
        (file_with(b'{"kind": "index", '), "bad.json: JSON; is not valid JSON: Expecting property name"),
        (
            file_with(b'{"kind": "index", "n": [NaN]}'),
            "bad.json: JSON; is not valid JSON: NaN is not a valid JSON number",
        ),
        (file_with(b"[" * 100_000), "bad.json: JSON; is not valid JSON: "),
        (file_with(b"\xff\xfe{}"), "bad.json; is not UTF-8 text"),
        (
            file_with(b'{"kind": "cure"}', "cure"),
            "bad.json: cure.Dp_um; is missing; add it: penetration depth in µm.; and 1 more",
        ),
        (damaged("index", mode="guess"), "bad.json: index.mode = 'guess'; must be one of measured"),
        (damaged("index", n=[1.5]), "bad.json: n = 1; must have 3 entries, one per wavelength"),
        (damaged("index", sources="layer.csv"), "bad.json: sources = 'layer.csv'; must be a list"),
        (damaged("index", warnings=[3]), "bad.json: warnings[0] = 3; must be a string"),
        (
            damaged("cutback", loss_dB_per_cm=-43.0, absorption_per_mm=None, interval95_loss_dB_per_cm=[-50, -40]),
            "bad.json: loss_dB_per_cm = -43.0; must be at least 0 within its uncertainty",
        ),
        (damaged("cutback", absorption_per_mm=0.03), "bad.json: absorption_per_mm = 0.03; must be 0.0230259 per mm"),
        (damaged("cutback", interval95_loss_dB_per_cm=[1.0]), "bad.json: interval95_loss"),
        (damaged("cure", Dp_um=-181.0), "bad.json: cure.Dp_um = -181.0; must be greater than 0"),
        (damaged("cure", covariance=[[1, 2], [2, 1]]), "bad.json: cure.covariance = -1.0; must not have negative"),
        (damaged("stiffness", modulus_MPa=0.0), "bad.json: modulus_MPa = 0.0; must be greater than 0"),
        (damaged("stiffness", modulus_MPa="1.5"), "bad.json: modulus_MPa = '1.5'; must be a number"),
        (lambda: ["--formulation", "a:75,b:20"], "formulation = '95 %'; must add up to 100 % by weight, to within 0.1"),
        (lambda: ["--formulation", "a:75,b"], "--formulation = 'b'; is not of the form name:number"),
        (
            lambda: ["--formulation", "a:50,a:50"],
            "formulation = 'a'; each component may occur once; add up its fractions",
        ),
        (lambda: ["--formulation", "a:120,b:-20"], "--formulation: wt_percent = -20.0; must be greater than 0"),
        (lambda: ["--cure", "cure.json", "--orientation", "flat"], "--orientation = 'flat'; requires --cutback"),
        (lambda: ["--cure", "cure.json", "--label", "PU"], "--label = 'PU'; requires --stiffness"),
        (
            lambda: ["--cutback", "cutback.json", "--orientation", "flat"],
            "cutback.json: --orientation = 'flat'; is not in the result",
        ),
        (
            lambda: ["--stiffness", "stiffness.json", "--label", "PU"],
            "stiffness.json: --label = 'PU'; is not in the result",
        ),
    ],
)
def test_refuses_invalid_results_in_one_line(shell: Shell, arguments: Callable[[], list[str]], line: str) -> None:
    first, *others = line.split(" ... ")
    line_printed = shell.refused("resin", "build", "r.toml", *NAME, *arguments())
    assert line_printed.startswith(first)
    assert all(other in line_printed for other in others)


def test_refuses_invalid_names(shell: Shell) -> None:
    assert "end in .toml" in shell.refused("resin", "build", "r.json", *NAME, *ALL_RESULTS)
    assert shell.refused("resin", "build", "r.toml", "--name", " ", *ALL_RESULTS).startswith(
        "name = ' '; must be one line"
    )
    assert "--name" in shell.refused("resin", "build", "r.toml", *ALL_RESULTS)
    assert "no/r.toml; cannot be written" in shell.refused("resin", "build", "no/r.toml", *NAME, *ALL_RESULTS).replace(
        "\\", "/"
    )


def test_lists_library_with_index_and_warnings(shell: Shell) -> None:
    result = {item["resin"]: item for item in shell.json("resin", "list")["resins"]}
    paper, pmma = result["ma-pu-as-published"], result["pmma"]
    assert [at["wavelength_nm"] for at in paper["at"]] == [589.3, 860.0]
    assert paper["at"][1]["n"] == 1.44
    assert paper["index"]["mode"] == "as-published"
    assert "perhaps not measured" in paper["warnings"][0]
    assert pmma["warnings"] == []
    assert pmma["at"][0]["n"] == pytest.approx(1.4906, abs=2e-4)
    lines = {line.split()[0]: line for line in shell.lines("resin", "list")[1:]}
    assert "1.4400" in lines["ma-pu-as-published"]
    assert "see its warning" in lines["ma-pu-as-published"]
    assert "see its warning" not in lines["pmma"]


@pytest.mark.parametrize("suffix", ["svg", "png", "pdf"])
def test_shows_and_draws_resin(shell: Shell, suffix: str) -> None:
    shell.lines("resin", "build", "r.toml", *NAME, *ALL_RESULTS)
    result = shell.json("resin", "show", "./r.toml", "--at-nm", "500", "--at-nm", "860", "--figure", f"r.{suffix}")
    assert [(at["wavelength_nm"], at["u_n"]) for at in result["at"]] == [(500.0, 0.012), (860.0, 0.012)]
    assert Path(f"r.{suffix}").stat().st_size > 2000
    lines = shell.lines("resin", "show", "./r.toml")
    assert "  n at 860 nm: 1.4916 ± 1.2e-02" in lines
    assert "  source of loss: guides.csv, sha256 343434343434…, simulated" in lines
    assert "warning: loss: from simulated data, not measured" in lines
    assert any(line.split() == ["Dp_um", "181"] for line in lines)


def test_figure_marks_published_and_simulated_index(shell: Shell) -> None:
    shell.lines("resin", "show", "ma-pu-as-published", "--figure", "paper.svg")
    assert "as published" in Path("paper.svg").read_text(encoding="utf-8")
    Path("index.json").write_text(json.dumps(INDEX | {"sources": [{"simulated": True}]}), encoding="utf-8")
    shell.lines("resin", "build", "r.toml", *NAME, "--index", "index.json")
    shell.lines("resin", "show", "./r.toml", "--figure", "r.svg")
    drawn = Path("r.svg").read_text(encoding="utf-8")
    assert "(simulated data)" in drawn
    assert "± standard uncertainty" in drawn


def test_show_reports_bad_input(shell: Shell) -> None:
    assert "did you mean pmma?" in shell.refused("resin", "show", "PMA")
    assert "known only from 436.8 to 1052 nm" in shell.refused("resin", "show", "pmma", "--at-nm", "1200")
    assert "--at-nm = nan" in shell.refused("resin", "show", "pmma", "--at-nm", "nan")
    assert "a figure must end in" in shell.refused("resin", "show", "pmma", "--figure", "r.jpg")
    assert "no such file" in shell.refused("resin", "show", "./none.toml")


def test_mixes_by_total_and_by_base(shell: Shell) -> None:
    arguments = ("resin", "mix", "RA-139:75", "lauryl acrylate:25", "--total-g", "50")
    result = shell.json(*arguments)
    assert [item["weighed_g"] for item in result["of_whole"]["components"]] == [37.5, 12.5]
    assert [item["weighed_g"] for item in result["on_base"]["components"]] == [40.0, 10.0]
    assert (result["base"], result["of_whole"]["index_estimate"]) == ("RA-139", None)
    lines = shell.lines(*arguments)
    assert lines[0] == "percentages of the whole mixture: 50 g in total"
    assert lines[3] == "grams per 100 g of the base: 50 g in total"
    known = [*("--density", "RA-139:1.1", "--density", "lauryl acrylate:0.88")]
    known += [*("--index", "RA-139:1.48", "--index", "lauryl acrylate:1.44")]
    lines = shell.lines(*arguments, *known)
    assert len([line for line in lines if "Lorentz-Lorenz" in line]) == 2
    assert shell.json("resin", "mix", "a:50%", "b:50")["of_whole"]["total_g"] == 100.0


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ((), "mixture = 0; requires at least 2 components"),
        (("a:50", "b"), "component = 'b'; is not of the form name:number"),
        (("a:50", "b:nan"), "component = 'b:nan'; is not of the form"),
        (("a:50", "b:40"), "mixture = '90 %'; the fractions must add up to 100 %"),
        (
            ("a:50", "b:50", "--total-g", "1", "--base-g", "1"),
            "--base-g; cannot be combined with --total-g",
        ),
        (("a:50", "b:50", "--total-g", "0"), "--total-g = '0'; must be greater than 0"),
        (("a:50", "b:50", "--resolution-g", "-1"), "--resolution-g = '-1'; must be at least"),
        (("a:50", "b:50", "--density", "c:1"), "--density = 'c'; is not a component"),
        (("a:50", "b:50", "--index", "a:0"), "index of a = 0.0; must be at least 1"),
    ],
)
def test_refuses_invalid_mixture_in_one_line(shell: Shell, arguments: tuple[str, ...], line: str) -> None:
    assert shell.refused("resin", "mix", *arguments).startswith(line)


def test_uncertainty_propagates_from_spectra_to_design(shell: Shell) -> None:
    """The design has the index of a simulated layer with 0.1 % noise, to within its uncertainty."""
    wavelengths = np.arange(430.0, 901.0, 2.0)
    true_index = 1.48 + 0.005 / (1e-3 * wavelengths) ** 2
    rng = np.random.default_rng(7)
    r, t = (item + rng.normal(0.0, 1e-3, item.size) for item in forward(true_index, 1e-6, 50.0, wavelengths))
    rows = [f"{nm:g},{a:.6f},{b:.6f}" for nm, a, b in zip(wavelengths, t, r, strict=True)]
    Path("layer.csv").write_text("\n".join(["wavelength_nm,T,R", *rows]), encoding="utf-8")
    options = ("--u-T", "0.001", "--u-R", "0.001", "--baseline", "air", "--thickness-um", "50")
    shell.lines("resin", "index", "layer.csv", *options, "--out", "layer.json")
    shell.lines("resin", "build", "r.toml", *NAME, "--index", "layer.json")
    resin = load_resin("r.toml")
    checksum = hashlib.sha256(Path("layer.csv").read_bytes()).hexdigest()
    assert [(item.of, item.file, item.sha256) for item in resin.sources] == [("index", "layer.csv", checksum)]
    assert any(text.startswith("k is masked") for text in json.loads(Path("layer.json").read_bytes())["warnings"])
    assert not [text for text in resin.warnings if "k is masked" in text or "u_k" in text]  # a resin contains no k
    Path("sensor.toml").write_text(template("paper-860"), encoding="utf-8")
    result = shell.json("check", "sensor.toml", "--set", "material.resin=r.toml")
    material = result["material"]
    assert material["mode"] == "measured"
    assert 0.002 < material["u_index"] < 0.01
    assert abs(material["index"] - (1.48 + 0.005 / 0.86**2)) < 2 * material["u_index"]
    low, middle, high = result["foci"]
    assert low["material_index"] == pytest.approx(material["index"] - material["u_index"])
    assert low["best_focus_mm"] > middle["best_focus_mm"] > high["best_focus_mm"]


def test_builds_resin_from_files_of_other_commands(shell: Shell) -> None:
    """Simulated guides in two orientations and cubes of two materials, with very little noise."""
    noise = np.random.default_rng(2).normal
    guides = ["guide,orientation,length_mm,power_mW"]
    for orientation, per_mm in (("flat", 0.01), ("upright", 0.04)):
        for mm in (10, 20, 30, 40) * 3:
            guides.append(f"{len(guides)},{orientation},{mm},{math.exp(-per_mm * mm + noise(0, 0.01)):.6f}")
    discs = ["dose_mJ_per_cm2,depth_um"]
    discs += [f"{dose},{150.0 * math.log(dose / 12.0) + noise(0, 2.0):.3f}" for dose in (16, 25, 39, 60) * 4]
    Path("guides.csv").write_text("\n".join(guides), encoding="utf-8")
    Path("discs.csv").write_text("\n".join(discs), encoding="utf-8")
    for name, shear in (("stiff", 0.9), ("soft", 0.3)):
        strain = np.linspace(0.0, 0.3, 61)
        rows = [f"{e:.4f},{shear * ((1 - e) ** -2 - 1 + e):.6f}" for e in strain]
        Path(f"{name}.csv").write_text("\n".join(["strain,stress_MPa", *rows]), encoding="utf-8")
    shell.lines("resin", "cutback", "guides.csv", "--out", "c.json")
    shell.lines("resin", "cure", "discs.csv", "--irradiance-mW-per-cm2", "13", "--out", "k.json")
    labels = ("--label", "base", "mix")
    shell.lines("resin", "stiffness", "stiff.csv", "soft.csv", "--mode", "compression", *labels, "--out", "s.json")
    options = ("--cutback", "c.json", "--cure", "k.json", "--stiffness", "s.json")
    assert "--label; is required: the materials of the result are base, mix" in shell.refused(
        "resin", "build", "r.toml", *NAME, *options
    )
    selection = ("--orientation", "upright", "--label", "mix")
    wavelengths = ("--loss-wavelength-nm", "860", "--cure-wavelength-nm", "385")
    shell.lines("resin", "build", "r.toml", *NAME, *options, *selection, *wavelengths)
    resin = load_resin("r.toml")
    assert resin.loss.absorption_per_mm == pytest.approx(0.04, abs=5e-4)
    assert resin.loss.interval95_per_mm is not None
    assert resin.loss.interval95_per_mm[0] < 0.04 < resin.loss.interval95_per_mm[1]
    assert (resin.loss.wavelength_nm, resin.loss.warnings) == (860.0, ())
    assert resin.cure is not None
    assert resin.cure.covariance is not None
    assert abs(resin.cure.Dp_um - 150.0) < 3 * math.sqrt(resin.cure.covariance[0][0])
    assert (resin.cure.irradiance_mW_per_cm2, resin.cure.wavelength_nm) == (13.0, 385.0)
    assert resin.stiffness is not None
    assert resin.stiffness.parameters["C10_MPa"] == pytest.approx(0.15, rel=1e-3)
    assert [item.file for item in resin.sources] == ["guides.csv", "discs.csv", "soft.csv"]
