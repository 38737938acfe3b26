"""`solen resin stiffness` from files to results: groups, modes, simultaneous fits, tables and refusals."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.cli import run_command
from solen.material.stiffness import (
    EQUIBIAXIAL,
    KINDS,
    PLANAR,
    UNIAXIAL,
    Dimensions,
    MeasuredStiffness,
    MechanicalTest,
    StableRange,
    StiffnessOptions,
    model,
    stiffness_of,
)
from solen.pipeline.resin.stiffness import stiffness
from solen.recording import read
from solen.report.options import FigureOptions
from solen.samples import sample_files

CUBE = Dimensions(cube_mm=10)


def evaluated(path: Path, dimensions: Dimensions = Dimensions(), **values: Any) -> MeasuredStiffness:
    """Return the stiffness of one file."""
    options = StiffnessOptions(**values)
    return stiffness_of([MechanicalTest(read(path), options.mode, dimensions=dimensions)], options)


def compression_file(path: Path, modulus: float, *, seed: int = 0, cycles: int = 2) -> Path:
    """Write a simulated test of a cube of 10 mm with a gap of 0.2 mm; the second cycle is 10 % softer."""
    displacement = np.concatenate([np.linspace(0, 4, 400), np.linspace(4, 0, 400)[1:]] * cycles)
    compression = np.maximum(displacement - 0.2, 0) / 10
    force = -100 * model("neo-hookean").stress([modulus / 6], UNIAXIAL, 1 - compression)
    force[400:] *= 0.9
    force += 0.01 * np.random.default_rng(seed).standard_normal(len(force))
    rows = "\n".join(f"{d:.6g},{f:.6g}" for d, f in zip(displacement, force, strict=True))
    path.write_text(f"displacement (mm),force (N)\n{rows}\n", encoding="utf-8")
    return path


def tension_file(path: Path, name: str) -> Path:
    """Write columns of stress and stretch of a Yeoh solid, without a header."""
    mode = {"ut": UNIAXIAL, "ps": PLANAR, "et": EQUIBIAXIAL}[name]
    stretch = np.linspace(1, 3, 25)
    stress = model("yeoh").stress([0.18, -0.004, 0.002], mode, stretch)
    path.write_text("\n".join(f"{p:.8f} {s:.8f}" for p, s in zip(stress, stretch, strict=True)), encoding="utf-8")
    return path


def test_two_materials_of_two_cubes_each(tmp_path: Path) -> None:
    moduli = (1.9, 2.1, 0.7, 0.8)
    files = tuple(compression_file(tmp_path / f"cube{n}.csv", m, seed=n) for n, m in enumerate(moduli))
    figure, table, out = tmp_path / "f.svg", tmp_path / "t.csv", tmp_path / "r.json"
    labels, options = ("a-PU", "a-PU", "ma-PU", "ma-PU"), StiffnessOptions(fit=("neo-hookean",))
    outcome = stiffness(
        *files, options=options, dimensions=CUBE, label=labels, figure=FigureOptions(figure=figure), csv=table, out=out
    )
    assert dict(outcome.files) == {"figure": figure, "csv": table, "out": out}
    result = outcome.result
    stiff, soft = result.groups
    assert (stiff.label, soft.label) == ("a-PU", "ma-PU")
    assert stiff.mode == "compression"
    assert stiff.strain_range == (0.02, 0.1)
    # the slope of an ideal rubber over 2 to 10 % is 1.137 times its initial one; the toe is known to 0.1 % strain
    for group, expected in ((stiff, (1.9, 2.1)), (soft, (0.7, 0.8))):
        assert group.modulus_MPa == pytest.approx(1.137 * np.mean(expected), rel=0.01)
        assert group.sd_modulus_MPa == pytest.approx(1.137 * np.std(expected, ddof=1), rel=0.05)
        assert group.model is not None
        assert group.model.initial_modulus_MPa == pytest.approx(np.mean(expected), rel=0.01)
        assert group.model.stable["uniaxial"] == StableRange(None, None)
        softening = [specimen.softening.peak_stress for specimen in group.specimens if specimen.softening is not None]
        assert softening == pytest.approx([0.1, 0.1], abs=0.003)
    assert result.modulus_MPa == stiff.modulus_MPa
    assert any("only to a-PU" in line for line in result.warnings)
    assert any(line.startswith("ma-PU: ") and "shape factor 0.25" in line for line in result.warnings)
    assert any("76 %" in line for line in result.warnings)
    assert len(result.sources) == 4
    written = json.loads(out.read_text(encoding="utf-8"))
    assert written["kind"] == "stiffness"
    assert written["modulus_MPa"] == result.modulus_MPa
    text = figure.read_text(encoding="utf-8")
    assert "ma-PU: E = " in text
    assert "compressive engineering strain" in text
    rows = table.read_text(encoding="utf-8").splitlines()
    assert rows[0] == "specimen,material,strain,stress_MPa,true_strain,true_stress_MPa"
    assert len(rows) == 1 + 4 * (2 * 799)


def test_a_table_of_simulated_specimens_is_marked(tmp_path: Path) -> None:
    cube, table = tmp_path / "cube.csv", tmp_path / "curves.csv"
    cube.write_bytes(sample_files()["cube-simulated.csv"])
    stiffness(cube, dimensions=CUBE, csv=table)
    first, names, *_ = table.read_text(encoding="utf-8").splitlines()
    assert (first, names.split(",")[0]) == ("# simulated: yes", "specimen")
    assert read(table).provenance.simulated


def test_three_modes_in_one_fit(tmp_path: Path) -> None:
    uniaxial, planar, biaxial = (tension_file(tmp_path / f"{name}.txt", name) for name in ("ut", "ps", "et"))
    options = StiffnessOptions(mode="tension")
    columns = ("stress_MPa", "stretch")
    result = stiffness(uniaxial, options=options, planar=(planar,), biaxial=(biaxial,), columns=columns).result
    best = result.model
    assert result.groups == ()
    assert best is not None
    assert best.kind == "yeoh"
    np.testing.assert_allclose(best.values, [0.18, -0.004, 0.002], rtol=1e-4)
    assert [quality.mode for quality in best.quality] == ["uniaxial", "planar", "equibiaxial"]
    assert [specimen.mode for specimen in result.specimens] == ["uniaxial", "planar", "equibiaxial"]
    assert [fit.kind for fit in result.fits] == list(KINDS)
    aicc = np.array([fit.aicc for fit in result.fits], float)
    differences = np.array([fit.delta_aicc for fit in result.fits], float)
    np.testing.assert_allclose(differences, aicc - np.nanmin(aicc))
    assert best.u_parameters is not None
    assert len(best.u_parameters) == 3


def test_specimens_named_by_a_column(tmp_path: Path) -> None:
    strain = np.linspace(0, 0.5, 40)
    lines = ["material,specimen,strain,stress_MPa"]
    for material, modulus in (("soft", 1.0), ("hard", 2.0)):
        for specimen, factor in (("A", 0.95), ("B", 1.05)):
            lines += [f"{material},{specimen},{e:.5f},{modulus * factor * e:.6f}" for e in strain]
    path = tmp_path / "long.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    result = evaluated(path, mode="tension", fit=("none",), strain_range_percent=(0, 50))
    assert [group.label for group in result.groups] == ["soft", "hard"]
    assert [group.modulus_MPa for group in result.groups] == pytest.approx([1, 2], rel=1e-4)
    assert [specimen.name for specimen in result.groups[0].specimens] == ["long.csv: soft A", "long.csv: soft B"]
    assert result.model is None
    assert result.fits == ()
    assert len(result.sources) == 1


def test_the_modulus_is_compared_with_that_of_the_testing_machine(tmp_path: Path) -> None:
    path = tmp_path / "zugversuch.TRA"
    strain = np.linspace(0, 1, 201)
    rows = "\n".join(f"{t:.2f}\t{20 * e:.6g}\t{e:.6g}" for t, e in enumerate(strain))
    head = '"Probenbreite b0"\t10\t"mm"\n"Probendicke a0"\t2\t"mm"\n"Vorkraft"\t0.1\t"N"\n"E-Modul"\t120\t"N/mm²"\n'
    names = '"Prüfzeit"\t"Standardkraft"\t"Dehnung"\n"s"\t"N"\t"%"\n'
    path.write_text(head + names + rows + "\n", encoding="cp1252")
    result = evaluated(path, fit=("none",))
    assert result.modulus_MPa == pytest.approx(100)
    assert any("120 MPa" in line and "+20.0 %" in line for line in result.warnings)
    assert "Vorkraft 0.1 N" in result.specimens[0].toe.note


def test_a_workbook_with_binary_fractions(tmp_path: Path) -> None:
    """Excel stores values with all their binary digits, for example 0.0133779264214047."""
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    assert sheet is not None
    sheet.append(["Standardweg", "Standardkraft"])
    sheet.append(["mm", "N"])
    for displacement in np.linspace(0, 4, 300):
        stretch = 1 - displacement / 10
        sheet.append([float(displacement), float(40 * (stretch**-2 - stretch))])
    book.save(tmp_path / "cube.xlsx")
    result = evaluated(tmp_path / "cube.xlsx", CUBE, fit=("neo-hookean",))
    # means over the fifty intervals of a curve deviate from it due to its curvature, here by 3 Pa
    assert result.model is not None
    assert result.model.initial_modulus_MPa == pytest.approx(1.2, rel=1e-4)
    assert result.mode == "compression"


def test_no_rubber_model_is_fitted_to_a_rigid_plastic(tmp_path: Path) -> None:
    path = tmp_path / "plastic.csv"
    path.write_text(
        "strain,stress_MPa\n" + "\n".join(f"{e:.6f},{2000 * e:.6f}" for e in np.linspace(0, 0.01, 60)) + "\n"
    )
    result = evaluated(path, mode="tension")
    assert result.model is None
    assert "2000 MPa" in " ".join(result.warnings)
    requested = evaluated(path, mode="tension", fit=("neo-hookean",)).model
    assert requested is not None
    assert requested.kind == "neo-hookean"


def test_printed_lines_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(compression_file(tmp_path / "cube.csv", 1.0))
    assert run_command(["resin", "stiffness", file, "--cube-mm", "10", "--fit", "neo-hookean", "yeoh"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("modulus 1.1")
    assert "MPa (compression, 2 to 10 % strain)" in printed
    assert "energy" in printed
    assert "  * " in printed
    ranges = ["--strain-range-percent", "5", "15", "--secant-percent", "10", "30"]
    arguments = ["--cube-mm", "10", *ranges, "--fit", "none"]
    assert run_command(["resin", "stiffness", file, *arguments, "--u-geometry-mm", "0.05", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["specimens"][0]["cycles"][0]["loss_fraction"] == pytest.approx(0.1, abs=0.002)
    assert result["strain_range"] == pytest.approx([0.05, 0.15])
    assert [secant["strain"] for secant in result["specimens"][0]["secants"]] == pytest.approx([0.1, 0.3])
    u_dimensions = result["modulus_MPa"] * 0.005 * np.sqrt(3)
    assert result["specimens"][0]["young"]["u_dimensions_MPa"] == pytest.approx(u_dimensions)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ([], "area of the specimen; is not specified; add --strip-width-mm"),
        (["--area-mm2", "100"], "length of the specimen; is not specified; add --length-mm"),
        (["--cube-mm", "0"], "--cube-mm = '0'; must be greater than 0"),
        (["--cube-mm", "10", "--length-mm", "10"], "--length-mm; cannot be combined with --cube-mm"),
        (["--cube-mm", "10", "--mode", "torsion"], "--mode"),
        (["--cube-mm", "10", "--toe", "off"], "--toe"),
        (["--cube-mm", "10", "--fit", "gent"], "gent"),
        (["--cube-mm", "10", "--weighting", "log"], "--weighting"),
        (["--cube-mm", "10", "--cycle", "third"], "--cycle"),
        (["--cube-mm", "10", "--strain-range-percent", "60", "70"], "contains 0 points of the loading"),
        (["--cube-mm", "10", "--strain-range-percent", "7", "6"], "--strain-range-percent = '7 6'"),
        (["--cube-mm", "10", "--secant-percent", "-1"], "--secant-percent"),
        (["--cube-mm", "10", "--label", "a", "b"], "--label; must occur once"),
        (["--cube-mm", "10", "--compliance-mm-per-N", "-1"], "must be at least 0"),
        (["--cube-mm", "10", "--csv", "t.txt"], "a table must end in .csv"),
        (["--cube-mm", "10", "--figure", "f.gif"], "a figure must end in"),
        (["--cube-mm", "10", "--out", "r.toml"], "a result must end in .json"),
        (["--cube-mm", "10", "--planar", "nowhere.csv"], "no such file"),
    ],
)
def test_refuses_invalid_input_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], line: str
) -> None:
    file = str(compression_file(tmp_path / "cube.csv", 1.0))
    assert run_command(["resin", "stiffness", file, *arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("solen: ")
    assert len(printed.err.splitlines()) == 1
    assert line in printed.err
    assert list(tmp_path.iterdir()) == [Path(file)]


def test_refuses_a_command_without_files(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["resin", "stiffness"]) == 2
    assert "requires a file" in capsys.readouterr().err
