"""Resin files, the library, and the optical properties of a design's material."""

import re
from pathlib import Path

import pytest

from solen.errors import DataError, SolenError
from solen.material import Cauchy, Constant, Optical, Sellmeier, Tabulated, library, library_resin, load_resin, optical
from solen.mechanics.design import stiffness_cautions
from solen.spec import Design, Material, load, template

HEAD = 'schema = 1\nname = "mine"\nsource = "measured"\n'
N = '[index]\nkind = "number"\nn = 1.5\n'


def resin_file(folder: Path, text: str) -> Path:
    file = folder / "mine.toml"
    file.write_text(text, encoding="utf-8")
    return file


def error_line(folder: Path, text: str) -> str:
    file = resin_file(folder, text)
    with pytest.raises(DataError) as error:
        load_resin(file)
    line = str(error.value)
    assert len(line.splitlines()) == 1
    assert line.startswith(str(file))
    return line.removeprefix(str(file)).removeprefix(": ")


@pytest.mark.parametrize(
    ("index", "kind", "at_500_nm"),
    [
        ('kind = "number"\nn = 1.5\nu_n = 0.001', Constant, 1.5),
        ('kind = "table"\nwavelength_nm = [400, 600]\nn = [1.52, 1.50]', Tabulated, 1.51),
        ('kind = "cauchy"\nA = 1.49\nB_um2 = 0.005\nvalid_nm = [400, 900]', Cauchy, 1.51),
        ('kind = "sellmeier"\nB = [1.25]\nC_um2 = [0.0]', Sellmeier, 1.5),
    ],
)
def test_a_file_contains_an_index_of_each_kind(index: str, kind: type, at_500_nm: float, tmp_path: Path) -> None:
    resin = load_resin(resin_file(tmp_path, f"{HEAD}[index]\n{index}\n[loss]\nabsorption_per_mm = 0.01\n"))
    assert isinstance(resin.index, kind)
    assert resin.index.index(500) == pytest.approx(at_500_nm, abs=1e-12)
    assert (resin.name, resin.source, resin.loss.absorption_per_mm) == ("mine", "measured", 0.01)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (f"{HEAD}[index]\nn = 1.5", "index.kind; is required and must be one of number, table, cauchy, sellmeier; add"),
        (
            f'{HEAD}[index]\nkind = "cauchi"',
            "index.kind = 'cauchi'; must be one of number, table, cauchy, sellmeier; did",
        ),
        (f"{HEAD}[index]\nkind = 3", "index.kind = 3; must be one of number"),
        (f"{HEAD}[index]\nkind = ['cauchy']", "index.kind = ['cauchy']; must be one of number"),
        (f'{HEAD}[index]\nkind = "cauchy"\nA = 1.5\nB_um = 0', "index.B_um; unknown key; did you mean index.B_um2?"),
        (f'{HEAD}[index]\nkind = "number"\nn = 0.5', "index.n = 0.5; must be at least 1"),
        (f"{HEAD}index = 1.5", "index = 1.5; must be a table; write [index]"),
        (f"{HEAD}", "; must have at least one of index, loss, cure, stiffness, formulation; add"),
        (f'{HEAD}sources = "x"\n{N}', "sources = 'x'; must be a list of tables; write [[sources]]"),
        (f'{HEAD}sourec = "x"\n{N}', "sourec; unknown key; did you mean source?"),
        (f'{HEAD}{N}mode = "as_published"', "index.mode = 'as_published'; must be one of measured, absorptance,"),
        (
            f'{HEAD}{N}mode = "as-published"',
            'index.warnings; is missing: mode = "as-published" requires at least one warning; add, for example,',
        ),
        (f"{HEAD}{N}[cure]\nDp_um = -80", "cure.Dp_um = -80; must be greater than 0; and 1 more problem"),
        (f"{HEAD}{N}[cure]\nDp_um = 80\nEc_mJ_per_cm2 = 0", "cure.Ec_mJ_per_cm2 = 0; must be greater than 0"),
        (
            f"{HEAD}{N}[cure]\nDp_um = 80\nEc_mJ_per_cm2 = 8\ncovariance = [[1, 2], [2, 1]]",
            "cure.covariance = -1.0; must not have negative eigenvalues",
        ),
        (f"{HEAD}{N}[cure]\nqqq = 1", "cure.qqq; unknown key; the keys of this table are Dp_um, Ec_mJ_per_cm2"),
        (f"{HEAD}{N}[stiffness]\nmodulus = 1", "stiffness.modulus; unknown key; did you mean stiffness.modulus_MPa?"),
        (f"{HEAD}{N}[loss]\nmodulus_MPa = 1", "loss.modulus_MPa; unknown key; did you mean stiffness.modulus_MPa?"),
        (f"{HEAD}{N}[stiffness]\nmodulus_MPa = true", "stiffness.modulus_MPa = True; must be a number"),
        (
            f"{HEAD}{N}[stiffness]\nmodulus_MPa = 1\nprony = [[0.1, 2.0]]",
            "stiffness.prony; relaxation of the modulus is not modelled",
        ),
        (
            f'{HEAD}{N}[stiffness]\nmodulus_MPa = 1\n[stiffness.parameters]\nmu = "1"',
            "stiffness.parameters.mu = '1'; mu",
        ),
        (f'{HEAD}{N}[[formulation]]\ncomponent = "a"\nwt_percent = 99', "formulation = '99 %'; must add up to 100 %"),
        (
            HEAD + N + '[[formulation]]\ncomponent = "a"\nwt_percent = 50\n' * 2,
            "formulation = 'a'; each component may occur once",
        ),
        (
            f'{HEAD}{N}[[loss.by_orientation]]\norientation = "flat"\nabsorption_per_m = 1',
            "loss.by_orientation[0].absorption_per_m; unknown key; did you mean",
        ),
        (f'{HEAD}[index]\nkind = "number"\nn = 1.5\n[los]', "los; unknown key; did you mean loss?"),
        (
            f'{HEAD}[index]\nkind = "number"\nn = 1.5\n[loss]\nabsorption = 1',
            "loss.absorption; unknown key; did you mean loss.absorption_per_mm?",
        ),
        (
            f'{HEAD}[index]\nkind = "number"\nn = 1.5\n[loss]\nabsorption_per_mm = -1',
            "loss.absorption_per_mm = -1; must be at least 0",
        ),
        ('name = "x"', "; schema is missing; add the line schema = 1"),
        ("schema = 2", "schema = 2; was written by a newer solen; this version reads schema 1"),
        ("schema = ", "; is not valid TOML: Invalid value (at line 1, column 10)"),
    ],
)
def test_refuses_an_invalid_file_in_one_line(text: str, line: str, tmp_path: Path) -> None:
    assert error_line(tmp_path, text).startswith(line)


