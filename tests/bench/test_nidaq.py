"""The driver of NI-DAQmx devices: the C calls that `nidaqmx` makes, and faults of the device and of its driver."""

import importlib
import tomllib
from collections.abc import Callable
from pathlib import Path

import h5netcdf
import numpy as np
import pytest

from solen.bench.clock import SimulatedClock
from solen.bench.daq import Setup, volts_of
from solen.bench.journal import read_journal
from solen.bench.netcdf import RecordedRun, write_recording
from solen.bench.nidaq import NiDaq
from solen.bench.protocol import load_protocol
from solen.bench.roles import Daq
from solen.bench.run import Instruments, Tick, begin
from solen.bench.run import run as run_protocol
from solen.bench.sampling import DaqSampling
from solen.bench.simulated.stage import SimulatedStage
from solen.errors import BenchError
from tests.bench.daqmx_support import Library, SimulatedRig

CALLS_OF_OPENING = """
CreateTask('', &)
CreateDOChan(1, 'Dev1/port1/line0', '', 1)
WriteDigitalLines(1, 1, True, 1, 0, [0], &, None)
ClearTask(1)
CreateTask('', &)
CreateCOPulseChanFreq(2, 'Dev1/ctr0', '', 10373, 10214, 0, 200, 0.5)
SetChanAttribute(2, 'Dev1/ctr0', 6369, '/Dev1/PFI4')
CfgImplicitTiming(2, 10123, 1000)
CfgDigEdgeStartTrig(2, '/Dev1/ai/StartTrigger', 10280)
TaskControl(2, 3)
GetChanAttribute(2, 'Dev1/ctr0', 4472, &)
CreateTask('', &)
CreateAIVoltageChan(3, 'Dev1/ai0', '', 10083, -10, 10, 10348, '')
CreateAIVoltageChan(3, 'Dev1/ai1', '', 10083, -10, 10, 10348, '')
CfgSampClkTiming(3, '', 10000, 10280, 10123, 100000)
SetBufferAttribute(3, 6252, 100000)
TaskControl(3, 3)
GetTimingAttribute(3, 4932, &)
GetTimingAttribute(3, 6216, &)
GetChanAttribute(3, 'Dev1/ai0', 6448, &, 0)
GetChanAttribute(3, 'Dev1/ai0', 6448, &, 4)
GetChanAttribute(3, 'Dev1/ai1', 6448, &, 0)
GetChanAttribute(3, 'Dev1/ai1', 6448, &, 4)
GetChanAttribute(3, 'Dev1/ai0', 6166, &)
GetChanAttribute(3, 'Dev1/ai0', 6165, &)
GetChanAttribute(3, 'Dev1/ai1', 6166, &)
GetChanAttribute(3, 'Dev1/ai1', 6165, &)
GetChanAttribute(3, 'Dev1/ai0', 5989, &)
GetChanAttribute(3, 'Dev1/ai1', 5989, &)
"""
CALLS_OF_READING = """
StartTask(2)
StartTask(3)
GetReadAttribute(3, 4643, &)
ReadBinaryI16(3, 3, 1, 0, int16[6], 6, &, None)
IsTaskDone(2, &)
ClearTask(2)
ClearTask(3)
CreateTask('', &)
CreateDOChan(4, 'Dev1/port1/line0', '', 1)
WriteDigitalLines(4, 1, True, 1, 0, [0], &, None)
ClearTask(4)
"""


@pytest.fixture
def library(monkeypatch: pytest.MonkeyPatch) -> Library:
    """Simulated NI-DAQmx with a USB-6218."""
    return with_device("USB-6218", monkeypatch)


def with_device(kind: str, monkeypatch: pytest.MonkeyPatch) -> Library:
    library = Library(kind)
    load_library(library, monkeypatch)
    return library


