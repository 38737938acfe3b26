"""Multimeters and oscilloscopes as receivers: simulated ones that speak SCPI behind a socket, to a response."""

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
        yield tuple(address_of(stack.enter_context(Served(one))) for one in devices)


def first(meter: Meter) -> Reading:
    """The first reading, of one that is started for it."""
    meter.start()
    try:
        return waited(meter)
    finally:
        meter.stop()


def waited(meter: Meter) -> Reading:
    due = time.monotonic() + 20.0
    while time.monotonic() < due:
        if readings := meter.read():
            return readings[0]
        time.sleep(0.01)
    raise AssertionError("no reading")


def test_multimeters_are_asked_together_and_heard_one_after_the_other() -> None:
    right, left = Multimeter(volts=lambda: 1.25), Multimeter(volts=lambda: -2.5e-3)
    with served(right, left) as names:
        clock = WallClock()
        meter = Multimeters(clock, names, query="MEAS:VOLT:DC?", setup=("CONF:VOLT:DC 10",))
        assert isinstance(meter, Meter)
        before_s = clock.now_s()
        reading = first(meter)
        assert before_s <= reading.sent_s < reading.t_s <= clock.now_s()
        assert reading.on.tolist() == [1.25, -2.5e-3]
        assert np.isnan(reading.off).all()
        assert not reading.clipped.any()
        left.range_V = 1e-3
        beyond = first(meter)
        assert beyond.on[0] == 1.25
        assert np.isnan(beyond.on[1])
        assert beyond.clipped.tolist() == [False, True]
        meter.close()
    assert right.said[:5] == ["*IDN?", "*CLS", "CONF:VOLT:DC 10", "SYST:ERR?", "MEAS:VOLT:DC?"]


def test_faults_of_multimeters_end_in_a_line() -> None:
    device = Multimeter(errors=['-113,"Undefined header"'])
    with served(device) as names:
        with pytest.raises(BenchError, match=r'CONF:LUX: -113,"Undefined header"; see its programming'):
            Multimeters(WallClock(), names, setup=("CONF:LUX",))
        meter = Multimeters(WallClock(), names, query="FETC?", timeout_s=0.3)
        with pytest.raises(BenchError, match=r"answered 'what\?' to FETC\?; .*meter\.ask"):
            first(meter)
        meter.close()
    with pytest.raises(BenchError, match=rf"{names[0]}; .*; check its name, its cable"):
        Multimeters(WallClock(), names)
    with pytest.raises(BenchError, match="check its name"):
        Multimeters(WallClock(), ("nonsense",))


LIT, DARK, HZ = np.array([1.2, 3.4]), np.array([4.6, 4.5]), 203.0


def receivers(switched: bool) -> dict[str, Callable[[np.ndarray], np.ndarray]]:
    """Two receivers and a sync; light pulls them down."""

    def on(time_s: np.ndarray) -> np.ndarray:
        return np.asarray((time_s * HZ % 1.0 < 0.5) | (not switched))

    def wave(place: int) -> Callable[[np.ndarray], np.ndarray]:
        levels = np.array([DARK[place], LIT[place]])
        return lambda time_s: levels[on(time_s).astype(int)]

    return {"1": wave(0), "2": wave(1), "4": lambda time_s: np.where(on(time_s), 3.3, 0.0)}


@pytest.mark.parametrize("maker", ["KEYSIGHT TECHNOLOGIES", "AGILENT TECHNOLOGIES", "RIGOL TECHNOLOGIES"])
@pytest.mark.parametrize("more", [{}, {"sync": "4"}])
def test_a_record_of_an_oscilloscope_becomes_a_reading(manufacturer: str, more: dict[str, object]) -> None:
    clock = WallClock()
    scope = Scope(manufacturer=manufacturer, clock=clock, waves=receivers(bool(more)))
    with served(scope) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"), setup=(":TIM:RANG 0.03",), **more)  # type: ignore[arg-type]
        reading = first(meter)
        meter.close()
    step = 5.0 / 253
    assert reading.on == pytest.approx(LIT, abs=0.51 * step)
    assert not reading.clipped.any()
    if more:
        assert reading.off == pytest.approx(DARK, abs=0.51 * step)
    else:
        assert np.isnan(reading.off).all()


