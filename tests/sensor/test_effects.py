"""A sensor as it is built: each number is off from what it is, also from what the resin says."""

from typing import Any

import pytest

from solen.errors import SpecError
from solen.explore.tolerance import ToleranceOptions, print_design
from solen.sensor import Sensor, inert
from solen.sensor.effects import as_built
from solen.sensor.numbers import number
from solen.spec import Design, loads, template, with_values

ABSORPTION, INDEX, WAVELENGTH = "material.absorption_per_mm", "material.index", "emitter.wavelength_nm"


def design(example: str = "paper-860", **values: Any) -> Design:
    """An example with some values set; ``__`` stands for the dot of a key."""
    return with_values(loads(template(example)), {key.replace("__", "."): value for key, value in values.items()})


def body_loss_per_mm(sensor: Sensor) -> float:
    """Absorption of the body that is traced."""
    return next(region.absorption_per_mm for region in sensor.scene().regions if region.name == "body")


def test_absorption_is_off_from_the_loss_of_the_resin() -> None:
    sensor = Sensor.of(design(material__resin="pet-pressed"))
    loss = sensor.material.absorption_per_mm
    assert loss > 0.02
    assert number(sensor, ABSORPTION) == loss
    for step in (-0.001, 0.001):
        assert body_loss_per_mm(as_built(sensor, {ABSORPTION: step})) == pytest.approx(loss + step, abs=1e-12)


@pytest.mark.parametrize("stated", [0.0, 0.004])
def test_a_stated_absorption_overrules_the_resin(stated: float) -> None:
    sensor = Sensor.of(design(material__resin="pet-pressed", material__absorption_per_mm=stated))
    assert number(sensor, ABSORPTION) == stated
    assert body_loss_per_mm(as_built(sensor, {ABSORPTION: 0.001})) == pytest.approx(stated + 0.001, abs=1e-12)


def test_the_derivative_by_the_index_keeps_the_loss_of_the_resin() -> None:
    of_resin = design(material__resin="pet-pressed")
    material = Sensor.of(of_resin).material
    plain = with_values(of_resin, {INDEX: material.index, ABSORPTION: material.absorption_per_mm})
    slopes = [Sensor.of(one).derivative(INDEX, 3.0).detectors["right"].value for one in (of_resin, plain)]
    assert slopes[0] == pytest.approx(slopes[1], rel=1e-6)


def test_a_print_of_another_index_keeps_the_loss_of_the_resin() -> None:
    """Its index is that of the resin at the wavelength of the print."""
    vary = ("material.index=uniform:0.0009999:0.0010001", "emitter.wavelength_nm=uniform:-40.01:-39.99")
    of_resin = design(material__resin="pet-pressed", emitter__wavelength_nm=700.0)
    printed = print_design(of_resin, ToleranceOptions(vary=vary, prints=32, print_number=2))
    assert printed is not None
    assert body_loss_per_mm(Sensor.of(printed)) == Sensor.of(of_resin).material.absorption_per_mm
    there = Sensor.of(with_values(of_resin, {WAVELENGTH: 660.0})).material.index
    assert printed.material.index == pytest.approx(there + 0.001, abs=1e-5)
    assert there - Sensor.of(of_resin).material.index > 1e-4


def test_wavelength_and_index_are_off_together() -> None:
    """The lines of a part's spectrum move with its wavelength: the index is known at the new lines."""
    sensor = Sensor.of(design(material__resin="pmma", emitter__part="VSMY1850"))
    both = as_built(sensor, {WAVELENGTH: 6.0, INDEX: 0.002})
    only = as_built(sensor, {WAVELENGTH: 6.0})
    lines_nm = both.scene().wavelengths_nm
    assert lines_nm == pytest.approx([nm + 6.0 for nm in sensor.scene().wavelengths_nm])
    body, before = (next(region for region in one.scene().regions if region.name == "body") for one in (both, only))
    for nm in lines_nm:
        assert body.index_at(nm) == pytest.approx(before.index_at(nm) + 0.002, abs=1e-12)


def test_beside_a_stated_spectrum_the_wavelength_is_inert() -> None:
    sensor = Sensor.of(loads(template("pmma-860")))
    moved = as_built(sensor, {WAVELENGTH: 30.0})
    assert moved.scene().sources == sensor.scene().sources
    assert "emitter.spectrum" in inert(sensor, WAVELENGTH)
    with pytest.raises(SpecError, match=r"emitter\.spectrum"):
        sensor.sensitivity([WAVELENGTH])
    assert not inert(Sensor.of(design(material__resin="pmma", emitter__part="VSMY1850")), WAVELENGTH)


def test_scattered_light_reaches_the_stated_tolerance_or_says_that_it_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("solen.sensor.sensor.MAX_SAMPLED", 2**17)
    rough = Sensor.of(loads(template() + '\n[[wall]]\nface = "stem-*"\nscatter = "lambertian"\n'))
    loose, tight = (rough.power([3.0], tolerance=tolerance) for tolerance in (1e-2, 1e-7))
    (reached,), (missed,) = loose.traces, tight.traces
    assert reached.reached
    assert reached.u_power <= 1e-2
    assert not missed.reached
    assert "1e-07" in missed.why
    assert missed.rays > reached.rays
