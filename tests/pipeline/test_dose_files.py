"""Evaluations of loss and dose from files in several formats: results, JSON, figures and refusals."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.cli import run_command
from solen.errors import DataError, SolenError, SpecError
from solen.material.cure import CureOptions, curve_of_discs
from solen.material.cure.exposures import ExposureOptions, ExposureTrends, exposure_trends
from solen.material.cure.penetration import Penetration, PenetrationOptions, penetration_of
from solen.material.loss import CutbackOptions, guide_loss
from solen.ranks import ranked
from solen.recording import read

DP, EC = 110.0, 6.0


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def guides(path: Path, header: str = "length_mm,power_uW,guide,orientation", seed: int = 3) -> Path:
    """Write readings of three guides per length and orientation, two each: 1.3 or 2.1 dB/cm, and 5 dB of coupling."""
    rng = np.random.default_rng(seed)
    rows = ["# simulated", header]
    number = 0
    for orientation, loss in (("flat", 1.3), ("upright", 2.1)):
        for mm in (10, 20, 30, 40, 50):
            for _ in range(3):
                number += 1
                deviation = rng.normal(0.0, 0.3)
                for _ in range(2):
                    power = 800.0 * 10.0 ** ((-5.0 - loss * mm / 10.0 + deviation + rng.normal(0.0, 0.05)) / 10.0)
                    rows.append(f"{mm},{power:.5g},{number},{orientation}")
    return write(path, "\n".join(rows) + "\n")


def discs(path: Path, header: str = "exposure_s,thickness_um,replicate", rate: float = 13.0) -> Path:
    rng = np.random.default_rng(5)
    rows = ["# simulated", header]
    for seconds in (0.6, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0):
        for replicate in (1, 2, 3):
            depth = DP * math.log(13.0 * seconds / EC) * rng.normal(1.0, 0.05)
            rows.append(f"{seconds * 13.0 / rate:.6g},{depth:.2f},{replicate}")
    return write(path, "\n".join(rows) + "\n")


def plain_json(text: str) -> Any:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    return json.loads(text, parse_constant=refuse)


def test_cutback_of_a_file(tmp_path: Path) -> None:
    result = guide_loss(read(guides(tmp_path / "guides.csv")), CutbackOptions(launched=800.0))
    assert [line.orientation for line in result.by_orientation] == ["flat", "upright"]
    for line, loss in zip(result.by_orientation, (1.3, 2.1), strict=True):
        low, high = line.interval95_loss_dB_per_cm
        assert low < loss < high
        assert line.interval95_coupling_loss_dB is not None
        low, high = line.interval95_coupling_loss_dB
        assert low < 5.0 < high
    assert (result.guides, result.readings, result.power_unit) == (30, 60, "uW")
    assert result.layer_limit_dB_per_cm == pytest.approx(1.738, abs=1e-3)
    assert result.simulated
    assert result.absorption_per_mm == pytest.approx(result.loss_dB_per_cm * math.log(10.0) / 100.0)


@pytest.mark.parametrize(
    ("header", "unit", "convert"),
    [
        ("length_mm,power_dBm,guide,orientation", None, lambda uw: 10.0 * math.log10(uw / 1000.0)),
        ("Länge (mm),Leistung (mW),Probe,Orientierung", None, lambda uw: uw / 1000.0),
        ("length (cm),signal_V,sample,build orientation", None, lambda uw: uw / 100.0),
        ("length_mm,insertion_loss_dB,guide,orientation", None, lambda uw: -10.0 * math.log10(uw / 800.0)),
        ("length_mm,power,guide,orientation", "dBm", lambda uw: 10.0 * math.log10(uw / 1000.0)),
        ("length_mm,transmission (%),guide,orientation", None, lambda uw: uw / 8.0),
        ("length_mm,T,guide,orientation", None, lambda uw: uw / 800.0),
    ],
)
def test_the_unit_of_power_does_not_affect_the_loss(
    tmp_path: Path, header: str, unit: str | None, convert: Any
) -> None:
    first = guide_loss(read(guides(tmp_path / "guides.csv")))
    rows = (tmp_path / "guides.csv").read_text(encoding="utf-8").splitlines()[2:]
    cells = [row.split(",") for row in rows]
    scale = 0.1 if "cm" in header else 1.0
    text = [header] + [f"{scale * float(mm):g},{convert(float(uw)):.8g},{name},{side}" for mm, uw, name, side in cells]
    result = guide_loss(read(write(tmp_path / "other.csv", "\n".join(text) + "\n")), CutbackOptions(unit=unit))
    assert result.loss_dB_per_cm == pytest.approx(first.loss_dB_per_cm, rel=1e-5)
    assert result.u_loss_dB_per_cm == pytest.approx(first.u_loss_dB_per_cm, rel=1e-4)
    assert [line.orientation for line in result.by_orientation] == ["flat", "upright"]
    relative = {"insertion_loss_dB", "transmission (%)", "T"}
    if header.split(",")[1] in relative:
        assert result.coupling_loss_dB == pytest.approx(5.0, abs=0.5)
    else:
        assert result.coupling_loss_dB is None
        assert any("--launched" in line for line in result.warnings)


def test_a_receiver_whose_voltage_falls_with_light_is_evaluated(tmp_path: Path) -> None:
    guides(tmp_path / "guides.csv")
    rows = (tmp_path / "guides.csv").read_text(encoding="utf-8").splitlines()[2:]
    cells = [row.split(",") for row in rows]
    text = ["length_mm,signal_V,guide"] + [f"{mm},{4.9 - float(uw) / 100.0:.6f},{name}" for mm, uw, name, _ in cells]
    result = guide_loss(read(write(tmp_path / "volts.csv", "\n".join(text) + "\n")), CutbackOptions(dark=4.9))
    assert (result.power_unit, result.dark, result.falls_with_light) == ("V", 4.9, True)
    assert 1.3 < result.loss_dB_per_cm < 2.1
    with pytest.raises(DataError, match="--dark"):
        guide_loss(read(tmp_path / "volts.csv"))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("length_mm,power_mW\n20,1\n20,1.1\n20,0.9\n", "single length"),
        ("length_mm,power_mW\n10,1\n20,0\n30,0.5\n", "must be above 0"),
        ("length_mm,note\n10,a\n20,b\n", "has no column power or signal or voltage"),
        ("size,power_mW\n10,1\n20,0.5\n", "has no column length"),
        ("length,power_mW\n10,1\n20,0.5\n", "its unit in the header"),
        ("length_mm,power_mW\n10,\n20,\n30,\n", "no row"),
    ],
)
def test_cutback_refuses_tables_that_determine_no_loss(tmp_path: Path, text: str, line: str) -> None:
    with pytest.raises(DataError, match=line):
        guide_loss(read(write(tmp_path / "bad.csv", text)))


def test_cutback_refuses_invalid_units_and_options(tmp_path: Path) -> None:
    path = guides(tmp_path / "guides.csv")
    for unit in ("mm", "lumen/parsec", "deg"):
        with pytest.raises(DataError, match=f"unit of power = '{unit}'"):
            guide_loss(read(path), CutbackOptions(unit=unit))
    with pytest.raises(SpecError, match="dark"):
        CutbackOptions(dark=math.nan)
    with pytest.raises(SpecError, match="860"):
        CutbackOptions(wavelength_nm=0.86)


def test_a_negative_loss_has_no_absorption(tmp_path: Path) -> None:
    rows = [f"{mm},{1.0 + mm / 50.0 + 0.01 * (-1) ** k},{k}" for k, mm in enumerate((10, 20, 30, 40, 50))]
    result = guide_loss(read(write(tmp_path / "up.csv", "length_mm,power_mW,guide\n" + "\n".join(rows) + "\n")))
    assert result.loss_dB_per_cm < 0.0
    assert result.absorption_per_mm is None
    assert any("not a loss" in line for line in result.warnings)


def test_cure_of_a_file(tmp_path: Path) -> None:
    options = CureOptions(irradiance_mW_per_cm2=13.0, layer_um=25.0, exposure_s=2.0, burn_in_layers=6, burn_in_s=3.0)
    result = curve_of_discs(read(discs(tmp_path / "discs.csv")), options)
    low, high = result.interval95_Dp_um
    assert low < DP < high
    assert result.interval95_Ec_mJ_per_cm2 is not None
    low, high = result.interval95_Ec_mJ_per_cm2
    assert low < EC < high
    required, layer, stack = result.layer, result.exposure, result.stack
    assert required is not None
    assert layer is not None
    assert stack is not None
    assert layer.dose_mJ_per_cm2 == 26.0
    assert layer.cure_depth_um == pytest.approx(DP * math.log(26.0 / EC), rel=0.05)
    assert required.needed_s == pytest.approx(result.Ec_mJ_per_cm2 * math.exp(50.0 / result.Dp_um) / 13.0)
    assert layer.print_through_um == pytest.approx(layer.cure_depth_um - 25.0)
    assert layer.dose_below_mJ_per_cm2 == pytest.approx(26.0 * math.exp(-25.0 / result.Dp_um))
    assert stack.interior_mean_mJ_per_cm2 == pytest.approx(26.0 * result.Dp_um / 25.0)
    assert stack.interior_over_single_layer == pytest.approx(1.0 / (1.0 - math.exp(-25.0 / result.Dp_um)))
    assert len(stack.layer_mean_mJ_per_cm2) == len(stack.exposures_mJ_per_cm2)
    assert result.simulated
    assert stack.layer_mean_mJ_per_cm2[0] > stack.interior_mean_mJ_per_cm2  # longer burn-in exposure


@pytest.mark.parametrize(
    ("header", "rate", "irradiance"),
    [
        ("energy_mJ_per_cm2,thickness_um,replicate", 1.0, None),
        ("Dose (J/cm²);Dc (mm);Wiederholung", 1000.0, None),
        ("time (s),cure depth (µm),disc", 13.0, 13.0),
        ("t / min,thickness / um,disc", 780.0, 13.0),
    ],
)
def test_columns_of_dose_or_time_in_any_unit(
    tmp_path: Path, header: str, rate: float, irradiance: float | None
) -> None:
    first = curve_of_discs(read(discs(tmp_path / "discs.csv")), CureOptions(irradiance_mW_per_cm2=13.0))
    discs(tmp_path / "other.csv", header, rate)
    text = (tmp_path / "other.csv").read_text(encoding="utf-8")
    if ";" in header:
        head, *rows = text.splitlines()[1:]
        cells = [row.split(",") for row in rows]
        text = "\n".join([head, *(f"{e};{float(d) / 1000:.6f};{r}".replace(".", ",") for e, d, r in cells)]) + "\n"
        write(tmp_path / "other.csv", text)
    result = curve_of_discs(read(tmp_path / "other.csv"), CureOptions(irradiance_mW_per_cm2=irradiance))
    assert result.Dp_um == pytest.approx(first.Dp_um, rel=1e-4)
    assert result.Ec_mJ_per_cm2 == pytest.approx(first.Ec_mJ_per_cm2, rel=1e-4)


def test_repeated_readings_of_a_disc_are_averaged(tmp_path: Path) -> None:
    options = CureOptions(irradiance_mW_per_cm2=13.0)
    rows = (discs(tmp_path / "discs.csv")).read_text(encoding="utf-8").splitlines()[2:]
    cells = [row.split(",") for row in rows]
    text = ["exposure_s,thickness_um,disc"]
    for number, (seconds, thick, _) in enumerate(cells):
        text += [f"{seconds},{float(thick) + deviation:.2f},{number}" for deviation in (-1.0, 0.0, 1.0)]
    result = curve_of_discs(read(write(tmp_path / "repeated.csv", "\n".join(text) + "\n")), options)
    single = curve_of_discs(read(tmp_path / "discs.csv"), options)
    assert result.discs == single.discs == 24
    assert result.u_Dp_um == pytest.approx(single.u_Dp_um, rel=1e-6)
    assert any("72 rows" in line and "24 discs" in line for line in result.warnings)
    named = ["exposure_s,thickness_um,sample,replicate", *(f"{row[0]},{row[1]},ma-PU,{row[2]}" for row in cells)]
    assert curve_of_discs(read(write(tmp_path / "named.csv", "\n".join(named) + "\n")), options).discs == 24


def test_the_dose_follows_from_the_irradiance_of_each_disc(tmp_path: Path) -> None:
    text = "exposure_s,irradiance_mW_per_cm2,thickness_um\n1,10,50\n2,10,120\n1,40,190\n4,20,260\n"
    result = curve_of_discs(read(write(tmp_path / "two.csv", text)))
    assert result.dose_range_mJ_per_cm2 == (10.0, 80.0)
    assert result.Dp_um == pytest.approx(70.0 / math.log(2.0), rel=0.02)


@pytest.mark.parametrize(
    ("text", "options", "line"),
    [
        ("exposure_s,thickness_um\n1,20\n2,30\n3,40\n", {}, "add --irradiance-mW-per-cm2"),
        ("exposure,thickness_um\n1,20\n2,30\n3,40\n", {}, "its unit in the header"),
        ("energy_mJ_per_cm2,size\n1,20\n2,30\n", {}, "has no column thickness"),
        ("height_mm,thickness_um\n1,20\n2,30\n", {}, "has no column dose"),
        ("dose_mJ_per_cm2,thickness_um\n1,20\n2,30\n", {}, "at least 3 discs"),
        (
            "dose_mJ_per_cm2,thickness_um\n1,20\n2,30\n3,1\n",
            {"layer_um": -1.0},
            "layer_um = -1.0; must be greater than 0",
        ),
        ("dose_mJ_per_cm2,thickness_um\n1,20\n2,30\n3,1\n", {"exposure_s": 2.0}, "--layer-um"),
        (
            "dose_mJ_per_cm2,thickness_um\n1,20\n2,30\n3,1\n",
            {"exposure_s": 2.0, "layer_um": 25.0},
            "--irradiance-mW-per-cm2",
        ),
        (
            "dose_mJ_per_cm2,thickness_um\n1,20\n2,30\n3,1\n",
            {"burn_in_layers": 2},
            "burn_in_layers; requires --exposure-s",
        ),
        (
            "dose_mJ_per_cm2,thickness_um\n1,20\n2,30\n3,1\n",
            {"irradiance_mW_per_cm2": 13.0, "exposure_s": 2.0, "layer_um": 25.0, "burn_in_s": 2.0},
            "burn_in_layers",
        ),
    ],
)
def test_cure_refuses_invalid_tables_and_options(tmp_path: Path, text: str, options: dict[str, Any], line: str) -> None:
    with pytest.raises(SolenError, match=line):
        curve_of_discs(read(write(tmp_path / "bad.csv", text)), CureOptions(**options))


def test_cure_refuses_invalid_options() -> None:
    with pytest.raises(SpecError, match="scatter = 'some'"):
        CureOptions(scatter="some")
    with pytest.raises(SpecError, match="min_thickness_um"):
        CureOptions(min_thickness_um=-1.0)


def test_warns_of_an_exposure_outside_the_range_of_the_discs(tmp_path: Path) -> None:
    recording = read(discs(tmp_path / "discs.csv"))
    long = CureOptions(irradiance_mW_per_cm2=13.0, layer_um=25.0, exposure_s=20.0)
    warnings = curve_of_discs(recording, long).warnings
    assert any("260 mJ/cm²" in line and "7.8 to 91 mJ/cm²" in line for line in warnings)
    thick = CureOptions(irradiance_mW_per_cm2=13.0, layer_um=200.0, exposure_s=2.0)
    assert any("may not bond to the previous one" in line for line in curve_of_discs(recording, thick).warnings)


def resin(path: Path, header: str = "wavelength_nm,absorbance") -> Path:
    """Write an absorbance that falls linearly from 1.0 at 380 nm to 0.2 at 420 nm."""
    nm = np.arange(360.0, 441.0, 2.0)
    a = 1.0 - 0.02 * (nm - 380.0)
    a = np.clip(a, 0.1, None)
    values = 100.0 * 10.0**-a if "T" in header else a
    rows = [f"{x:g},{y:.6f}" for x, y in zip(nm, values, strict=True)]
    return write(path, "\n".join(["# simulated", header, *rows]) + "\n")


def penetration(path: Path, path_um: float = 93.0, **more: Any) -> Penetration:
    return penetration_of(read(path), PenetrationOptions(path_um=path_um, **more))


def test_penetration_of_a_file(tmp_path: Path) -> None:
    path = resin(tmp_path / "resin.csv")
    without_lamp = penetration(path)
    assert without_lamp.Dp_um is None
    assert any("no lamp is specified" in line for line in without_lamp.warnings)
    index = without_lamp.wavelength_nm.tolist().index(380.0)
    assert without_lamp.spectral_Dp_um[index] == pytest.approx(93.0 / math.log(10.0))
    line = penetration(path, led_nm=400.0, u_path_um=2.0, u_absorbance=0.01)
    assert line.Dp_um == pytest.approx(93.0 / (0.6 * math.log(10.0)))
    assert line.Dp_um is not None
    assert line.u_Dp_um == pytest.approx(line.Dp_um * math.hypot(2.0 / 93.0, 0.01 / 0.6))
    broad = penetration(path, led_nm=400.0, led_fwhm_nm=15.0)
    assert broad.Dp_um == pytest.approx(line.Dp_um, rel=0.01)  # the absorbance is linear there
    assert broad.Dp_um is not None
    assert broad.between_Dp_um is not None
    assert broad.between_Dp_um > 1.05 * broad.Dp_um
    assert any("not decay exponentially" in line for line in broad.warnings)


def test_penetration_from_a_transmittance(tmp_path: Path) -> None:
    result = penetration(resin(tmp_path / "t.csv", "wavelength_nm,T (%)"), led_nm=380.0)
    assert result.Dp_um == pytest.approx(93.0 / math.log(10.0), rel=1e-4)
    assert any("reflect" in line for line in result.warnings)


@pytest.mark.parametrize(
    ("lamp", "line"),
    [
        ({"led_nm": 300.0}, "known only from 360 to 440 nm"),
        ({"led_fwhm_nm": 10.0}, "led_fwhm_nm"),
        ({"led_nm": -5.0}, "led_nm = -5.0"),
        ({"led": "VSMY1850", "led_nm": 385.0}, "led"),
        ({"led": "VSMY1850"}, "known only from 360 to 440 nm"),
    ],
)
def test_penetration_refuses_an_invalid_lamp(tmp_path: Path, lamp: dict[str, Any], line: str) -> None:
    with pytest.raises(SolenError, match=line):
        penetration(resin(tmp_path / "resin.csv"), **lamp)


def test_penetration_refuses_a_reflectance(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="path_um"):
        penetration(resin(tmp_path / "resin.csv"), path_um=0.0)
    reflectance = write(tmp_path / "r.csv", "wavelength_nm,R (%)\n400,4\n500,4\n")
    with pytest.raises(DataError, match="contains no absorbance"):
        penetration(reflectance)


def exposures(files: list[Path], **more: Any) -> ExposureTrends:
    return exposure_trends([read(file) for file in files], ExposureOptions(**more))


def layers(path: Path, seconds: tuple[int, ...] = (2, 4, 6)) -> Path:
    nm = np.arange(440.0, 881.0, 10.0)
    head = "wavelength_nm," + ",".join(f"layer {s} s (%T)" for s in seconds)
    rows = [f"{x:g}," + ",".join(f"{91.0 - 0.5 * s + x / 1000.0:.4f}" for s in seconds) for x in nm]
    return write(path, "\n".join(["# simulated", head, *rows]) + "\n")


def test_exposures_from_the_names_of_traces(tmp_path: Path) -> None:
    result = exposures([layers(tmp_path / "layers.csv")], irradiance_mW_per_cm2=13.0)
    assert result.exposure_s.tolist() == [2.0, 4.0, 6.0]
    assert result.dose_mJ_per_cm2 is not None
    assert result.dose_mJ_per_cm2.tolist() == [26.0, 52.0, 78.0]
    assert [row.wavelength_nm for row in result.wavelengths] == [450.0, 500.0, 860.0]
    for row in result.wavelengths:
        assert row.trend_T is not None
        assert row.trend_T.slope_per_s == pytest.approx(-0.005, abs=1e-9)
        assert row.trend_n is None
    assert any("thicker" in line for line in result.warnings)
    assert any("R was not measured" in line for line in result.warnings)


def test_exposures_from_the_names_of_files(tmp_path: Path) -> None:
    files = []
    for seconds in (2, 4):
        text = f"wavelength_nm,T\n450,{0.9 - 0.01 * seconds}\n500,{0.9 - 0.01 * seconds}\n"
        files.append(write(tmp_path / f"maPU_{seconds}s.csv", text))
    result = exposures(files, wavelength_nm=[450.0])
    line = result.wavelengths[0].trend_T
    assert line is not None
    assert line.slope_per_s == pytest.approx(-0.01)
    assert line.interval95_slope_per_s is None
    assert any("two exposures" in line for line in result.warnings)


def test_exposures_yield_the_index_if_reflectance_was_measured(tmp_path: Path) -> None:
    """Reflectance and transmittance of lossless slabs of n = 1.48, 1.49 and 1.50 at 2, 4 and 6 s."""
    rows: list[str] = []
    for seconds, n in ((2, 1.48), (4, 1.49), (6, 1.50)):
        r = ((n - 1.0) / (n + 1.0)) ** 2
        rows.extend(f"{seconds},{nm},{(1.0 - r) / (1.0 + r):.12f},{2.0 * r / (1.0 + r):.12f}" for nm in (450, 500))
    path = write(tmp_path / "long.csv", "exposure_s,wavelength_nm,T,R\n" + "\n".join(rows) + "\n")
    result = exposures([path], thickness_um=25.0)
    for row in result.wavelengths:
        assert row.n == pytest.approx([1.48, 1.49, 1.50], abs=1e-6)
        assert row.trend_n is not None
        assert row.trend_n.slope_per_s == pytest.approx(0.005, abs=1e-6)
    without = exposures([path])
    assert np.isnan(without.wavelengths[0].n).all()
    assert any("--thickness-um" in line for line in without.warnings)


@pytest.mark.parametrize(
    ("name", "text", "line"),
    [
        ("a.csv", "wavelength_nm,T\n450,0.9\n500,0.9\n", "contains no exposure"),
        ("2 s.csv", "wavelength_nm,T\n450,0.9\n500,0.9\n", "must be at least 2 for a trend"),
        ("a.csv", "wavelength_nm,x 2 s (%T),x 4 s (%T)\n600,90,80\n601,91,82\n", "450 or 500 or 860 nm"),
    ],
)
def test_exposures_refuse_tables_that_determine_no_trend(tmp_path: Path, name: str, text: str, line: str) -> None:
    with pytest.raises(DataError, match=line):
        exposures([write(tmp_path / name, text)])
    with pytest.raises(DataError, match="within 10 nm"):
        exposures([layers(tmp_path / "layers.csv")], wavelength_nm=[1000.0])


def commands(folder: Path) -> list[list[str]]:
    return [
        ["cutback", str(guides(folder / "guides.csv")), "--launched", "800"],
        [
            *("cure", str(discs(folder / "discs.csv")), "--irradiance-mW-per-cm2", "13", "--layer-um", "25"),
            *("--exposure-s", "2", "--burn-in-layers", "6", "--burn-in-s", "3"),
        ],
        ["penetration", str(resin(folder / "resin.csv")), "--path-um", "93", "--led-nm", "400", "--led-fwhm-nm", "12"],
        ["exposures", str(layers(folder / "layers.csv")), "--wavelength-nm", "450", "--wavelength-nm", "860"],
    ]


@pytest.mark.parametrize("number", range(4))
def test_commands_print_json_and_lines_and_write_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], number: int
) -> None:
    command = commands(tmp_path)[number]
    out, figure = tmp_path / "out.json", tmp_path / "figure.png"
    assert run_command(["resin", *command, "--json", "--out", str(out), "--figure", str(figure)]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    result = plain_json(printed.out)
    written = plain_json(out.read_text(encoding="utf-8"))
    assert written["kind"] == command[0]
    assert written["warnings"] == result["warnings"]
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert run_command(["resin", *command]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert all(line in lines for line in ranked(result["warnings"]))


def test_cutback_compares_the_loss_with_the_error_of_one_layer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_command(["resin", *commands(tmp_path)[0]])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "25 µm" in line]
    assert "0.1 %" in line
    assert "1.7 dB/cm" in line


def test_refuses_an_invalid_file_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write(tmp_path / "bad.csv", "length_mm,power_mW\n20,1\n20,1.1\n")
    assert run_command(["resin", "cutback", str(path), "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1