def test_refuses_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        load_resin(tmp_path / "mine.toml")


def test_pmma_has_the_index_of_the_literature() -> None:
    pmma = library_resin("pmma").index
    assert pmma.index(589.3) == pytest.approx(1.4906, abs=2e-4)
    assert pmma.index(589.3) == pytest.approx((1 + 1.1819 * 0.5893**2 / (0.5893**2 - 0.011313)) ** 0.5, abs=1e-12)
    assert pmma.range_nm == (436.8, 1052.0)


def test_every_resin_of_the_library_loads_and_names_its_source() -> None:
    assert "pmma" in library()
    for name in library():
        resin = library_resin(name)
        assert resin.source
        assert resin.index.index(sum(resin.index.range_nm) / 2) > 1


def test_an_unknown_resin_is_refused_with_the_closest_name() -> None:
    names = re.escape(", ".join(library()))
    with pytest.raises(DataError, match=rf"^resin = 'PMAA'; is not in the library \({names}\); did you mean pmma\?$"):
        library_resin("PMAA")
    with pytest.raises(DataError, match=rf"^resin = 'glass'; is not in the library \({names}\); .*\.toml"):
        library_resin("glass")


def test_a_design_with_an_index_uses_it() -> None:
    design = Design(name="x", material=Material(index=1.44, absorption_per_mm=0.02))
    assert optical(design) == Optical(1.44, None, 0.02, "the design's material.index")


