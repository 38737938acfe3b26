"""A sensor with deviations: each number deviates from its value in the design or in the resin."""

from typing import Any

import pytest

from solen.errors import SpecError
from solen.explore.tolerance import ToleranceOptions, print_design
from solen.sensor import Sensor, why_inert
from solen.sensor.effects import with_deviations
from solen.sensor.numbers import number
from solen.spec import Design, loads, template, with_values

ABSORPTION, INDEX, WAVELENGTH = "material.absorption_per_mm", "material.index", "emitter.wavelength_nm"


def design(example: str = "paper-860", **values: Any) -> Design:
    """An example with some values set; ``__`` stands for the dot of a key."""
    return with_values(loads(template(example)), {key.replace("__", "."): value for key, value in values.items()})


def body_loss_per_mm(sensor: Sensor) -> float:
    """Absorption of the body in the scene."""
    return next(region.absorption_per_mm for region in sensor.scene().regions if region.name == "body")


def test_absorption_deviates_from_the_loss_of_the_resin() -> None:
    sensor = Sensor.of(design(material__resin="pet-pressed"))
    loss = sensor.material.absorption_per_mm
    assert loss > 0.02
    assert number(sensor, ABSORPTION) == loss
    for step in (-0.001, 0.001):
        assert body_loss_per_mm(with_deviations(sensor, {ABSORPTION: step})) == pytest.approx(loss + step, abs=1e-12)


@pytest.mark.parametrize("absorption_per_mm", [0.0, 0.004])
def test_absorption_of_the_design_overrides_the_resin(absorption_per_mm: float) -> None:
    sensor = Sensor.of(design(material__resin="pet-pressed", material__absorption_per_mm=absorption_per_mm))
    assert number(sensor, ABSORPTION) == absorption_per_mm
    assert body_loss_per_mm(with_deviations(sensor, {ABSORPTION: 0.001})) == pytest.approx(
        absorption_per_mm + 0.001, abs=1e-12
    )


def test_derivative_by_the_index_keeps_the_loss_of_the_resin() -> None:
    resin_design = design(material__resin="pet-pressed")
    material = Sensor.of(resin_design).material
    plain = with_values(resin_design, {INDEX: material.index, ABSORPTION: material.absorption_per_mm})
    slopes = [
        Sensor.of(each_design).derivative(INDEX, 3.0).detectors["right"].value for each_design in (resin_design, plain)
    ]
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-6)


def test_print_with_another_index_keeps_the_loss_of_the_resin() -> None:
    """The index is that of the resin at the wavelength of the print, plus its deviation."""
    vary = ("material.index=uniform:0.0009999:0.0010001", "emitter.wavelength_nm=uniform:-40.01:-39.99")
    resin_design = design(material__resin="pet-pressed", emitter__wavelength_nm=700.0)
    printed = print_design(resin_design, ToleranceOptions(vary=vary, prints=32, print_number=2))
    assert printed is not None
    assert body_loss_per_mm(Sensor.of(printed)) == Sensor.of(resin_design).material.absorption_per_mm
    index_at_660_nm = Sensor.of(with_values(resin_design, {WAVELENGTH: 660.0})).material.index
    assert printed.material.index == pytest.approx(index_at_660_nm + 0.001, abs=1e-5)
    assert index_at_660_nm - Sensor.of(resin_design).material.index > 1e-4


def test_wavelength_and_index_deviate_together() -> None:
    """The lines of a part's spectrum shift with its wavelength, and the index deviates at all new lines."""
    sensor = Sensor.of(design(material__resin="pmma", emitter__part="VSMY1850"))
    both = with_deviations(sensor, {WAVELENGTH: 6.0, INDEX: 0.002})
    only = with_deviations(sensor, {WAVELENGTH: 6.0})
    lines_nm = both.scene().wavelengths_nm
    assert lines_nm == pytest.approx([nm + 6.0 for nm in sensor.scene().wavelengths_nm])
    body, body_before = (
        next(region for region in each_design.scene().regions if region.name == "body") for each_design in (both, only)
    )
    for nm in lines_nm:
        assert body.index_at(nm) == pytest.approx(body_before.index_at(nm) + 0.002, abs=1e-12)


def test_wavelength_is_inert_if_the_design_gives_a_spectrum() -> None:
    sensor = Sensor.of(loads(template("pmma-860")))
    deviated = with_deviations(sensor, {WAVELENGTH: 30.0})
    assert deviated.scene().sources == sensor.scene().sources
    assert "emitter.spectrum" in why_inert(sensor, WAVELENGTH)
    with pytest.raises(SpecError, match=r"emitter\.spectrum"):
        sensor.sensitivity([WAVELENGTH])
    assert not why_inert(Sensor.of(design(material__resin="pmma", emitter__part="VSMY1850")), WAVELENGTH)


def test_scattered_light_reaches_the_tolerance_or_reports_why_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("solen.sensor.sensor.MAX_SAMPLED", 2**17)
    rough = Sensor.of(loads(template() + '\n[[wall]]\nface = "stem-*"\nscatter = "lambertian"\n'))
    loose, tight = (rough.power([3.0], tolerance=tolerance) for tolerance in (1e-2, 1e-7))
    (reached,), (unreached,) = loose.traces, tight.traces
    assert reached.reached
    assert reached.u_power <= 1e-2
    assert not unreached.reached
    assert "1e-07" in unreached.why
    assert unreached.rays > reached.rays
