"""A sensor with a real emitter: chip, part, spectrum, ray file and ambient light."""

import math
from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.material import Cauchy
from solen.scene import Ambient, Chip, Emitter, Fan, PatternTable, RayFile, Region
from solen.sensor import Sensor, study
from solen.spec import Design
from tests.scene.rayfile_support import lambertian, zemax


def sensor(ambient: dict[str, object] | None = None, **emitter: object) -> Sensor:
    tables = {"material": {"index": 1.44}, "ambient": ambient or {}, "emitter": emitter}
    return Sensor.of(Design(name="one", **tables))


def test_source_follows_the_design() -> None:
    assert sensor().scene().sources == (Fan((0.0, -1.0), 0.0, 120.0, 100),)
    assert sensor(width_mm=0.2).scene().sources == (Chip((0.0, -1.0), 0.2, 0.0, 120.0, 100),)
    (part,) = sensor(part="VSMY1850", width_mm=0.2, height_mm=0.3).scene().sources
    assert isinstance(part, Emitter)
    assert isinstance(part.pattern, PatternTable)
    assert (part.cone_deg, part.width_mm, part.height_mm, part.spectrum) == (360.0, 0.2, 0.3, ())


def test_chip_makes_the_response_gradual() -> None:
    """With a point, the contrast saturates within 0.7°; with a chip 0.2 mm wide, it rises to 0.90 over 3°."""
    response = sensor(width_mm=0.2).power([-3.0, -1.0, -0.5, 0.0])
    assert all(trace.method == "adaptive" and trace.reached for trace in response.traces)
    assert response.contrast == pytest.approx([0.895, 0.486, 0.249, 0.0], abs=2e-3)
    assert np.all(response.u_power <= 1e-4)


def test_warns_of_a_wavelength_outside_the_parts_emission() -> None:
    warnings = " ".join(sensor(part="VSMY1850", wavelength_nm=1550.0).warnings)
    assert "850" in warnings
    assert "1550" in warnings
    for matching in (sensor(part="VSMY1850"), sensor(part="VSMY1850", wavelength_nm=860.0)):
        assert not [text for text in matching.warnings if "VSMY1850" in text]


def test_slope_of_a_chip_is_that_of_its_response() -> None:
    chip = sensor(width_mm=0.2)
    slope = chip.slope_per_deg(0.0)
    assert slope is not None
    low, high = chip.power([-0.1, 0.1]).contrast
    assert slope.value == pytest.approx((high - low) / 0.2, rel=0.05)


def test_width_of_a_chip_has_a_sensitivity() -> None:
    (row,) = sensor(width_mm=0.2).sensitivity(["emitter.width_mm"], -1.0)
    narrow, wide = (sensor(width_mm=w).power([-1.0]).contrast[0] for w in (0.19, 0.21))
    assert row.contrast.value == pytest.approx((wide - narrow) / 0.02, rel=0.1)
    assert row.contrast.value < -1.0


def test_spectrum_is_traced_with_the_dispersion_of_the_resin(tmp_path: Path) -> None:
    (tmp_path / "resin.toml").write_text(
        'schema = 1\nname = "r"\n[index]\nkind = "cauchy"\nA = 1.42\nB_um2 = 0.02\n', encoding="utf-8"
    )
    tables = {"material": {"resin": "resin.toml"}, "emitter": {"spectrum": [[450.0, 1.0], [860.0, 1.0]]}}
    coloured = Sensor.of(Design(name="one", **tables).in_folder(tmp_path))
    scene = coloured.scene()
    assert scene.wavelengths_nm == (450.0, 860.0)
    assert scene.regions[1] == Region("body", Cauchy(A=1.42, B_um2=0.02))
    assert coloured.material.index == pytest.approx(1.42 + 0.02 / 0.655**2)
    integrated = coloured.integrate(-0.3)
    dense = coloured.trace(-0.3, "power", 2**16)
    for name, reading in integrated.detectors.items():
        assert reading.power == pytest.approx(dense.detectors[name].power, abs=1e-3)


def test_spectrum_has_no_effect_without_dispersion() -> None:
    assert sensor(fwhm_nm=30.0).scene() == sensor().scene()