def test_an_oscilloscope_that_clips_or_does_not_trigger_or_shows_nothing() -> None:
    clock = WallClock()
    scope = Scope(manufacturer="KEYSIGHT", clock=clock, waves=receivers(True), high=4.0)
    with served(scope) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"), sync="4")
        assert first(meter).clipped.tolist() == [True, True]
        scope.waves["4"] = lambda time_s: np.zeros(len(time_s))
        with pytest.raises(DataError, match="sync; changes by only 0 V"):
            first_fault(meter)
        assert meter.losses.unreadable == 5
        meter.close()
        other = Scope(manufacturer="TEKTRONIX", clock=clock)
        with (
            served(other) as more,
            pytest.raises(BenchError, match="supported are those of KEYSIGHT, RIGOL, AGILENT; use"),
        ):
            Oscilloscope(clock, more[0], ("1",))
    deaf = Scope(manufacturer="RIGOL", clock=clock, waves=receivers(True))
    with served(deaf) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"), timeout_s=0.3)
        deaf._obey = lambda line: b"WAIT\n" if line.endswith("?") else b""  # type: ignore[method-assign]
        with pytest.raises(BenchError, match=r"acquires nothing within 0\.3 s; does it trigger"):
            first(meter)
        meter.close()


def test_a_record_of_before_is_no_reading() -> None:
    clock, since_s = WallClock(), 0.0
    ramp = {one: lambda time_s: 0.5 * (time_s - since_s) for one in ("1", "2")}
    scope = Scope(manufacturer="RIGOL", clock=clock, waves=ramp, arming=2)
    with served(scope) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"))
        since_s = clock.now_s()
        meter.start()
        for _ in range(3):
            reading = waited(meter)
            length_s = scope.step_s * scope.points
            assert reading.sent_s <= reading.on[0] / 0.5 + since_s - 0.5 * length_s + 0.02 <= reading.t_s + 0.04
        meter.close()


@pytest.mark.parametrize("more", [{"short": 1}, {"points": 1}])
def test_records_that_are_not_alike_are_no_readings(more: dict[str, int]) -> None:
    clock = WallClock()
    scope = Scope(manufacturer="KEYSIGHT", clock=clock, waves=receivers(True), **more)  # type: ignore[arg-type]  # its numbers
    with served(scope) as names:
        meter = Oscilloscope(clock, names[0], ("1", "2"), sync="4")
        with pytest.raises(DataError, match="records of its channels") as told:
            first_fault(meter)
        assert len(str(told.value).splitlines()) == 1
        meter.close()


@pytest.mark.parametrize("more", [{"step_s": 0.0}, {"step_s": math.nan}, {"low": 5.0}])
def test_a_preamble_without_steps_of_time_or_volts_ends_in_a_line(more: dict[str, float]) -> None:
    scope = Scope(manufacturer="KEYSIGHT", clock=WallClock(), waves=receivers(False), **more)  # type: ignore[arg-type]  # its numbers
    with served(scope) as names:
        meter = Oscilloscope(scope.clock, names[0], ("1", "2"))
        with pytest.raises(BenchError, match=r":WAV:PRE\?"):
            first(meter)
        meter.close()


class Breaking(PolledMeter):
    """A meter that reads three times and breaks."""

    def measure(self) -> Reading:
        self.losses.unreadable += 1
        if self.losses.unreadable > 3:
            raise ValueError("two\nlines")
        return steady_reading(0.0, 0.0, np.zeros(1), np.zeros(1, bool))

    def release(self) -> None:
        pass


def test_whatever_breaks_a_meter_ends_the_run_after_its_readings() -> None:
    meter = Breaking("a meter", WallClock(), inputs=1, unit="V", switched=False)
    got: list[Reading] = []

    def drained() -> None:
        due = time.monotonic() + 20.0
        while time.monotonic() < due:
            got.extend(meter.read())

    meter.start()
    with pytest.raises(BenchError, match=r"a meter; .*two lines"):
        drained()
    assert len(got) == 3
    meter.close()


def first_fault(meter: Oscilloscope) -> None:
    meter.start()
    try:
        while True:
            meter.read()
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
    f"[[step]]\nto_deg = {to}\nvelocity_deg_per_s = 15.0\nhold_s = 0.15\n" for to in (-1.5, -3, -1.5, 0, 1.5, 3, 1.5, 0)
)


def recorded(bench: Path, port: str, meter: str, protocol: str) -> Path:
    (bench / "meters.toml").write_text(RIG.format(port=port, meter=meter), encoding="utf-8")
    (bench / "stops.toml").write_text(STOPS, encoding="utf-8")
    run = record(bench / f"{protocol}.toml", bench / "meters.toml", bench / "out")
    assert run.outcome == "done"
    assert any("not switched by solen" in one for one in run.cautions)
    assert not list((bench / "out").glob("*.journal"))
    return run.path


