"""Tables with columns that an evaluation does not use: refused with the name of the column, or selected by --where."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError, SpecError
from solen.material.cure import CureOptions, curve_of_discs
from solen.material.cure.exposures import ExposureOptions, exposure_trends
from solen.material.cure.penetration import PenetrationOptions, penetration_of
from solen.material.index.layer import index_of_layer
from solen.material.index.options import IndexOptions
from solen.material.index.stack import forward
from solen.material.loss import CutbackOptions, guide_loss
from solen.material.rows import RowOptions, chosen_rows
from solen.material.stiffness import Dimensions, MechanicalTest, StiffnessOptions, stiffness_of
from solen.pipeline.resin.spectra import spectra
from solen.recording import Recording, read


def table(folder: Path, header: str, *rows: str) -> Recording:
    file = folder / "table.csv"
    file.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return read(file)


def guides(folder: Path, extra: str, values: dict[str, float]) -> Recording:
    """Return guides with a loss in dB/cm for each value of an extra column."""
    rows = [
        f"{mm},{10 ** (-loss * mm / 100) * (1 + 0.001 * number):.6f},{value}{number},{value}"
        for value, loss in values.items()
        for number, mm in enumerate((10, 20, 30, 40))
    ]
    return table(folder, f"length_mm,power_mW,guide,{extra}", *rows)


def test_cutback_selects_one_of_several_wavelengths(tmp_path: Path) -> None:
    recording = guides(tmp_path, "wavelength_nm", {"450": 3.47, "860": 1.30})
    with pytest.raises(DataError, match=r"column wavelength = '450, 860'.*--where wavelength=450.*--ignore"):
        guide_loss(recording)
    for nm, loss in ((450.0, 3.47), (860.0, 1.30)):
        result = guide_loss(recording, CutbackOptions(where=(f"wavelength={nm:g}",)))
        assert result.loss_dB_per_cm == pytest.approx(loss, abs=0.01)
        assert result.wavelength_nm == nm
    assert guide_loss(recording, CutbackOptions(ignore=("wavelength",))).loss_dB_per_cm == pytest.approx(2.4, abs=0.1)


@pytest.mark.parametrize("column", ["material", "batch", "humidity_percent"])
def test_cutback_refuses_to_pool_the_values_of_a_column(column: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=column.partition("_")[0]):
        guide_loss(guides(tmp_path, column, {"40": 3.5, "50": 1.3}))


def test_redundant_columns_and_notes_are_accepted(tmp_path: Path) -> None:
    rows = [f"{mm},{mm / 10},{10 ** (-mm / 100):.6f},{mm}a,fine {mm}" for mm in (10, 20, 30, 40)]
    result = guide_loss(table(tmp_path, "length_mm,length_cm,power_mW,guide,note", *rows))
    assert result.loss_dB_per_cm == pytest.approx(1.0, abs=1e-4)
    assert any("note" in text for text in result.warnings)


def discs(folder: Path, header: str, materials: dict[str, float], extra: str = "") -> Recording:
    rows = [
        f"{dose},{depth * math.log(dose / 10) + 0.1 * repeat:.3f},{name}{extra.format(repeat + dose)}"
        for name, depth in materials.items()
        for dose in (20, 40, 80, 160)
        for repeat in range(2)
    ]
    return table(folder, header, *rows)


def test_cure_selects_one_of_several_resins(tmp_path: Path) -> None:
    recording = discs(tmp_path, "dose_mJ_per_cm2,thickness_um,resin", {"A": 90.0, "B": 130.0})
    with pytest.raises(DataError, match="column resin = 'A, B'"):
        curve_of_discs(recording)
    for name, depth in (("A", 90.0), ("b", 130.0)):
        assert curve_of_discs(recording, CureOptions(where=(f"resin={name}",))).Dp_um == pytest.approx(depth, abs=0.5)


def test_cure_refuses_to_ignore_a_standard_deviation(tmp_path: Path) -> None:
    recording = discs(tmp_path, "dose_mJ_per_cm2,thickness_um,resin,sd", {"A": 90.0}, ",{}")
    with pytest.raises(DataError, match="column sd"):
        curve_of_discs(recording)
    assert curve_of_discs(recording, CureOptions(ignore=("sd",))).Dp_um == pytest.approx(90.0, abs=0.5)


@pytest.mark.parametrize(("factor", "refused"), [(1.0, False), (1.2, True)])
def test_doses_must_be_the_products_of_times_and_irradiances(factor: float, refused: bool, tmp_path: Path) -> None:
    rows = [
        f"{dose},{dose / rate * factor:.4f},{rate},{90 * math.log(dose / 10):.3f}"
        for dose in (20, 40, 80, 160)
        for rate in (10, 20)
    ]
    recording = table(tmp_path, "dose_mJ_per_cm2,time_s,irradiance_mW_per_cm2,thickness_um", *rows)
    if refused:
        with pytest.raises(DataError, match=r"dose in row 1 = '20'.*24 mJ"):
            curve_of_discs(recording)
    else:
        assert curve_of_discs(recording).Dp_um == pytest.approx(90.0, abs=0.1)


def spectrum_rows(materials: dict[str, float], *, seconds: bool = False) -> list[str]:
    rows = []
    for name, n in materials.items():
        for nm in range(450, 900, 10):
            r, t = (float(value) for value in forward(n, 0.0, 25.0, nm))
            exposures = [f"{time},{nm},{t:.6f},{r:.6f},{name}" for time in ((2, 4, 6) if seconds else ())]
            rows += exposures or [f"{nm + (5 if name == 'B' else 0)},{t:.6f},{r:.6f},{name}"]
    return rows


def test_a_spectrum_belongs_to_one_sample(tmp_path: Path) -> None:
    recording = table(tmp_path, "wavelength_nm,T,R,sample", *spectrum_rows({"A": 1.45, "B": 1.55}))
    options = {"thickness_um": 25.0, "baseline": "air"}
    with pytest.raises(DataError, match="column sample = 'A, B'"):
        index_of_layer(recording, IndexOptions(**options))
    with pytest.raises(DataError, match="column sample"):
        penetration_of(recording, PenetrationOptions(path_um=100.0))
    with pytest.raises(DataError, match="column sample"):
        spectra([tmp_path / "table.csv"])
    result = index_of_layer(recording, IndexOptions(**options, where=("sample=B",)))
    assert np.nanmedian(result.n) == pytest.approx(1.55, abs=1e-3)


def test_an_unused_numerical_column_is_reported(tmp_path: Path) -> None:
    rows = [f"{row.rpartition(',')[0]},{20 + number}" for number, row in enumerate(spectrum_rows({"A": 1.5}))]
    recording = table(tmp_path, "wavelength_nm,T,R,temperature_degC", *rows)
    result = index_of_layer(recording, IndexOptions(thickness_um=25.0, baseline="air"))
    assert any("not used: " in text and "temperature" in text for text in result.warnings)


def test_exposures_do_not_pool_materials(tmp_path: Path) -> None:
    rows = spectrum_rows({"A": 1.45, "B": 1.55}, seconds=True)
    recording = table(tmp_path, "exposure_s,wavelength_nm,T,R,material", *rows)
    with pytest.raises(DataError, match="column material = 'A, B'"):
        exposure_trends([recording])
    result = exposure_trends([recording], ExposureOptions(where=("material=A",), thickness_um=25.0))
    assert result.wavelengths[0].n == pytest.approx([1.45] * 3, abs=1e-3)


def test_replicates_of_a_sample_are_treated_as_samples(tmp_path: Path) -> None:
    rows = [
        f"{time},{nm},{0.9 + 0.01 * replicate},s,{replicate}"
        for time in (2, 4)
        for replicate in (1, 2)
        for nm in (500, 510)
    ]
    result = exposure_trends([table(tmp_path, "exposure_s,wavelength_nm,T,sample,replicate", *rows)])
    np.testing.assert_allclose(result.wavelengths[0].T, [0.91, 0.92, 0.91, 0.92])


def test_specimens_of_several_batches_are_not_pooled(tmp_path: Path) -> None:
    rows = [
        f"{stretch / 100},{modulus * stretch / 100:.5f},{specimen},{batch}"
        for batch, specimen, modulus in (("x", 1, 1.0), ("x", 2, 1.2), ("y", 1, 2.0), ("y", 2, 2.2))
        for stretch in range(31)
    ]
    recording = table(tmp_path, "strain,stress_MPa,specimen,batch", *rows)
    tests = [MechanicalTest(recording=recording, mode="tension", label="", dimensions=Dimensions())]
    with pytest.raises(DataError, match="column batch = 'x, y'"):
        stiffness_of(tests)
    result = stiffness_of(tests, StiffnessOptions(where=("batch=y",), fit=("none",)))
    assert result.modulus_MPa == pytest.approx(2.1, rel=1e-3)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"where": ("resin",)}, "--where = 'resin'; "),
        ({"where": ("resin=C",)}, "resin is A, B"),
        ({"where": ("lamp=1",)}, "--where lamp; there is no such column; "),
        ({"ignore": ("lamp",)}, "--ignore lamp; there is no such column"),
    ],
)
def test_refuses_an_invalid_selection_of_rows(options: dict[str, tuple[str, ...]], line: str, tmp_path: Path) -> None:
    recording = discs(tmp_path, "dose_mJ_per_cm2,thickness_um,resin", {"A": 90.0, "B": 130.0})
    with pytest.raises((DataError, SpecError), match=re.escape(line)):
        curve_of_discs(recording, CureOptions(**options))


def test_refuses_a_mean_next_to_its_replicates(tmp_path: Path) -> None:
    rows = [f"{dose},{90 * math.log(dose / 10):.3f},{90 * math.log(dose / 10):.3f},70" for dose in (20, 40, 80, 160)]
    with pytest.raises(DataError, match=r"column thickness; .*thickness 1, thickness 2"):
        curve_of_discs(table(tmp_path, "dose (mJ/cm2),thickness (um),thickness 1 (um),thickness 2 (um)", *rows))


def test_a_mapped_column_is_read_under_its_new_name(tmp_path: Path) -> None:
    recording = table(tmp_path, "wavelength_nm,tr", *(f"{nm},0.9" for nm in range(450, 500, 10)))
    assert chosen_rows(recording, RowOptions(map=("tr=T",))).channel("T").quantity == "transmittance"
