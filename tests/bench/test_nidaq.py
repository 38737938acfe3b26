"""The driver of the USB-6218, by the C calls that `nidaqmx` makes of it: written conversations, and every fault."""

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
from solen.bench.run import Instruments, Tick, begin, run
from solen.bench.sampling import DaqSampling
from solen.bench.simulated.stage import SimulatedStage
from solen.errors import BenchError
from tests.bench.daqmx_support import Library, Rig

PREPARED = """
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
RUN = """
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
    """NI-DAQmx with a USB-6218 that is not there."""
    made = Library()
    use(made, monkeypatch)
    return made


def use(library: Library, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nidaqmx find this library."""
    _lib = importlib.import_module("nidaqmx._lib")
    for name in ("_windll", "_cdll"):
        monkeypatch.setattr(_lib.lib_importer, name, _lib.DaqFunctionImporter(library))
    monkeypatch.setattr(_lib.lib_importer, "_encoding", "utf-8")


def setup(**more: object) -> Setup:
    asked = {"channels": ("ai0", "ai1"), "synced": False, "rate_hz": 10_000.0, "emitters": 1, "switch_hz": 200.0}
    return Setup(**asked | {"switching": "counter", "model": "USB-6218"} | more)  # type: ignore[arg-type]  # a test may ask for anything


def test_a_conversation_from_beginning_to_end(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup())
    assert isinstance(daq, Daq)
    assert library.said == PREPARED.split("\n")[1:-1]
    library.said.clear()
    daq.start()
    assert library.running == {2}
    library.waiting = np.array([[1, -2, 3], [32_767, -32_768, 6]], np.int16)
    samples = daq.read()
    assert (samples.segment, samples.first) == (0, 0)
    assert samples.counts.tolist() == [[1, 32_767], [-2, -32_768], [3, 6]]
    daq.stop()
    daq.close()  # a second time says nothing
    assert library.said == RUN.split("\n")[1:-1]
    assert library.dark
    assert daq.coefficients.shape == (2, 4)
    assert tuple(daq.coefficients[1]) == library.coefficients
    assert daq.rate_hz == 10_000.0
    assert daq.convert_s == pytest.approx(14e-6, rel=1e-4)


def test_two_counters_take_turns_and_a_line_enables_what_is_outside(library: Library) -> None:
    NiDaq(SimulatedClock(), "Dev1", setup(emitters=2)).close()
    pulses = [said for said in library.said if said.startswith("CreateCO")]
    assert pulses == [
        "CreateCOPulseChanFreq(3, 'Dev1/ctr0', '', 10373, 10214, 0, 200, 0.25)",
        "CreateCOPulseChanFreq(4, 'Dev1/ctr1', '', 10373, 10214, 0.0025, 200, 0.25)",
    ]
    daq = NiDaq(SimulatedClock(), "Dev1", setup(switching="external", enable="port1/line7", terminal="differential"))
    assert "10106, -10, 10, 10348" in next(said for said in library.said[::-1] if "AIVoltage" in said)
    assert library.lines["Dev1/port1/line7"] is False
    daq.start()
    assert library.lines["Dev1/port1/line7"] is True
    daq.stop()
    assert library.lines["Dev1/port1/line7"] is False


def test_a_watchdog_outside_is_fed_while_samples_are_read(library: Library) -> None:
    plain = NiDaq(SimulatedClock(), "Dev1", setup())
    assert "has no watchdog" in (plain.no_watchdog or "")
    assert "daq.alive" in (plain.no_watchdog or "")
    plain.close()
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


def test_a_rate_that_divides_no_clock_is_reported_as_the_instrument_has_it(library: Library) -> None:
    assert library.dark
    daq = NiDaq(SimulatedClock(), "Dev1", setup(rate_hz=13_000.0))
    assert daq.rate_hz == pytest.approx(20e6 / 1538)
    daq.close()


def test_what_was_overwritten_is_counted_and_sampling_begun_anew(library: Library) -> None:
    clock = SimulatedClock()
    daq = NiDaq(clock, "Dev1", setup())
    sampling = DaqSampling(daq)
    daq.start()
    library.waiting = np.zeros((2, 70), np.int16)
    assert len(sampling.read().rows) == 1  # a frame is a period, 50 samples; 20 wait
    clock.sleep(12.0)
    library.faults["DAQmxReadBinaryI16"] = [-200279]
    library.waiting = np.zeros((2, 100), np.int16)
    library.said.clear()
    taken = sampling.read()
    assert taken.last is None
    assert taken.notices == (
        "USB-6218 Dev1: samples were overwritten before the program read them; "
        "about 119930 samples of each channel are lost",
    )
    assert library.said[2:] == ["StopTask(2)", "StopTask(3)", "StartTask(2)", "StartTask(3)"]
    library.waiting = np.ones((2, 100), np.int16)
    after = sampling.read()
    assert (after.rows["stretch"].tolist(), after.rows["number"].tolist()) == ([1, 1], [0, 50])
    assert after.rows["counts"].min() == 1  # none of the 20 from before the gap
    assert vars(daq.losses) == {"samples": 119_930, "overruns": 1}
    daq.close()


def test_overruns_that_follow_one_another_end_the_run(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup())
    daq.start()
    library.faults["DAQmxGetReadAttribute"] = [-200361] * 3
    daq.read()
    daq.read()
    with pytest.raises(BenchError, match=r"3 times in 10 s; .*daq\.rate_hz") as told:
        daq.read()
    assert len(str(told.value).splitlines()) == 1
    assert library.dark


@pytest.mark.parametrize(
    ("function", "code", "told"),
    [
        ("DAQmxTaskControl", -50103, r"is in use by another program or task \(NI-DAQmx error -50103\); close that"),
        ("DAQmxCreateAIVoltageChan", -200170, r"has no such channel or line .*; compare the rig file's \[daq\]"),
        ("DAQmxStartTask", -88709, r"was unplugged or reset \(NI-DAQmx error -88709\); check its cable"),
        ("DAQmxReadBinaryI16", -88709, r"was unplugged or reset \(NI-DAQmx error -88709\); check its cable"),
        ("DAQmxGetReadAttribute", -200999, r"cannot read: Words that nobody foresaw. \(NI-DAQmx error -200999\)$"),
        ("DAQmxWriteDigitalLines", -50103, r"is in use by another program"),
        ("DAQmxCreateTask", -50103, r"is in use by another program"),
    ],
)
@pytest.mark.parametrize("nth", [0, 1])
def test_a_fault_is_one_line_and_leaves_everything_dark(
    library: Library, function: str, code: int, told: str, nth: int
) -> None:
    library.faults[function] = [0] * nth + [code]

    def used() -> None:
        daq = NiDaq(SimulatedClock(), "Dev1", setup(enable="port1/line7"))
        daq.start()
        for _ in range(2):
            library.waiting = np.zeros((2, 5), np.int16)
            daq.read()

    with pytest.raises(BenchError, match=told) as refusal:
        used()
    assert len(str(refusal.value).splitlines()) == 1
    assert library.dark


def test_emitters_that_are_switched_no_more_end_the_run(library: Library) -> None:
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
def test_after_an_overrun_only_the_inputs_may_have_failed(library: Library, faults: list[int], ends: bool) -> None:
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


def test_a_line_that_cannot_be_set_low_is_reported(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup())
    daq.start()
    library.faults["DAQmxWriteDigitalLines"] = [-88709]
    with pytest.raises(BenchError, match=r"lines .* emitters .*; cut their supply"):
        daq.stop()
    assert not library.tasks
    daq.close()  # tried again
    assert library.dark


def test_a_line_that_cannot_be_set_low_does_not_keep_the_others_high(library: Library) -> None:
    daq = NiDaq(SimulatedClock(), "Dev1", setup(enable="port1/line7"))
    daq.start()
    library.lines["Dev1/port1/line0"] = True
    library.faults["DAQmxWriteDigitalLines"] = [0, -88709]
    with pytest.raises(BenchError, match="unplugged"):
        daq.stop()
    assert library.lines == {"Dev1/port1/line0": True, "Dev1/port1/line7": False}
    library.faults["DAQmxWriteDigitalLines"] = [-88709] * 2
    with pytest.raises(BenchError, match="cut their supply"):
        daq.close()
    daq.close()
    assert library.dark


def test_a_device_that_is_not_there_or_another_is_reported(library: Library) -> None:
    with pytest.raises(BenchError, match="device Dev9; is not a device that NI-DAQmx knows; there are Dev1, Dev2"):
        NiDaq(SimulatedClock(), "Dev9", setup())
    with pytest.raises(BenchError, match="device Dev2; is a USB-6009, not a USB-6218"):
        NiDaq(SimulatedClock(), "Dev2", setup())
    library.missing.add("DAQmxCfgImplicitTiming")
    with pytest.raises(BenchError, match=r"NI-DAQmx; .*too old.*ni\.com"):
        NiDaq(SimulatedClock(), "Dev1", setup())
    assert library.dark


def test_without_the_driver_one_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    _lib = importlib.import_module("nidaqmx._lib")

    def none() -> None:
        raise _lib.DaqNotFoundError(_lib._DAQ_NOT_FOUND_MESSAGE)

    monkeypatch.setattr(_lib.lib_importer, "_windll", None)
    monkeypatch.setattr(_lib.lib_importer, "_cdll", None)
    monkeypatch.setattr(_lib.lib_importer, "_import_lib", none)
    with pytest.raises(BenchError, match=r"NI-DAQmx; must be installed.*ni\.com"):
        NiDaq(SimulatedClock(), "Dev1", setup())


@pytest.mark.parametrize(
    ("ask", "told"),
    [
        (
            lambda: setup(rate_hz=130_000.0),
            r"daq\.rate_hz = 130000\.0; for 2 inputs is 260000 samples .* highest rate is 250000; 125000 or less",
        ),
        (
            lambda: setup(rate_hz=800.0),
            r"leaves 1\.8 samples of a phase of 2500 µs after 300 µs of settling; 2 are needed",
        ),
        (
            lambda: setup(channels=("ai0", "ai8"), terminal="differential"),
            "channels = 'ai8'; is not among the differential",
        ),
        (lambda: setup(channels=("ai0", "ai32")), "'ai32'; is not among the rse inputs of USB-6218: ai0 to ai31"),
        (lambda: setup(channels=("ai0", "ai0")), "name an input twice"),
        (lambda: setup(range_v=3.0), r"range_v = 3\.0; USB-6218 has ±0\.2, 1, 5, 10 V"),
        (
            lambda: setup(emitters=3),
            "too many .*; USB-6218 has 2 counters that generate pulses, and its other outputs are not timed",
        ),
        (lambda: setup(emitters=2, switching="external"), "sync; is needed with 2 alternating emitters"),
        (lambda: setup(enable="port0/line0"), "static outputs, port1/line0 to port1/line7"),
        (lambda: setup(alive="port0/line0"), r"daq\.alive = 'port0/line0'; .*static outputs"),
        (lambda: setup(enable="port1/line7", alive="port1/line7"), r"daq\.alive = 'port1/line7'; .*daq\.enable"),
        (lambda: setup(enable="port1/line0"), "a counter switches an emitter"),
    ],
)
def test_what_the_instrument_cannot_do_is_refused_before_it_is_asked(
    library: Library, ask: Callable[[], Setup], told: str
) -> None:
    with pytest.raises(BenchError, match=told):
        ask()
    assert library.said == []


# other devices


def with_device(kind: str, monkeypatch: pytest.MonkeyPatch) -> Library:
    made = Library(kind)
    use(made, monkeypatch)
    return made


OUTSIDE = {"switching": "external", "model": ""}


@pytest.mark.parametrize(
    ("kind", "more", "convert_us"),
    [
        ("USB-6001", {"rate_hz": 5_000.0}, 100.0),
        ("USB-6009", {"terminal": "differential", "range_v": 5.0}, 50.0),
        ("USB-6211", {"terminal": "nrse", "switching": "counter", "emitters": 2, "alive": "port1/line3"}, 14.0),
        ("USB-6218", {"channels": ("ai31", "ai0"), "rate_hz": 125_000.0}, 14.0),
        ("myDAQ", {"terminal": "differential", "range_v": 2.0, "switching": "counter", "rate_hz": 100_000.0}, 14.0),
        ("USB-6356", {"terminal": "differential", "switching": "counter", "emitters": 4, "rate_hz": 1.25e6}, 0.0),
    ],
)
def test_a_device_says_what_it_can_and_is_used_so(
    kind: str, more: dict[str, object], convert_us: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = with_device(kind, monkeypatch)
    daq = NiDaq(SimulatedClock(), "Dev1", setup(**OUTSIDE | more))
    assert daq.setup.model == library.facts.product
    assert daq.name == f"{library.facts.product} Dev1"
    assert 1e6 * daq.convert_s == pytest.approx(convert_us, rel=1e-4)
    daq.start()
    library.waiting = np.zeros((2, 5), np.int16)
    remarks = [daq.read().notices, daq.read().notices]
    stated = library.facts.converts
    assert [len(one) for one in remarks] == [0 if stated else 1, 0]
    daq.close()
    assert library.dark
    if kind == "USB-6009":
        assert "by 50 µs, and it may be 20.8 µs" in remarks[0][0]
    if kind in {"myDAQ", "USB-6356"}:  # where its counters come out, and what holds them low, nobody has stated
        assert not [said for said in library.said if said.startswith(("SetChan", "WriteDigital"))]


@pytest.mark.parametrize(
    ("kind", "more", "told"),
    [
        ("USB-6001", {"rate_hz": 15e3}, r"rate is 20000; 10000 or less"),
        ("USB-6001", {"range_v": 5.0}, r"USB-6001 has ±10 V"),
        ("USB-6001", {"terminal": "nrse"}, "is not a wiring of USB-6001, which has rse, differential"),
        (
            "USB-6009",
            {"switching": "counter"},
            "USB-6009 has no counters that generate pulses, .*; switch them externally",
        ),
        (
            "USB-6009",
            {"channels": ("ai0", "ai4"), "terminal": "differential"},
            "'ai4'; is not among .* USB-6009: ai0 to ai3",
        ),
        ("USB-6009", {"enable": "port2/line0"}, r"USB-6009's static outputs, port0/line0 to port1/line3"),
        ("USB-6211", {"switching": "counter", "enable": "port1/line0"}, "a counter switches"),
        ("myDAQ", {}, "'rse'; is not a wiring of myDAQ, which has differential"),
        ("myDAQ", {"terminal": "differential", "range_v": 5.0}, r"range_v = 5\.0; myDAQ has ±2, 10 V"),
        (
            "myDAQ",
            {"terminal": "differential", "range_v": 2.0, "switching": "counter", "emitters": 2},
            "myDAQ has 1 count",
        ),
        ("USB-6356", {"terminal": "differential", "rate_hz": 2e6}, "an input of USB-6356 is 1250000 samples"),
        (
            "USB-6356",
            {"terminal": "differential", "switching": "counter", "emitters": 5},
            "has 4 counters that generate pulses, and its other outputs follow a clock; switching = .lines. uses these",
        ),
        ("USB-6289", {}, "has a converter of 18 bits; counts have at most 16 bits; use"),
        ("USB-6289", {"switching": "counter", "emitters": 3}, "USB-6289 has 2 counters"),
        ("USB-6501", {}, "is not a wiring of USB-6501, which has no analog inputs"),
    ],
)
def test_what_a_device_says_it_cannot_do_is_refused(
    kind: str, more: dict[str, object], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = with_device(kind, monkeypatch)
    with pytest.raises(BenchError, match=told) as refusal:
        NiDaq(SimulatedClock(), "Dev1", setup(**OUTSIDE | more))
    assert len(str(refusal.value).splitlines()) == 1
    assert library.dark
    assert not library.lines


# whole runs

PROTOCOL = "schema = 1\nname = 'there and back'\ncycles = 2\nrest_s = 0.2\n" + "".join(
    f"[[step]]\nto_deg = {to}\nvelocity_deg_per_s = 15.0\nhold_s = 0.3\n" for to in (-3.0, 0.0)
)
HEADER = {
    "solen": "0", "simulated": False, "begun_utc": "2026-01-01T00:00:00+00:00", "protocol_name": "there and back",
    "rig_name": "a rig", "zero": 0.0, "lever_mm": None, "protocol": tomllib.loads(PROTOCOL.partition("\n")[2]),
    "sensors": [{"name": "A", "design": "a.toml", "lens": True, "emitter": 1, "right": 1, "left": 2}],
}  # fmt: skip


class Driven:
    """A run of the real driver on an instrument that is not there."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, kind: str = "USB-6218", **more: object) -> None:
        self.clock, self.folder, self.setup = SimulatedClock(), folder, setup(**more)
        self.library = Rig(self.clock, lit=(1000, -2000), dark_counts=(20_000, 25_000), kind=kind)
        use(self.library, monkeypatch)
        (folder / "protocol.toml").write_text(PROTOCOL, encoding="utf-8")

    def run(self, watch: Callable[[Tick], None] | None = None) -> None:
        daq = NiDaq(self.clock, "Dev1", self.setup)
        on = Instruments(SimulatedStage(self.clock), daq, self.clock)
        with begin(self.folder / "run.journal", on, HEADER) as journal:
            run(load_protocol(self.folder / "protocol.toml"), on, journal, watch=watch)
        daq.close()

    def closed(self) -> tuple[RecordedRun, dict[str, np.ndarray]]:
        done = write_recording(read_journal(self.folder / "run.journal"), self.folder / "run.nc")
        with h5netcdf.File(self.folder / "run.nc", "r") as file:
            return done, {name: one[...] for name, one in file.groups["A"].variables.items()}


@pytest.fixture
def driven(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Driven:
    return Driven(tmp_path, monkeypatch)


def test_a_run_by_the_driver_gives_the_volts_of_the_coefficients(driven: Driven) -> None:
    driven.run()
    assert driven.library.dark
    done, read = driven.closed()
    coefficients = np.array([Library.coefficients])
    lit, dark = (volts_of(np.array([one], np.int16).T, coefficients)[:, 0] for one in ((1000, -2000), (20_000, 25_000)))
    for place, side in enumerate(("right", "left")):
        assert read[side] == pytest.approx(np.full(len(read[side]), lit[place] - dark[place]), abs=1e-9)
        assert read[f"{side}_ambient"] == pytest.approx(np.full(len(read[side]), dark[place]), abs=1e-9)
    assert np.diff(read["time_s"]) == pytest.approx(0.005, abs=1e-6)
    assert (done.outcome, done.sensors["A"]) == ("done", len(read["time_s"]))
    assert read["angle_deg"].min() == pytest.approx(-3.0)


LINES = {"model": "", "terminal": "differential", "switching": "lines"}


def test_lines_that_follow_the_samples_light_emitters_in_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    three = {"lines": ("port0/line0", "port0/line1", "port0/line2"), "emitters": 3, "rate_hz": 12_000.0}
    driven = Driven(tmp_path, monkeypatch, "USB-6356", **LINES | three)
    driven.run()
    assert driven.library.dark
    clocked = next(said for said in driven.library.said if said.startswith("CfgSampClkTiming") and "ai" in said)
    assert "'/Dev1/ai/SampleClock', 12000" in clocked
    turn = driven.library.pattern
    assert turn is not None
    assert turn.shape == (3, 12_000)
    assert [np.flatnonzero(line[:60]).tolist() for line in turn] == [list(range(n, n + 10)) for n in (0, 20, 40)]
    assert set(driven.library.lines) == {f"Dev1/port0/line{number}" for number in range(3)}
    done, read = driven.closed()
    dark, lit = (
        volts_of(np.array([[one]], np.int16), np.array([Library.coefficients]))[0, 0] for one in (20_000, 1000)
    )
    assert done.outcome == "done"
    assert read["right"] == pytest.approx(np.full(len(read["right"]), lit - dark), abs=1e-9)
    assert np.diff(read["time_s"]) == pytest.approx(0.005, abs=2e-6)  # 20 MHz over 1667


@pytest.mark.parametrize(
    ("kind", "more", "told"),
    [
        (
            "USB-6218",
            {"lines": ("port1/line0",), "terminal": "rse"},
            "USB-6218 .BNC. are set by the program only",
        ),
        ("USB-6356", {"lines": ("port3/line0",)}, r"daq\.lines = 'port3/line0'; must be one of USB-6356's"),
        (
            "USB-6356",
            {"lines": ("port0/line0",), "enable": "port0/line0"},
            "line0'; must be .* not in use",
        ),
        (
            "USB-6356",
            {"lines": ("port0/line0",), "rate_hz": 1.1e6, "switch_hz": 1000.0},
            "a clock of at most 1e.06 Hz",
        ),
        ("USB-6356", {"lines": ("port0/line0",), "emitters": 2}, "must be one for each of 2 emitters"),
        ("USB-6356", {"lines": ("port0/line0",), "rate_hz": 10_100.0}, "must be a multiple of 400 Hz"),
        ("USB-6356", {"lines": ()}, 'are required with switching = "lines", and not allowed otherwise'),
        ("USB-6356", {"lines": ("port0/line0",), "switching": "counter"}, 'are required with switching = "lines"'),
    ],
)
def test_lines_that_cannot_light_emitters_are_refused(
    kind: str, more: dict[str, object], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    library = with_device(kind, monkeypatch)
    with pytest.raises(BenchError, match=told):
        NiDaq(SimulatedClock(), "Dev1", setup(**LINES | more))
    assert library.dark
    assert not library.lines


def test_a_converter_whose_counts_end_before_16_bits_do_clips_there(
    driven: Driven, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Library, "coefficients", (0.0, 10.0 / 25_000.0))  # its counts end at 25,000
    driven.run()
    _, read = driven.closed()
    assert not read["right_clipped"].any()
    assert read["left_clipped"].all()


def faulty_after(driven: Driven, at_s: float, function: str, codes: list[int]) -> Callable[[Tick], None]:
    def watch(tick: Tick) -> None:
        if tick.t_s >= at_s and function not in driven.library.faults:
            driven.library.faults[function] = codes

    return watch


def test_an_instrument_that_is_unplugged_ends_the_run_and_what_was_sampled_is_there(driven: Driven) -> None:
    watch = faulty_after(driven, 1.0, "DAQmxGetReadAttribute", [-88709])
    with pytest.raises(BenchError, match="was unplugged or reset"):
        driven.run(watch)
    assert driven.library.dark
    end = read_journal(driven.folder / "run.journal").events[-1]
    assert (end["what"], end["outcome"]) == ("fault", "fault")
    assert "was unplugged or reset" in end["reason"]
    done, read = driven.closed()
    assert done.outcome == "fault"
    assert 0.9 < read["time_s"][-1] < 1.2


def test_a_run_goes_on_after_an_overrun_and_tells_it(driven: Driven) -> None:
    driven.run(faulty_after(driven, 1.0, "DAQmxReadBinaryI16", [-200279]))
    events = read_journal(driven.folder / "run.journal").events
    _, remark = (event["reason"] for event in events if event["what"] == "remark")
    assert "samples were overwritten before the program read them; about" in remark
    assert events[-1]["losses"]["overruns"] == 1
    done, read = driven.closed()
    assert done.outcome == "done"
    steps = np.diff(read["time_s"])
    assert np.sum(steps > 0.006) == 1
    lost = events[-1]["losses"]["samples"] / 10_000.0
    assert steps.max() == pytest.approx(lost, abs=0.011)  # a frame, and a reading
    assert np.ptp(read["right"]) < 1e-9


def test_ctrl_c_leaves_everything_dark(driven: Driven) -> None:
    def interrupt(tick: Tick) -> None:
        if tick.t_s > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        driven.run(interrupt)
    assert driven.library.dark
    assert driven.closed()[0].outcome == "stopped"