def load_library(library: Library, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make nidaqmx use a simulated library."""
    _lib = importlib.import_module("nidaqmx._lib")
    for name in ("_windll", "_cdll"):
        monkeypatch.setattr(_lib.lib_importer, name, _lib.DaqFunctionImporter(library))
    monkeypatch.setattr(_lib.lib_importer, "_encoding", "utf-8")


def setup(**settings: object) -> Setup:
    defaults = {
        "channels": ("ai0", "ai1"), "synced": False, "rate_hz": 10_000.0, "emitters": 1, "switch_hz": 200.0,
        "switching": "counter", "model": "USB-6218",
    }  # fmt: skip
    return Setup(**defaults | settings)  # type: ignore[arg-type]  # the values have several types


def test_calls_from_opening_to_closing(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup())
    assert isinstance(daq, Daq)
    assert library.calls == CALLS_OF_OPENING.split("\n")[1:-1]
    library.calls.clear()
    daq.start()
    assert library.running == {2}
    library.sampled = np.array([[1, -2, 3], [32_767, -32_768, 6]], np.int16)
    samples = daq.read()
    assert (samples.segment, samples.first) == (0, 0)
    assert samples.counts.tolist() == [[1, 32_767], [-2, -32_768], [3, 6]]
    daq.stop()
    daq.close()  # causes no further calls
    assert library.calls == CALLS_OF_READING.split("\n")[1:-1]
    assert library.dark
    assert daq.coefficients.shape == (2, 4)
    assert tuple(daq.coefficients[1]) == library.coefficients
    assert daq.rate_hz == 10_000.0
    assert daq.convert_s == pytest.approx(14e-6, rel=1e-4)


def test_two_counters_alternate(library: Library) -> None:
    NiDaq(SimulatedClock(), "Dev1", setup(emitters=2)).close()
    assert [call for call in library.calls if call.startswith("CreateCO")] == [
        "CreateCOPulseChanFreq(3, 'Dev1/ctr0', '', 10373, 10214, 0, 200, 0.25)",
        "CreateCOPulseChanFreq(4, 'Dev1/ctr1', '', 10373, 10214, 0.0025, 200, 0.25)",
    ]


def test_line_enables_external_switching(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup(switching="external", enable="port1/line7", terminal="differential"))
    assert "10106, -10, 10, 10348" in next(call for call in library.calls if "AIVoltage" in call)
    assert library.lines["Dev1/port1/line7"] is False
    daq.start()
    assert library.lines["Dev1/port1/line7"] is True
    daq.stop()
    assert library.lines["Dev1/port1/line7"] is False


def test_line_for_external_watchdog_toggles_with_each_reading(library: Library) -> None:
    unwatched = NiDaq(SimulatedClock(), "Dev1", setup())
    assert "has no watchdog" in (unwatched.no_watchdog or "")
    assert "daq.alive" in (unwatched.no_watchdog or "")
    unwatched.close()
    daq = NiDaq(SimulatedClock(), "Dev1", setup(alive="port1/line6"))
    assert daq.no_watchdog is None
    daq.start()
    levels = []
    for _ in range(4):
        daq.read()
        levels.append(library.lines["Dev1/port1/line6"])
    assert levels == [True, False, True, False]
    daq.read()
    daq.stop()
    assert library.lines["Dev1/port1/line6"] is False


def test_rate_is_that_of_device(library: Library) -> None:
    assert library.dark
    daq = NiDaq(SimulatedClock(), "Dev1", setup(rate_hz=13_000.0))
    assert daq.rate_hz == pytest.approx(20e6 / 1538)
    daq.close()


def test_restarts_after_overrun_and_counts_lost_samples(library: Library) -> None:
    clock = SimulatedClock()
    daq = NiDaq(clock, "Dev1", setup())
    sampling = DaqSampling(daq)
    daq.start()
    library.sampled = np.zeros((2, 70), np.int16)
    assert len(sampling.read().rows) == 1  # a frame is a period of 50 samples; 20 remain
    clock.sleep(12.0)
    library.faults["DAQmxReadBinaryI16"] = [-200279]
    library.sampled = np.zeros((2, 100), np.int16)
    library.calls.clear()
    block = sampling.read()
    assert block.last is None
    assert block.notices == (
        "USB-6218 Dev1: samples were overwritten before the program read them; "
        "about 119930 samples of each channel are lost",
    )
    assert library.calls[2:] == ["StopTask(2)", "StopTask(3)", "StartTask(2)", "StartTask(3)"]
    library.sampled = np.ones((2, 100), np.int16)
    rows = sampling.read().rows
    assert (rows["stretch"].tolist(), rows["number"].tolist()) == ([1, 1], [0, 50])
    assert rows["counts"].min() == 1  # the 20 samples from before the gap are discarded
    assert vars(daq.losses) == {"samples": 119_930, "overruns": 1}
    daq.close()


def test_repeated_overruns_end_run(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup())
    daq.start()
    library.faults["DAQmxGetReadAttribute"] = [-200361] * 3
    daq.read()
    daq.read()
    with pytest.raises(BenchError, match=r"3 times in 10 s; .*daq\.rate_hz") as bad:
        daq.read()
    assert len(str(bad.value).splitlines()) == 1
    assert library.dark


@pytest.mark.parametrize(
    ("function", "code", "message"),
    [
        ("DAQmxTaskControl", -50103, r"is in use by another program or task \(NI-DAQmx error -50103\); close that"),
        ("DAQmxCreateAIVoltageChan", -200170, r"has no such channel or line .*; .*\[daq\]"),
        ("DAQmxStartTask", -88709, r"was unplugged or reset \(NI-DAQmx error -88709\); check its cable"),
        ("DAQmxReadBinaryI16", -88709, r"was unplugged or reset \(NI-DAQmx error -88709\); check its cable"),
        ("DAQmxGetReadAttribute", -200999, r"cannot read: An unknown error. \(NI-DAQmx error -200999\)"),
        ("DAQmxWriteDigitalLines", -50103, r"is in use by another program"),
        ("DAQmxCreateTask", -50103, r"is in use by another program"),
    ],
)
@pytest.mark.parametrize("call", [0, 1])
def test_fault_switches_emitters_off(library: Library, function: str, code: int, message: str, call: int) -> None:
    library.faults[function] = [0] * call + [code]

    def read_twice() -> None:
        daq = NiDaq(SimulatedClock(), "Dev1", setup(enable="port1/line7"))
        daq.start()
        for _ in range(2):
            library.sampled = np.zeros((2, 5), np.int16)
            daq.read()

    with pytest.raises(BenchError, match=message) as bad:
        read_twice()
    assert len(str(bad.value).splitlines()) == 1
    assert library.dark


def test_end_of_switching_ends_run(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup(enable="port1/line7"))
    daq.start()
    daq.read()
    library.running.clear()
    with pytest.raises(BenchError, match="emitters"):
        daq.read()
    assert library.dark
    daq.start()
    library.faults["DAQmxIsTaskDone"] = [-88709]
    with pytest.raises(BenchError, match="-88709"):
        daq.read()
    assert library.dark


@pytest.mark.parametrize(("faults", "ends"), [([-88709], True), ([0, -200279], False)])
def test_restart_ignores_only_overrun_of_inputs(library: Library, faults: list[int], ends: bool) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup())
    daq.start()
    library.faults |= {"DAQmxGetReadAttribute": [-200361], "DAQmxStopTask": faults}
    if not ends:
        assert daq.read().segment == 1
        daq.close()
    else:
        with pytest.raises(BenchError, match="-88709"):
            daq.read()
    assert library.dark


def test_reports_line_that_cannot_be_set_low(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup())
    daq.start()
    library.faults["DAQmxWriteDigitalLines"] = [-88709]
    with pytest.raises(BenchError, match=r"lines .* emitters .*; switch their supply off"):
        daq.stop()
    assert not library.tasks
    daq.close()  # tries again
    assert library.dark


def test_sets_other_lines_low_after_failure_of_one(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup(enable="port1/line7"))
    daq.start()
    library.lines["Dev1/port1/line0"] = True
    library.faults["DAQmxWriteDigitalLines"] = [0, -88709]
    with pytest.raises(BenchError, match="unplugged"):
        daq.stop()
    assert library.lines == {"Dev1/port1/line0": True, "Dev1/port1/line7": False}
    library.faults["DAQmxWriteDigitalLines"] = [-88709] * 2
    with pytest.raises(BenchError, match="switch their supply off"):
        daq.close()
    daq.close()
    assert library.dark


def test_refuses_missing_or_other_device(library: Library) -> None:
    with pytest.raises(BenchError, match=r"device Dev9; .*Dev1, Dev2"):
        NiDaq(SimulatedClock(), "Dev9", setup())
    with pytest.raises(BenchError, match=r"device Dev2; .*USB-6009.*USB-6218"):
        NiDaq(SimulatedClock(), "Dev2", setup())
    library.missing.add("DAQmxCfgImplicitTiming")
    with pytest.raises(BenchError, match=r"NI-DAQmx; .*too old.*ni\.com"):
        NiDaq(SimulatedClock(), "Dev1", setup())
    assert library.dark


def test_reports_missing_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    _lib = importlib.import_module("nidaqmx._lib")

    def import_library() -> None:
        raise _lib.DaqNotFoundError(_lib._DAQ_NOT_FOUND_MESSAGE)

    monkeypatch.setattr(_lib.lib_importer, "_windll", None)
    monkeypatch.setattr(_lib.lib_importer, "_cdll", None)
    monkeypatch.setattr(_lib.lib_importer, "_import_lib", import_library)
    with pytest.raises(BenchError, match=r"NI-DAQmx; .*ni\.com"):
        NiDaq(SimulatedClock(), "Dev1", setup())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rate_hz": 130_000.0}, r"daq\.rate_hz = 130000\.0; .*at most 250000; specify 125000 or less"),
        ({"rate_hz": 800.0}, r"daq\.rate_hz = 800\.0; gives 1\.8 samples .* 2500 µs after 300 µs of settling; 2 are"),
        ({"channels": ("ai0", "ai8"), "terminal": "differential"}, "channels = 'ai8'; .* differential inputs"),
        ({"channels": ("ai0", "ai32")}, "'ai32'; must be one of the rse inputs of USB-6218, ai0 to ai31"),
        ({"channels": ("ai0", "ai0")}, "'ai0, ai0'; must not contain an input twice"),
        ({"range_v": 3.0}, r"range_v = 3\.0; .*USB-6218: ±0\.2, ±1, ±5, ±10 V"),
        ({"emitters": 3}, "USB-6218 .* has 2 counters that generate pulses; switch the emitters externally"),
        ({"emitters": 2, "switching": "external"}, "sync; is required with 2 alternating emitters"),
        ({"enable": "port0/line0"}, "enable = 'port0/line0'; must be a static output .*port1/line0 to port1/line7"),
        ({"alive": "port0/line0"}, r"daq\.alive = 'port0/line0'; must be a static output"),
        ({"enable": "port1/line7", "alive": "port1/line7"}, r"daq\.alive = 'port1/line7'; .*daq\.enable"),
        ({"enable": "port1/line0"}, "a counter switches an emitter"),
    ],
)
def test_refuses_unsupported_setup_of_known_model(library: Library, settings: dict[str, object], message: str) -> None:
    with pytest.raises(BenchError, match=message):
        setup(**settings)
    assert library.calls == []


# other devices

EXTERNAL = {"switching": "external", "model": ""}


@pytest.mark.parametrize(
    ("kind", "settings", "convert_us"),
    [
        ("USB-6001", {"rate_hz": 5_000.0}, 100.0),
        ("USB-6009", {"terminal": "differential", "range_v": 5.0}, 50.0),
        ("USB-6211", {"terminal": "nrse", "switching": "counter", "emitters": 2, "alive": "port1/line3"}, 14.0),
        ("USB-6218", {"channels": ("ai31", "ai0"), "rate_hz": 125_000.0}, 14.0),
        ("myDAQ", {"terminal": "differential", "range_v": 2.0, "switching": "counter", "rate_hz": 100_000.0}, 14.0),
        ("USB-6356", {"terminal": "differential", "switching": "counter", "emitters": 4, "rate_hz": 1.25e6}, 0.0),
    ],
)
def test_queries_capabilities_of_device(
    kind: str, settings: dict[str, object], convert_us: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = with_device(kind, monkeypatch)
    daq = NiDaq(SimulatedClock(), "Dev1", setup(**EXTERNAL | settings))
    assert daq.setup.model == library.device.product
    assert daq.name == f"{library.device.product} Dev1"
    assert 1e6 * daq.convert_s == pytest.approx(convert_us, rel=1e-4)
    daq.start()
    library.sampled = np.zeros((2, 5), np.int16)
    first, second = daq.read().notices, daq.read().notices
    assert (len(first), len(second)) == (0 if library.device.reports_conversion else 1, 0)
    daq.close()
    assert library.dark
    if kind == "USB-6009":
        assert "50 µs" in first[0]
        assert "20.8 µs" in first[0]
    if kind in {"myDAQ", "USB-6356"}:  # the terminals of its counters are not documented
        assert not [call for call in library.calls if call.startswith(("SetChan", "WriteDigital"))]


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        ("USB-6001", {"rate_hz": 15e3}, "at most 20000; specify 10000 or less"),
        ("USB-6001", {"range_v": 5.0}, "must be a range of USB-6001: ±10 V"),
        ("USB-6001", {"terminal": "nrse"}, "must be a wiring of USB-6001: rse, differential"),
        (
            "USB-6009",
            {"switching": "counter"},
            "USB-6009 .*: it has no counters that generate pulses; switch the emitters externally",
        ),
        (
            "USB-6009",
            {"channels": ("ai0", "ai4"), "terminal": "differential"},
            "'ai4'; must be one of .* USB-6009, ai0 to ai3",
        ),
        ("USB-6009", {"enable": "port2/line0"}, "static output of USB-6009, port0/line0 to port1/line3"),
        ("USB-6211", {"switching": "counter", "enable": "port1/line0"}, "a counter switches"),
        ("myDAQ", {}, "'rse'; must be a wiring of myDAQ: differential"),
        ("myDAQ", {"terminal": "differential", "range_v": 5.0}, r"range_v = 5\.0; must be a range of myDAQ: ±2, ±10 V"),
        (
            "myDAQ",
            {"terminal": "differential", "range_v": 2.0, "switching": "counter", "emitters": 2},
            "myDAQ .*: it has 1 counter that generates pulses",
        ),
        ("USB-6356", {"terminal": "differential", "rate_hz": 2e6}, "input of USB-6356, 1250000 samples"),
        (
            "USB-6356",
            {"terminal": "differential", "switching": "counter", "emitters": 5},
            "has 4 counters that generate pulses; set switching = .lines.",
        ),
        ("USB-6289", {}, "has an ADC of 18 bits; at most 16 can be stored"),
        ("USB-6289", {"switching": "counter", "emitters": 3}, "USB-6289 .* has 2 counters"),
        ("USB-6501", {}, "USB-6501 has no analog inputs"),
    ],
)
def test_refuses_what_device_does_not_support(
    kind: str, settings: dict[str, object], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = with_device(kind, monkeypatch)
    with pytest.raises(BenchError, match=message) as bad:
        NiDaq(SimulatedClock(), "Dev1", setup(**EXTERNAL | settings))
    assert len(str(bad.value).splitlines()) == 1
    assert library.dark
    assert not library.lines


# complete runs

PROTOCOL = "schema = 1\nname = 'there and back'\ncycles = 2\nrest_s = 0.2\n" + "".join(
    f"[[step]]\nto_deg = {to}\nvelocity_deg_per_s = 15.0\nhold_s = 0.3\n" for to in (-3.0, 0.0)
)
HEADER = {
    "solen": "0", "simulated": False, "begun_utc": "2026-01-01T00:00:00+00:00", "protocol_name": "there and back",
    "rig_name": "a rig", "zero": 0.0, "lever_mm": None, "protocol": tomllib.loads(PROTOCOL.partition("\n")[2]),
    "sensors": [{"name": "A", "design": "a.toml", "lens": True, "emitter": 1, "right": 1, "left": 2}],
}  # fmt: skip


class DriverRun:
    """A run of the real driver on a simulated device."""

    def __init__(
        self, folder: Path, monkeypatch: pytest.MonkeyPatch, kind: str = "USB-6218", **settings: object
    ) -> None:
        self.clock, self.folder, self.setup = SimulatedClock(), folder, setup(**settings)
        self.library = SimulatedRig(self.clock, on=(1000, -2000), off=(20_000, 25_000), kind=kind)
        load_library(self.library, monkeypatch)
        (folder / "protocol.toml").write_text(PROTOCOL, encoding="utf-8")

    def run(self, watch: Callable[[Tick], None] | None = None) -> None:
        daq = NiDaq(self.clock, "Dev1", self.setup)
        instruments = Instruments(SimulatedStage(self.clock), daq, self.clock)
        with begin(self.folder / "run.journal", instruments, HEADER) as journal:
            run_protocol(load_protocol(self.folder / "protocol.toml"), instruments, journal, watch=watch)
        daq.close()

    def close(self) -> tuple[RecordedRun, dict[str, np.ndarray]]:
        """Write the recording, and return it with the readings of its sensor."""
        recorded = write_recording(read_journal(self.folder / "run.journal"), self.folder / "run.nc")
        with h5netcdf.File(self.folder / "run.nc", "r") as file:
            return recorded, {name: variable[...] for name, variable in file.groups["A"].variables.items()}


@pytest.fixture
def driver_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> DriverRun:
    return DriverRun(tmp_path, monkeypatch)


def volts(counts: int) -> float:
    return float(volts_of(np.array([[counts]], np.int16), np.array([Library.coefficients]))[0, 0])


def test_readings_are_volts_of_coefficients(driver_run: DriverRun) -> None:
    driver_run.run()
    assert driver_run.library.dark
    recorded, columns = driver_run.close()
    for side, on, off in (("right", 1000, 20_000), ("left", -2000, 25_000)):
        ones = np.ones(len(columns[side]))
        assert columns[side] == pytest.approx((volts(on) - volts(off)) * ones, abs=1e-9)
        assert columns[f"{side}_ambient"] == pytest.approx(volts(off) * ones, abs=1e-9)
    assert np.diff(columns["time_s"]) == pytest.approx(0.005, abs=1e-6)
    assert (recorded.outcome, recorded.sensors["A"]) == ("done", len(columns["time_s"]))
    assert columns["angle_deg"].min() == pytest.approx(-3.0)


LINES = {"model": "", "terminal": "differential", "switching": "lines"}


def test_clocked_lines_alternate_emitters(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    three = {"lines": ("port0/line0", "port0/line1", "port0/line2"), "emitters": 3, "rate_hz": 12_000.0}
    driver_run = DriverRun(tmp_path, monkeypatch, "USB-6356", **LINES | three)
    library = driver_run.library
    driver_run.run()
    assert library.dark
    assert any("'/Dev1/ai/SampleClock', 12000" in call for call in library.calls if call.startswith("CfgSampClkTiming"))
    pattern = library.pattern
    assert pattern is not None
    assert pattern.shape == (3, 12_000)
    assert [np.flatnonzero(line[:60]).tolist() for line in pattern] == [list(range(n, n + 10)) for n in (0, 20, 40)]
    assert set(library.lines) == {f"Dev1/port0/line{number}" for number in range(3)}
    recorded, columns = driver_run.close()
    assert recorded.outcome == "done"
    signal = np.full(len(columns["right"]), volts(1000) - volts(20_000))
    assert columns["right"] == pytest.approx(signal, abs=1e-9)
    assert np.diff(columns["time_s"]) == pytest.approx(0.005, abs=2e-6)  # the rate is 20 MHz / 1667


@pytest.mark.parametrize(
    ("kind", "settings", "message"),
    [
        (
            "USB-6218",
            {"lines": ("port1/line0",), "terminal": "rse"},
            "USB-6218 .BNC. are set by software only",
        ),
        ("USB-6356", {"lines": ("port3/line0",)}, r"daq\.lines = 'port3/line0'; must be .* USB-6356"),
        (
            "USB-6356",
            {"lines": ("port0/line0",), "enable": "port0/line0"},
            "line0'; must be an unused digital output",
        ),
        (
            "USB-6356",
            {"lines": ("port0/line0",), "rate_hz": 1.1e6, "switch_hz": 1000.0},
            "requires daq.rate_hz of at most 1e.06",
        ),
        ("USB-6356", {"lines": ("port0/line0",), "emitters": 2}, "must be 2 different lines, one for each emitter"),
        ("USB-6356", {"lines": ("port0/line0",), "rate_hz": 10_100.0}, "must be a multiple of 400 Hz"),
        ("USB-6356", {"lines": ()}, 'are required with switching = "lines", and invalid otherwise'),
        ("USB-6356", {"lines": ("port0/line0",), "switching": "counter"}, 'are required with switching = "lines"'),
    ],
)
def test_refuses_lines_that_cannot_switch_emitters(
    kind: str, settings: dict[str, object], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = with_device(kind, monkeypatch)
    with pytest.raises(BenchError, match=message):
        NiDaq(SimulatedClock(), "Dev1", setup(**LINES | settings))
    assert library.dark
    assert not library.lines


def test_detects_clipping_at_limit_of_range(driver_run: DriverRun, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Library, "coefficients", (0.0, 10.0 / 25_000.0))  # the range ends at 25,000 counts
    driver_run.run()
    _, columns = driver_run.close()
    assert not columns["right_clipped"].any()
    assert columns["left_clipped"].all()


def inject(driver_run: DriverRun, at_s: float, function: str, code: int) -> Callable[[Tick], None]:
    def watch(tick: Tick) -> None:
        if tick.t_s >= at_s and function not in driver_run.library.faults:
            driver_run.library.faults[function] = [code]

    return watch


def test_unplugged_device_ends_run_and_samples_are_kept(driver_run: DriverRun) -> None:
    with pytest.raises(BenchError, match="was unplugged or reset"):
        driver_run.run(inject(driver_run, 1.0, "DAQmxGetReadAttribute", -88709))
    assert driver_run.library.dark
    end = read_journal(driver_run.folder / "run.journal").events[-1]
    assert (end["what"], end["outcome"]) == ("fault", "fault")
    assert "was unplugged or reset" in end["reason"]
    recorded, columns = driver_run.close()
    assert recorded.outcome == "fault"
    assert 0.9 < columns["time_s"][-1] < 1.2


def test_run_continues_after_overrun(driver_run: DriverRun) -> None:
    driver_run.run(inject(driver_run, 1.0, "DAQmxReadBinaryI16", -200279))
    events = read_journal(driver_run.folder / "run.journal").events
    _, notice = (event["reason"] for event in events if event["what"] == "remark")
    assert "samples were overwritten before the program read them; about" in notice
    assert events[-1]["losses"]["overruns"] == 1
    recorded, columns = driver_run.close()
    assert recorded.outcome == "done"
    intervals_s = np.diff(columns["time_s"])
    assert np.sum(intervals_s > 0.006) == 1
    lost_s = events[-1]["losses"]["samples"] / 10_000.0
    assert intervals_s.max() == pytest.approx(lost_s, abs=0.011)  # plus a frame and a reading
    assert np.ptp(columns["right"]) < 1e-9


def test_ctrl_c_switches_emitters_off(driver_run: DriverRun) -> None:
    def interrupt(tick: Tick) -> None:
        if tick.t_s > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        driver_run.run(interrupt)
    assert driver_run.library.dark
    assert driver_run.close()[0].outcome == "stopped"