def response(path: Path) -> dict[str, float]:
    found = study([path]).to_dict()["sensors"]["A"]["receivers"]
    return {
        side: float(np.polyfit(np.array(found[side]["angle_deg"]), np.array(found[side]["mean_V"], float), 1)[0])
        for side in ("right", "left")
    }


def test_from_multimeters_to_a_response(bench: Path) -> None:
    clock = WallClock()
    device = ZaberDevice(clock)

    def volts(slope: float) -> Callable[[], float]:
        return lambda: 2.0 + slope * (device.axis.at(clock.now_s()) / PER_DEG)

    meters = [Multimeter(volts=volts(slope)) for slope in (0.2, -0.1, 0.05)]
    cell = "[load_cell]\ninput = 3\nN_per_V = 4.0\nzero_V = 2.0"
    with Served(device) as stage, served(*meters) as names:
        path = recorded(bench, stage.url, f"address = {list(names)}\nask = 'READ?'\n{cell}", "protocol")
    slopes = response(path)
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


def test_from_an_oscilloscope_to_a_response(bench: Path) -> None:
    clock = WallClock()
    device = ZaberDevice(clock)

    def wave(slope: float) -> Callable[[np.ndarray], np.ndarray]:
        def volts(time_s: np.ndarray) -> np.ndarray:
            angle = device.axis.at(float(time_s[0])) / PER_DEG
            return np.where(time_s * HZ % 1.0 < 0.5, 2.5 + slope * angle, 4.6)

        return volts

    scope = Scope(
        manufacturer="KEYSIGHT", clock=clock, waves={"1": wave(0.3), "3": wave(-0.3), "4": receivers(True)["4"]}
    )
    more = "driver = 'oscilloscope'\nsync = '4'\nchannels = ['1', '3']\naddress = "
    with Served(device) as stage, served(scope) as names:
        path = recorded(bench, stage.url, f"{more}'{names[0]}'", "stops")
    slopes = response(path)
    assert slopes["right"] == pytest.approx(0.3, rel=0.05)
    assert slopes["left"] == pytest.approx(-0.3, rel=0.05)
    with h5netcdf.File(path, "r") as file:
        ambient = file.groups["A"].variables["right_ambient"][...]
    assert ambient == pytest.approx(np.full(len(ambient), 4.6), abs=0.02)


@pytest.mark.parametrize(
    ("meter", "told"),
    [
        ({"address": "a"}, "meter.address; names 1; the sensors use 2 inputs"),
        ({"address": ["a", "b"], "driver": "dmm"}, "driver = 'dmm'; must be one of multimeter, oscilloscope"),
        ({"address": ["a", "b"], "sync": "4"}, "sync = '4'; is not used by the driver multimeter"),
        ({"address": "a", "driver": "oscilloscope", "unit": "A"}, "unit = 'A'; is not used by the driver oscillo"),
        ({"address": "a", "driver": "oscilloscope", "settle_us": 1.0}, "settle_us = 1.0; is not used without a sync"),
        ({"address": "a", "driver": "oscilloscope", "channels": ["1"]}, "meter.channels; names 1"),
    ],
)
def test_a_rig_whose_meter_cannot_read_its_sensors_is_refused(meter: dict[str, object], told: str) -> None:
    with pytest.raises(BenchError, match=told):
        Rig(name="meters", stage={"driver": "hand"}, meter=meter, sensor=(SENSOR,))


def test_a_meter_stands_alone_and_tells_nothing_of_wires(tmp_path: Path) -> None:
    two = {"address": ["a", "b"]}
    with pytest.raises(BenchError, match=r"meter; cannot be combined with \[board\]"):
        Rig(name="x", stage={"driver": "hand"}, meter=two, board={"driver": "serial", "port": "x"}, sensor=(SENSOR,))
    with pytest.raises(BenchError, match="cannot switch emitters"):
        Rig(name="x", stage={"driver": "hand"}, meter=two, sensor=(SENSOR | {"emitter": 2},))
    rig = Rig(name="x", stage={"driver": "hand"}, meter=two, sensor=(SENSOR,))
    assert not rig.simulated
    assert DRIVERS[rig.sampler.driver].role == "meter"
    with pytest.raises(BenchError, match="switches no emitter"), sampler_of(rig, tmp_path, WallClock()):
        pass
    (tmp_path / "rig.toml").write_text("schema = 1\nname = 'x'\n[meter]\n", encoding="utf-8")
    with pytest.raises(BenchError, match=r"meter\.address"):
        load_rig(tmp_path / "rig.toml")