def test_a_library_resin_is_evaluated_at_the_emitters_wavelength() -> None:
    properties = optical(Design(name="x", material=Material(resin="pmma")))
    assert properties.index == pytest.approx(1.4833, abs=1e-4)
    assert (properties.u_index, properties.absorption_per_mm) == (None, 0.0)
    assert "116, 585 (2009)" in properties.source


def design_of(folder: Path, material: str, wavelength_nm: float = 500) -> Design:
    resin_file(
        folder,
        f'{HEAD}[index]\nkind = "number"\nn = 1.5\nu_n = 0.001\nvalid_nm = [400, 900]\n'
        "[loss]\nabsorption_per_mm = 0.03\n",
    )
    file = folder / "sensor.toml"
    file.write_text(
        f'schema = 1\nname = "x"\n[material]\n{material}\n[emitter]\nwavelength_nm = {wavelength_nm}\n',
        encoding="utf-8",
    )
    return load(file)


@pytest.mark.parametrize(("absorption", "expected"), [("", 0.03), ("absorption_per_mm = 0.0", 0.0)])
def test_a_resin_file_is_relative_to_its_design_and_a_specified_absorption_overrides_it(
    absorption: str, expected: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    properties = optical(design_of(tmp_path, f'resin = "mine.toml"\n{absorption}'))
    assert (properties.index, properties.u_index, properties.absorption_per_mm) == (1.5, 0.001, expected)
    assert properties.source == "mine: measured"
    assert any("mine, 0.03 per mm" in text for text in properties.warnings) is bool(absorption)


def test_every_table_warns_but_the_optical_properties_only_of_index_and_loss(tmp_path: Path) -> None:
    tables = {
        "index": 'kind = "number"\nn = 1.5\nmode = "lossless"',
        "loss": "absorption_per_mm = 0.03",
        "cure": "Dp_um = 80.0\nEc_mJ_per_cm2 = 4.0",
        "stiffness": "modulus_MPa = 1.2",
    }
    text = "".join(f'[{name}]\n{values}\nwarnings = ["doubt of {name}"]\n' for name, values in tables.items())
    text += "".join(f'[[sources]]\nof = "{name}"\nsimulated = true\n' for name in ("cure", "stiffness"))
    resin = load_resin(resin_file(tmp_path, HEAD + text))
    simulated = [f"{name}: from simulated data, not measured" for name in ("cure", "stiffness")]
    assert list(resin.warnings) == [*simulated, *(f"{name}: doubt of {name}" for name in tables)]
    assert resin.cautions("stiffness") == (simulated[1], "stiffness: doubt of stiffness")
    (tmp_path / "sensor.toml").write_text('schema = 1\nname = "x"\n[material]\nresin = "mine.toml"\n', encoding="utf-8")
    design = load(tmp_path / "sensor.toml")
    doubts = [text for text in optical(design).warnings if "doubt" in text]
    assert doubts == ["index: doubt of index", "loss: doubt of loss"]
    assert stiffness_cautions(design) == resin.cautions("stiffness")
    with_modulus = design.mechanics.model_copy(update={"modulus_MPa": 2.0})
    assert stiffness_cautions(design.model_copy(update={"mechanics": with_modulus})) == ()


def test_the_example_design_uses_the_loss_of_the_resin_that_replaces_its_index(tmp_path: Path) -> None:
    resin_file(tmp_path, f'{HEAD}[index]\nkind = "number"\nn = 1.44\n[loss]\nabsorption_per_mm = 0.03\n')
    file = tmp_path / "sensor.toml"
    file.write_text(re.sub(r"(?m)^index = 1.44", 'resin = "mine.toml"', template()), encoding="utf-8")
    assert optical(load(file)).absorption_per_mm == 0.03


def test_refuses_a_wavelength_outside_the_range_of_the_resin(tmp_path: Path) -> None:
    line = "^resin mine: index at 950 nm; is known only from 400 to 900 nm; choose a wavelength inside"
    with pytest.raises(SolenError, match=line):
        optical(design_of(tmp_path, 'resin = "mine.toml"', wavelength_nm=950))


def test_refuses_a_design_whose_resin_does_not_exist(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        optical(design_of(tmp_path, 'resin = "other.toml"'))
    with pytest.raises(DataError, match="did you mean pmma"):
        optical(design_of(tmp_path, 'resin = "pmm"'))
