"""Any table of numbers gives a result that JSON can hold, or a refusal in one line; never a warning of numpy."""

import json
from pathlib import Path

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

QUICK = settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
NUMBERS = st.one_of(
    st.sampled_from(["", "0", "1", "10", "20", "20", "30", "1e-9", "1e9", "-1", "1e-300", "1e300"]),
    st.floats(0.1, 100.0).map(lambda value: f"{value:.4g}"),
)
NAMES = st.sampled_from(["a", "b", "c", ""])


def kept(path: Path, header: str, rows: list[tuple[str, ...]]) -> Path:
    path.write_text("\n".join([header, *(",".join(row) for row in rows)]) + "\n", encoding="utf-8")
    return path


DISCS = CureOptions(irradiance_mW_per_cm2=13.0, layer_um=25.0, exposure_s=2.0)


def is_sound(found: dict[str, object]) -> None:
    json.dumps(found, allow_nan=False)
    assert all(isinstance(told, str) and "nan" not in told.split() for told in found["warnings"])  # type: ignore[attr-defined]


def one_line(refusal: SolenError) -> None:
    assert len(str(refusal).splitlines()) == 1


@QUICK
@given(rows=st.lists(st.tuples(NUMBERS, NUMBERS, NAMES, st.sampled_from(["flat", "upright"])), min_size=1, max_size=14))
def test_any_table_of_guides(tmp_path: Path, rows: list[tuple[str, ...]]) -> None:
    path = kept(tmp_path / "guides.csv", "length_mm,power_mW,guide,orientation", rows)
    try:
        is_sound(cutback(path, figure=FigureOptions(figure=tmp_path / "guides.svg")).to_dict())
    except SolenError as refusal:
        one_line(refusal)


@QUICK
@given(rows=st.lists(st.tuples(NUMBERS, NUMBERS, NAMES), min_size=1, max_size=14))
def test_any_table_of_discs(tmp_path: Path, rows: list[tuple[str, ...]]) -> None:
    path = kept(tmp_path / "discs.csv", "dose_mJ_per_cm2,thickness_um,disc", rows)
    try:
        is_sound(cure([path], options=DISCS, figure=FigureOptions(figure=tmp_path / "discs.svg")).to_dict())
    except SolenError as refusal:
        one_line(refusal)


@QUICK
@given(
    rows=st.lists(st.tuples(st.floats(300, 500).map(lambda nm: f"{nm:.3f}"), NUMBERS), min_size=2, max_size=9),
    nm=st.sampled_from([350.0, 400.0]),
)
@example(rows=[("300.000", "0.1094"), ("363.000", "0.1094")], nm=350.0)  # flat: all of it may be an offset
@example(rows=[("300.000", "1e-300"), ("363.000", "0")], nm=350.0)  # the light loses less than its rounding
def test_any_absorbance(tmp_path: Path, rows: list[tuple[str, ...]], nm: float) -> None:
    path = kept(tmp_path / "resin.csv", "wavelength_nm,absorbance", rows)
    try:
        options = PenetrationOptions(path_um=93.0, led_nm=nm, led_fwhm_nm=10.0)
        is_sound(penetration(path, options=options, figure=FigureOptions(figure=tmp_path / "resin.svg")).to_dict())
    except SolenError as refusal:
        one_line(refusal)


@QUICK
@given(rows=st.lists(st.tuples(st.sampled_from(["2", "4", "6"]), NUMBERS, NUMBERS), min_size=2, max_size=9))
def test_any_exposures(tmp_path: Path, rows: list[tuple[str, ...]]) -> None:
    path = kept(tmp_path / "long.csv", "exposure_s,wavelength_nm,T,R", [(s, "450", t, r) for s, t, r in rows])
    try:
        options = ExposureOptions(wavelength_nm=(450.0,), thickness_um=25.0)
        is_sound(exposures([path], options=options, figure=FigureOptions(figure=tmp_path / "long.svg")).to_dict())
    except SolenError as refusal:
        one_line(refusal)
