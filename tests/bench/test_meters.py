"""Multimeters and oscilloscopes as receivers: simulated SCPI instruments on sockets, from readings to a response."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import h5netcdf
import numpy as np
import pytest

from solen.analysis import study
from solen.bench.clock import WallClock
from solen.bench.drivers import DRIVERS
from solen.bench.live import sampler_of
from solen.bench.meter import PolledMeter, Reading, steady_reading
from solen.bench.multimeter import Multimeters
from solen.bench.oscilloscope import Oscilloscope
from solen.bench.record import record
from solen.bench.rig import Rig, load_rig
from solen.bench.roles import Meter
from solen.errors import BenchError, DataError
from tests.bench.scpi_support import Multimeter, Scope, ScpiDevice, address_of
from tests.bench.stage_support import SENSOR
from tests.bench.wire_support import Served
from tests.bench.zaber_controller_support import ZaberDevice

pytest.importorskip("pyvisa")
PER_DEG = 4000.0


@contextlib.contextmanager
def served(*devices: ScpiDevice) -> Iterator[tuple[str, ...]]:
    with contextlib.ExitStack() as stack:
        yield tuple(address_of(stack.enter_context(Served(device))) for device in devices)


def read_once(meter: Meter) -> Reading:
    """Start a meter, and return its first reading."""
    meter.start()
    try:
        return next_reading(meter)
    finally:
        meter.stop()


def next_reading(meter: Meter) -> Reading:
    due = time.monotonic() + 20.0
    while time.monotonic() < due:
        if readings := meter.read():
            return readings[0]
        time.sleep(0.01)
    raise AssertionError("no reading")


def test_reads_multimeters_simultaneously() -> None:
    right, left = Multimeter(volts=lambda: 1.25), Multimeter(volts=lambda: -2.5e-3)
    with served(right, left) as names:
        clock = WallClock()
        meter = Multimeters(clock, names, query="MEAS:VOLT:DC?", setup=("CONF:VOLT:DC 10",))
        assert isinstance(meter, Meter)
        begin_s = clock.now_s()
        reading = read_once(meter)
        assert begin_s <= reading.sent_s < reading.t_s <= clock.now_s()
        assert reading.on.tolist() == [1.25, -2.5e-3]
        assert np.isnan(reading.off).all()
        assert not reading.clipped.any()
        left.range_V = 1e-3
        overload = read_once(meter)
        assert overload.on[0] == 1.25
        assert np.isnan(overload.on[1])
        assert overload.clipped.tolist() == [False, True]
        meter.close()
    assert right.lines[:5] == ["*IDN?", "*CLS", "CONF:VOLT:DC 10", "SYST:ERR?", "MEAS:VOLT:DC?"]


def test_reports_faults_of_multimeters() -> None:
    device = Multimeter(errors=['-113,"Undefined header"'])
    with served(device) as names:
        with pytest.raises(BenchError, match=r'CONF:LUX.*-113,"Undefined header"; see its programming'):
            Multimeters(WallClock(), names, setup=("CONF:LUX",))
        meter = Multimeters(WallClock(), names, query="FETC?", timeout_s=0.3)
        with pytest.raises(BenchError, match=r"replied 'what\?' to FETC\?.*; .*meter\.ask"):
            read_once(meter)
        meter.close()
    with pytest.raises(BenchError, match=rf"{names[0]}; .*; check address and answer_s"):
        Multimeters(WallClock(), names)
    with pytest.raises(BenchError, match="check address"):
        Multimeters(WallClock(), ("nonsense",))


LIT, DARK, HZ = np.array([1.2, 3.4]), np.array([4.6, 4.5]), 203.0


def receivers(switched: bool) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """Return the voltages of two receivers, which light lowers, and of a sync."""

    def on(time_s: np.ndarray) -> np.ndarray:
        return np.asarray((time_s * HZ % 1.0 < 0.5) | (not switched))

    def wave(index: int) -> Callable[[np.ndarray], np.ndarray]:
        levels = np.array([DARK[index], LIT[index]])
        return lambda time_s: levels[on(time_s).astype(int)]

    return {"1": wave(0), "2": wave(1), "4": lambda time_s: np.where(on(time_s), 3.3, 0.0)}


@pytest.mark.parametrize("manufacturer", ["KEYSIGHT TECHNOLOGIES", "AGILENT TECHNOLOGIES", "RIGOL TECHNOLOGIES"])
@pytest.mark.parametrize("sync", [None, "4"])
def test_oscilloscope_reads_levels(manufacturer: str, sync: str | None) -> None:
    clock = WallClock()
    scope = Scope(manufacturer=manufacturer, clock=clock, waves=receivers(sync is not None))
    with served(scope) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"), setup=(":TIM:RANG 0.03",), sync=sync)
        reading = read_once(meter)
        meter.close()
    step_V = 5.0 / 253
    assert reading.on == pytest.approx(LIT, abs=0.51 * step_V)
    assert not reading.clipped.any()
    if sync is not None:
        assert reading.off == pytest.approx(DARK, abs=0.51 * step_V)
    else:
        assert np.isnan(reading.off).all()


def test_oscilloscope_reports_clipping_and_missing_sync() -> None:
    clock = WallClock()
    scope = Scope(manufacturer="KEYSIGHT", clock=clock, waves=receivers(True), high=4.0)
    with served(scope) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"), sync="4")
        assert read_once(meter).clipped.tolist() == [True, True]
        scope.waves["4"] = lambda time_s: np.zeros(len(time_s))
        with pytest.raises(DataError, match="sync; changes by only 0 V"):
            read_until_error(meter)
        assert meter.losses.unreadable == 5
        meter.close()


def test_refuses_unknown_oscilloscope() -> None:
    clock = WallClock()
    with (
        served(Scope(manufacturer="TEKTRONIX", clock=clock)) as names,
        pytest.raises(BenchError, match="supported are those of KEYSIGHT, RIGOL, AGILENT"),
    ):
        Oscilloscope(clock, names[0], ("1",))


class WaitingScope(Scope):
    """An oscilloscope that never triggers."""

    def query(self, query: str) -> str | bytes:  # noqa: ARG002  the reply is always the same
        return "WAIT"


def test_reports_oscilloscope_that_does_not_trigger() -> None:
    clock = WallClock()
    with served(WaitingScope(manufacturer="RIGOL", clock=clock)) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"), timeout_s=0.3)
        with pytest.raises(BenchError, match=r"acquired nothing within 0\.3 s"):
            read_once(meter)
        meter.close()


def test_oscilloscope_discards_previous_record() -> None:
    clock, begin_s = WallClock(), 0.0
    ramp = {channel: lambda time_s: 0.5 * (time_s - begin_s) for channel in ("1", "2")}
    scope = Scope(manufacturer="RIGOL", clock=clock, waves=ramp, arming=2)
    with served(scope) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"))
        begin_s = clock.now_s()
        meter.start()
        for _ in range(3):
            reading = next_reading(meter)
            record_begin_s = begin_s + reading.on[0] / 0.5 - 0.5 * scope.step_s * scope.points
            assert reading.sent_s - 0.02 <= record_begin_s <= reading.t_s + 0.02
        meter.close()


@pytest.mark.parametrize("attributes", [{"missing_points": 1}, {"points": 1}])
def test_refuses_records_of_different_or_too_small_length(attributes: dict[str, int]) -> None:
    clock = WallClock()
    scope = Scope(manufacturer="KEYSIGHT", clock=clock, waves=receivers(True), **attributes)  # type: ignore[arg-type]
    with served(scope) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"), sync="4")
        with pytest.raises(DataError, match=r"samples by channel = .*equal, and at least 2") as bad:
            read_until_error(meter)
        assert len(str(bad.value).splitlines()) == 1
        meter.close()


@pytest.mark.parametrize("attributes", [{"step_s": 0.0}, {"step_s": math.nan}, {"low": 5.0}])
def test_refuses_preamble_without_steps(attributes: dict[str, float]) -> None:
    clock = WallClock()
    scope = Scope(manufacturer="KEYSIGHT", clock=clock, waves=receivers(False), **attributes)  # type: ignore[arg-type]
    with served(scope) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"))
        with pytest.raises(BenchError, match=r":WAV:PRE\?"):
            read_once(meter)
        meter.close()


class FailingMeter(PolledMeter):
    """A meter that fails after three readings."""

    def measure(self) -> Reading:
        self.losses.unreadable += 1
        if self.losses.unreadable > 3:
            raise ValueError("two\nlines")
        return steady_reading(0.0, 0.0, np.zeros(1), np.zeros(1, bool))

    def release(self) -> None:
        pass


def test_error_of_meter_is_raised_after_its_readings() -> None:
    meter = FailingMeter("a meter", WallClock(), inputs=1, unit="V", switched=False)
    readings: list[Reading] = []
    with pytest.raises(BenchError, match=r"a meter; .*two lines"):
        read_until_error(meter, readings)
    assert len(readings) == 3
    meter.close()


def read_until_error(meter: PolledMeter, readings: list[Reading] | None = None) -> None:
    due = time.monotonic() + 20.0
    meter.start()
    try:
        while time.monotonic() < due:
            new = meter.read()
            if readings is not None:
                readings.extend(new)
            time.sleep(0.01)
    finally:
        meter.stop()


RIG = """
schema = 1
name = "meters"
[stage]
driver = "zaber"
port = "{port}"
steps_per_unit = 4000.0
home = "here"
[meter]
{meter}
[[sensor]]
name = "A"
design = "sensor.toml"
emitter = 1
right = 1
left = 2
"""


STOPS = "schema = 1\nname = 'stops'\ncycles = 2\n" + "".join(
    f"[[step]]\nto_deg = {to}\nvelocity_deg_per_s = 15.0\nhold_s = 0.15\n" for to in (-1.5, -3, 0, 1.5, 3, 0)
)


def record_with(bench: Path, port: str, meter: str) -> Path:
    (bench / "meters.toml").write_text(RIG.format(port=port, meter=meter), encoding="utf-8")
    (bench / "stops.toml").write_text(STOPS, encoding="utf-8")
    run = record(bench / "stops.toml", bench / "meters.toml", bench / "out")
    assert run.outcome == "done"
    assert any("does not switch the emitters" in line for line in run.cautions)
    assert not list((bench / "out").glob("*.journal"))
    return run.path


def slopes_of(path: Path) -> dict[str, float]:
    """Return the slope of each receiver of the sensor in V/deg."""
    receivers = study([path]).to_dict()["sensors"]["A"]["receivers"]
    return {
        side: float(np.polyfit(curve["angle_deg"], np.array(curve["mean_V"], float), 1)[0])
        for side, curve in receivers.items()
    }


def test_multimeters_give_response(bench: Path) -> None:
    clock = WallClock()
    device = ZaberDevice(clock)

    def volts(slope: float) -> Callable[[], float]:
        return lambda: 2.0 + slope * (device.axis.at(clock.now_s()) / PER_DEG)

    meters = [Multimeter(volts=volts(slope), duration_s=0.02) for slope in (0.2, -0.1, 0.05)]
    cell = "[load_cell]\ninput = 3\nN_per_V = 4.0\nzero_V = 2.0"
    with Served(device) as stage, served(*meters) as names:
        path = record_with(bench, stage.url, f"address = {list(names)}\nask = 'READ?'\n{cell}")
    slopes = slopes_of(path)
    assert slopes["right"] == pytest.approx(0.2, rel=0.02)
    assert slopes["left"] == pytest.approx(-0.1, rel=0.02)
    with h5netcdf.File(path, "r") as file:
        assert file.variables["on"].attrs["units"] == "V"
        assert file.attrs["sampler_bound_s"] > 0.0
        assert sorted(file.groups["A"].variables) == [
            "angle_deg", "force_N", "left", "left_clipped", "right", "right_clipped", "time_s",
        ]  # fmt: skip
        angle, force = (file.groups["A"].variables[name][...] for name in ("angle_deg", "force_N"))
        assert np.polyfit(angle, force, 1)[0] == pytest.approx(0.2, rel=0.02)
        time_s, bound_s = file.variables["time_s"][...], file.variables["bound_s"][...]
        assert (np.diff(time_s) > 0).all()
        assert file.attrs["sampler_bound_s"] == pytest.approx(bound_s.mean())


def test_oscilloscope_gives_response(bench: Path) -> None:
    clock = WallClock()
    device = ZaberDevice(clock)

    def wave(slope: float) -> Callable[[np.ndarray], np.ndarray]:
        def volts(time_s: np.ndarray) -> np.ndarray:
            angle_deg = device.axis.at(float(time_s[0])) / PER_DEG
            return np.where(time_s * HZ % 1.0 < 0.5, 2.5 + slope * angle_deg, 4.6)

        return volts

    waves = {"1": wave(0.3), "3": wave(-0.3), "4": receivers(True)["4"]}
    scope = Scope(manufacturer="KEYSIGHT", clock=clock, waves=waves, duration_s=0.02)
    with Served(device) as stage, served(scope) as names:
        keys = f"driver = 'oscilloscope'\nsync = '4'\nchannels = ['1', '3']\naddress = '{names[0]}'"
        path = record_with(bench, stage.url, keys)
    slopes = slopes_of(path)
    assert slopes["right"] == pytest.approx(0.3, rel=0.05)
    assert slopes["left"] == pytest.approx(-0.3, rel=0.05)
    with h5netcdf.File(path, "r") as file:
        ambient = file.groups["A"].variables["right_ambient"][...]
    assert ambient == pytest.approx(np.full(len(ambient), 4.6), abs=0.02)


@pytest.mark.parametrize(
    ("meter", "message"),
    [
        ({"address": "a"}, "meter.address = 'a'; must list 2"),
        ({"address": ["a", "b"], "driver": "dmm"}, "driver = 'dmm'; must be one of multimeter, oscilloscope"),
        ({"address": ["a", "b"], "sync": "4"}, "sync = '4'; is not used by the driver multimeter"),
        ({"address": "a", "driver": "oscilloscope", "unit": "A"}, "unit = 'A'; is not used by the driver oscillo"),
        ({"address": "a", "driver": "oscilloscope", "settle_us": 1.0}, "settle_us = 1.0; is not used without a sync"),
        ({"address": "a", "driver": "oscilloscope", "channels": ["1"]}, "meter.channels = '1'; must list 2"),
    ],
)
def test_refuses_meter_that_cannot_read_sensors(meter: dict[str, object], message: str) -> None:
    with pytest.raises(BenchError, match=message):
        Rig(name="meters", stage={"driver": "hand"}, meter=meter, sensor=(SENSOR,))


def test_meter_cannot_be_combined_or_checked(tmp_path: Path) -> None:
    two = {"address": ["a", "b"]}
    with pytest.raises(BenchError, match=r"meter; cannot be combined with \[board\]"):
        Rig(name="x", stage={"driver": "hand"}, meter=two, board={"driver": "serial", "port": "x"}, sensor=(SENSOR,))
    with pytest.raises(BenchError, match="cannot alternate emitters"):
        Rig(name="x", stage={"driver": "hand"}, meter=two, sensor=(SENSOR | {"emitter": 2},))
    rig = Rig(name="x", stage={"driver": "hand"}, meter=two, sensor=(SENSOR,))
    assert not rig.simulated
    assert DRIVERS[rig.sampler.driver].role == "meter"
    with pytest.raises(BenchError, match="does not switch emitters"), sampler_of(rig, tmp_path, WallClock()):
        pass
    (tmp_path / "rig.toml").write_text("schema = 1\nname = 'x'\n[meter]\n", encoding="utf-8")
    with pytest.raises(BenchError, match=r"meter\.address"):
        load_rig(tmp_path / "rig.toml")
