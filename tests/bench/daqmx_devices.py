"""Properties of some devices as NI-DAQmx reports them, from the specifications by National Instruments."""

from dataclasses import dataclass

RSE, NRSE, DIFF = 1, 2, 4


def limits(*ranges_v: float) -> tuple[float, ...]:
    return tuple(limit for range_v in ranges_v for limit in (-range_v, range_v))


def lines(**ports: int) -> tuple[str, ...]:
    return tuple(f"{port}/line{number}" for port, count in ports.items() for number in range(count))


@dataclass(frozen=True)
class Device:
    """Properties of a device.

    Attributes
    ----------
    product
        Product type that it reports.
    wirings
        Analog inputs, and the possible wirings of each (bits).
    single_hz, all_hz, simultaneous
        Highest sampling rate of one input and of all together, or of each.
    limits_v, single_ended_v
        Limits of its ranges, and the range of single-ended inputs whatever is requested; 0 for the requested one.
    bits
        Resolution of its ADC.
    counters, lines, timed_hz
        Counters that generate pulses, digital outputs, and the highest clock rate of these; 0 for none.
    reports_conversion
        Whether it reports its conversion rate.
    """

    product: str
    wirings: dict[str, int]
    single_hz: float
    all_hz: float
    limits_v: tuple[float, ...]
    bits: int
    lines: tuple[str, ...]
    counters: tuple[str, ...] = ()
    simultaneous: bool = False
    reports_conversion: bool = True
    single_ended_v: float = 0.0
    timed_hz: float = 0.0

    def property(self, number: int) -> object:
        """Value of an attribute by its number in NIDAQmx.h; None if the device does not have it."""
        return {
            0x631: self.product,
            0x231E: tuple(self.wirings),
            0x2325: self.counters,
            0x2322: self.lines,
            0x298C: self.single_hz or None,
            0x298D: self.all_hz or None,
            0x299A: self.timed_hz or None,
            0x298F: int(self.simultaneous),
            0x2990: self.limits_v or None,
        }[number]


def paired(offset: int, first: int, second: int, count: int) -> dict[str, int]:
    """Inputs of which n and n + offset form a pair, and the possible wirings of the first and the second of a pair."""
    return {f"ai{n}": first if n % (2 * offset) < offset else second for n in range(count)}


M_LIMITS, M_COUNTERS = limits(0.2, 1.0, 5.0, 10.0), ("ctr0", "ctr1")
DEVICES = {
    # USB-6001 user guide and specifications: 14 bits, 20 kS/s in total, ±10 V, P0.0-7, P1.0-3, P2.0; no pulse output
    "USB-6001": Device(
        "USB-6001", paired(4, RSE | DIFF, RSE, 8), 20e3, 20e3, limits(10.0), 14, lines(port0=8, port1=4, port2=1),
        reports_conversion=False,
    ),
    # USB-6008/6009 user guide and specifications: 14 bits differential; 13 bits and ±10 V single-ended; 48 kS/s total
    "USB-6009": Device(
        "USB-6009", paired(4, RSE | DIFF, RSE, 8), 48e3, 48e3, limits(1.0, 1.25, 2.0, 2.5, 4.0, 5.0, 10.0, 20.0), 14,
        lines(port0=8, port1=4), reports_conversion=False, single_ended_v=10.0,
    ),
    "USB-6211": Device(
        "USB-6211", paired(8, RSE | NRSE | DIFF, RSE | NRSE, 16), 250e3, 250e3, M_LIMITS, 16,
        lines(port1=4), M_COUNTERS,
    ),
    "USB-6218": Device(
        "USB-6218 (BNC)", paired(8, RSE | NRSE | DIFF, RSE | NRSE, 32), 250e3, 250e3, M_LIMITS, 16,
        lines(port1=8), M_COUNTERS,
    ),
    # NI myDAQ user guide and specifications: two differential inputs, 200 kS/s, ±2 V and ±10 V, one counter
    "myDAQ": Device(
        "myDAQ", {"ai0": DIFF, "ai1": DIFF, "audioInputLeft": DIFF, "dmm": DIFF}, 200e3, 200e3, limits(2.0, 10.0), 16,
        lines(port0=8), ("ctr0",),
    ),
    # USB-6356 (X series): an ADC for each of eight inputs
    "USB-6356": Device(
        "USB-6356", {f"ai{n}": DIFF for n in range(8)}, 1.25e6, 1.25e6, limits(1.0, 2.0, 5.0, 10.0), 16,
        lines(port0=8, port1=8, port2=8), ("ctr0", "ctr1", "ctr2", "ctr3"), simultaneous=True, timed_hz=1e6,
    ),
    # USB-6289: 18 bits
    "USB-6289": Device(
        "USB-6289", paired(8, RSE | NRSE | DIFF, RSE | NRSE, 32), 625e3, 500e3, limits(0.1, 1.0, 5.0, 10.0), 18,
        lines(port0=32), ("ctr0", "ctr1", "freqout"),
    ),
    # USB-6501: digital lines only
    "USB-6501": Device("USB-6501", {}, 0.0, 0.0, (), 0, lines(port0=8, port1=8, port2=8)),
}  # fmt: skip
