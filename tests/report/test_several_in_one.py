"""Several files in one figure: each is drawn and labelled; repeats are drawn as mean and standard deviation."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

import solen
from solen.pipeline.resin.cure import cure
from solen.pipeline.resin.spectra import spectra
from tests.report.lettering import faults


def discs(file: Path, Dp_um: float, Ec: float) -> Path:
    rng = np.random.default_rng(int(Dp_um))
    dose = np.repeat([13.0, 26.0, 39.0, 52.0, 65.0, 78.0], 3)
    um = Dp_um * np.log(dose / Ec) * (1.0 + 0.02 * rng.standard_normal(dose.size))
    np.savetxt(file, np.column_stack([dose, um]), delimiter=",", header="dose_mJ_per_cm2,thickness_um", comments="")
    return file


def test_fits_and_draws_working_curves_of_several_resins(tmp_path: Path) -> None:
    files = [discs(tmp_path / "soft.csv", 110.0, 6.0), discs(tmp_path / "hard.csv", 80.0, 9.0)]
    result = cure(files).result
    alone = [cure([file]).result for file in files]
    assert result.Dp_um == alone[0].Dp_um
    assert [(item.file, item.Dp_um) for item in result.beside] == [("hard.csv", alone[1].Dp_um)]
    assert [source.file for source in result.sources] == ["soft.csv", "hard.csv"]
    figure = solen.plot(result)
    labels = [line.get_label() for line in figure.axes[0].lines]
    assert any(str(label).startswith("soft") for label in labels)
    assert any(str(label).startswith("hard") for label in labels)
    means = [line for line in figure.axes[0].lines if len(np.atleast_1d(line.get_xdata())) == 6]
    assert len(means) >= 2, "six doses each, as their means"
    assert faults(figure) == []


def test_draws_repeats_as_mean_and_standard_deviation(tmp_path: Path) -> None:
    nm = np.linspace(400.0, 800.0, 41)
    values = [0.90 + 0.01 * k + 1e-4 * (nm - 400.0) for k in (-1.0, 0.0, 1.0)]
    for name in ("one", "two"):
        np.savetxt(
            tmp_path / f"{name}.csv", np.column_stack([nm, *values]), delimiter=",",
            header="wavelength_nm,PU-1,PU-2,PU-3", comments="",
        )  # fmt: skip
    files = [tmp_path / "one.csv", tmp_path / "two.csv"]
    separate = spectra(files).result
    assert [(trace.file, trace.name) for trace in separate.traces][3:] == [("two.csv", f"PU-{k}") for k in (1, 2, 3)]
    (axes,) = solen.plot(spectra(files, repeats=True).result).axes
    labelled = [line for line in axes.lines if not str(line.get_label()).startswith("_")]
    assert [str(line.get_label()).partition(":")[0] for line in labelled] == ["one", "two"]
    for line in labelled:
        assert np.allclose(np.asarray(line.get_ydata(), dtype=float), values[1])
    band = next(item for item in axes.collections if isinstance(item, PolyCollection))
    ys = np.asarray(band.get_paths()[0].vertices, dtype=float)[:, 1]
    assert ys.min() == pytest.approx(0.89)
    assert ys.max() == pytest.approx(0.95)