def test_ambient_light_is_separate_in_the_powers() -> None:
    with_ambient = sensor(ambient={"power": 0.5, "rays": 20_000})
    scene = with_ambient.scene()
    _, ambient_source = scene.sources
    assert isinstance(ambient_source, Ambient)
    corners = with_ambient.body().outline()
    assert np.all(
        np.hypot(corners[:, 0] - ambient_source.center[0], corners[:, 1] - ambient_source.center[1])
        < ambient_source.radius_mm
    )
    traced = with_ambient.trace(0.3, "power")
    dark = sensor().trace(0.3, "power")
    for name, reading in traced.detectors.items():
        assert reading.power_by_source[0] * 1.5 == pytest.approx(dark.detectors[name].power, abs=1e-12)
        assert reading.power_by_source[1] > 0.0
        assert sum(reading.power_by_source) == pytest.approx(reading.power, abs=1e-12)


def test_irradiance_is_the_power_per_mm_of_an_open_face() -> None:
    """A small disc in the middle of the ambient circle receives the irradiance times its perimeter."""
    (_, ambient_source) = sensor(ambient={"irradiance_per_mm": 0.01}).scene().sources
    assert isinstance(ambient_source, Ambient)
    assert ambient_source.power == pytest.approx(0.01 * 2.0 * math.pi * ambient_source.radius_mm)
    launch = ambient_source.with_rays(200_000).launch()
    x, z = launch.x_mm - ambient_source.center[0], launch.z_mm - ambient_source.center[1]
    hits = np.abs(x * launch.dz - z * launch.dx) < 0.5  # distance of the ray from the middle
    assert ambient_source.power * np.mean(hits) == pytest.approx(0.01 * 2.0 * math.pi * 0.5, rel=0.02)


def test_ambient_light_is_uniform_in_direction_and_distance() -> None:
    ambient_source = Ambient((1.0, 2.0), 3.0, 50_000, 4.0)
    launch = ambient_source.launch()
    distance = (launch.x_mm - 1.0) * launch.dz - (launch.z_mm - 2.0) * launch.dx
    assert np.sort(distance) == pytest.approx(np.linspace(-3.0, 3.0, 50_000), abs=2e-3)
    direction = np.sort(np.arctan2(launch.dx, launch.dz))
    assert direction == pytest.approx(np.linspace(-math.pi, math.pi, 50_000), abs=0.05)
    deep = ambient_source.launch(in_space=True)
    assert deep.y_mm is not None
    assert deep.dy is not None
    assert np.ptp(deep.y_mm) == pytest.approx(4.0, abs=0.01)
    assert np.mean(deep.dy**2) == pytest.approx(0.25, abs=2e-3)  # for a Lambertian wall
    inwards = -((deep.x_mm - 1.0) * deep.dx + (deep.z_mm - 2.0) * deep.dz) / 3.0
    assert np.mean(inwards) == pytest.approx(2.0 / 3.0, abs=1e-3)


def test_ambient_light_is_integrated() -> None:
    with_ambient = sensor(ambient={"power": 0.5, "rays": 2**18})
    integrated = with_ambient.integrate(0.0, "count", 1e-2)
    dense = with_ambient.trace(0.0, "count", 2**12)
    for name, reading in integrated.detectors.items():
        assert reading.power_by_source[1] == pytest.approx(dense.detectors[name].power_by_source[1], abs=2e-3)
        assert reading.power_by_source[1] > 5e-3


def test_ray_file_replaces_the_emitter(tmp_path: Path) -> None:
    zemax(tmp_path / "led.sdf", lambertian(4096))
    design = Design(name="one", material={"index": 1.44}, emitter={"ray_file": "led.sdf"}).in_folder(tmp_path)
    real = Sensor.of(design)
    (source,) = real.scene(0.5).sources
    assert isinstance(source, RayFile)
    assert (source.rays, source.spectrum) == (4096, ())
    response = real.power([-3.0, 3.0])
    lambertian_chip = sensor(pattern="lambertian", width_mm=0.2).power([-3.0, 3.0])
    assert [trace.method for trace in response.traces] == ["sobol", "sobol"]
    assert np.sign(response.contrast).tolist() == [1.0, -1.0]
    assert abs(response.contrast) == pytest.approx(abs(lambertian_chip.contrast), abs=0.1)
    with pytest.raises(DataError, match=r"led2\.sdf"):
        Sensor.of(Design(name="one", material={"index": 1.44}, emitter={"ray_file": "led2.sdf"})).scene()


def test_study_of_a_real_emitter_has_a_null_and_a_slope() -> None:
    design = Design(
        name="one",
        material={"index": 1.44},
        emitter={"part": "VSMY1850", "width_mm": 0.2},
        motion={"from_deg": -1.0, "to_deg": 1.0, "step_deg": 1.0},
    )
    result = study(design)
    assert result.case.null_deg == pytest.approx(0.0, abs=1e-3)
    assert result.case.slope_per_deg is not None
    assert result.case.slope_per_deg < -0.3
