"""Any table of numbers yields a result that JSON can represent, or a refusal in one line, without NumPy warnings."""

import json
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from solen.errors import SolenError
from solen.material.cure import CureOptions
from solen.material.cure.exposures import ExposureOptions
from solen.material.cure.penetration import PenetrationOptions
from solen.pipeline.resin.cure import cure
from solen.pipeline.resin.cutback import cutback
from solen.pipeline.resin.exposures import exposures
from solen.pipeline.resin.penetration import penetration
from solen.report.options import FigureOptions

SETTINGS = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
NUMBERS = st.one_of(
    st.sampled_from(["", "0", "1", "10", "20", "20", "30", "1e-9", "1e9", "-1", "1e-300", "1e300"]),
    st.floats(0.1, 100.0).map(lambda value: f"{value:.4g}"),
)
NAMES = st.sampled_from(["a", "b", "c", ""])
WITH_FIGURE = st.sampled_from([True, False, False, False])  # a figure takes longer than the rest of a command


def write_table(path: Path, header: str, rows: list[tuple[str, ...]]) -> Path:
    path.write_text("\n".join([header, *(",".join(row) for row in rows)]) + "\n", encoding="utf-8")
    return path


CURE = CureOptions(irradiance_mW_per_cm2=13.0, layer_um=25.0, exposure_s=2.0)


def figure_options(path: Path, with_figure: bool) -> FigureOptions:
    return FigureOptions(figure=path.with_suffix(".svg") if with_figure else None)


def check_result(result: dict[str, Any]) -> None:
    json.dumps(result, allow_nan=False)
    assert all(isinstance(line, str) and "nan" not in line.split() for line in result["warnings"])


def check_error(error: SolenError) -> None:
    assert len(str(error).splitlines()) == 1


@SETTINGS
@given(
    rows=st.lists(st.tuples(NUMBERS, NUMBERS, NAMES, st.sampled_from(["flat", "upright"])), min_size=1, max_size=14),
    with_figure=WITH_FIGURE,
)
def test_any_table_of_guides(tmp_path: Path, rows: list[tuple[str, ...]], with_figure: bool) -> None:
    path = write_table(tmp_path / "guides.csv", "length_mm,power_mW,guide,orientation", rows)
    try:
        check_result(cutback(path, figure=figure_options(path, with_figure)).to_dict())
    except SolenError as error:
        check_error(error)


@SETTINGS
@given(rows=st.lists(st.tuples(NUMBERS, NUMBERS, NAMES), min_size=1, max_size=14), with_figure=WITH_FIGURE)
def test_any_table_of_discs(tmp_path: Path, rows: list[tuple[str, ...]], with_figure: bool) -> None:
    path = write_table(tmp_path / "discs.csv", "dose_mJ_per_cm2,thickness_um,disc", rows)
    try:
        check_result(cure([path], options=CURE, figure=figure_options(path, with_figure)).to_dict())
    except SolenError as error:
        check_error(error)


@SETTINGS
@given(
    rows=st.lists(st.tuples(st.floats(300, 500).map(lambda nm: f"{nm:.3f}"), NUMBERS), min_size=2, max_size=9),
    nm=st.sampled_from([350.0, 400.0]),
    with_figure=WITH_FIGURE,
)
# a constant absorbance, which may be an offset entirely, and one below the rounding error of the transmittance
@example(rows=[("300.000", "0.1094"), ("363.000", "0.1094")], nm=350.0, with_figure=True)
@example(rows=[("300.000", "1e-300"), ("363.000", "0")], nm=350.0, with_figure=True)
def test_any_absorbance(tmp_path: Path, rows: list[tuple[str, ...]], nm: float, with_figure: bool) -> None:
    path = write_table(tmp_path / "resin.csv", "wavelength_nm,absorbance", rows)
    try:
        options = PenetrationOptions(path_um=93.0, led_nm=nm, led_fwhm_nm=10.0)
        check_result(penetration(path, options=options, figure=figure_options(path, with_figure)).to_dict())
    except SolenError as error:
        check_error(error)


@SETTINGS
@given(
    rows=st.lists(st.tuples(st.sampled_from(["2", "4", "6"]), NUMBERS, NUMBERS), min_size=2, max_size=9),
    with_figure=WITH_FIGURE,
)
def test_any_exposures(tmp_path: Path, rows: list[tuple[str, ...]], with_figure: bool) -> None:
    path = write_table(tmp_path / "long.csv", "exposure_s,wavelength_nm,T,R", [(s, "450", t, r) for s, t, r in rows])
    try:
        options = ExposureOptions(wavelength_nm=(450.0,), thickness_um=25.0)
        check_result(exposures([path], options=options, figure=figure_options(path, with_figure)).to_dict())
    except SolenError as error:
        check_error(error)
