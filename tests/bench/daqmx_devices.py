"""What NI-DAQmx knows of some devices: facts of their specifications, as National Instruments publishes them."""

from dataclasses import dataclass

RSE, NRSE, DIFF = 1, 2, 4


def rails(*ends: float) -> tuple[float, ...]:
    return tuple(one for end in ends for one in (-end, end))


def lines(**ports: int) -> tuple[str, ...]:
    return tuple(f"{port}/line{number}" for port, count in ports.items() for number in range(count))


@dataclass(frozen=True)
class Facts:
    """A device.

    Attributes
    ----------
    product
        As it states it.
    wired
        Its analog inputs, and how each may be wired (bits).
    alone_hz, all_hz, simultaneous
        Samples per second of one input and of all together, or of each.
    rails_v, real_v
        Its ranges, and the one that inputs without a pair have whatever is asked; 0 for as asked.
    bits
        Of its converter.
    counters, lines, timed_hz
        Those that put out pulses, and digital outputs; how fast these follow a clock, 0 for not.
    converts
        Whether it states when it converts.
    """

    product: str
    wired: dict[str, int]
    alone_hz: float
    all_hz: float
    rails_v: tuple[float, ...]
    bits: int
    lines: tuple[str, ...]
    counters: tuple[str, ...] = ()
    simultaneous: bool = False
    converts: bool = True
    real_v: float = 0.0
    timed_hz: float = 0.0

    def property(self, number: int) -> object:
        """Value of a device's attribute by its number in NIDAQmx.h; None where the device has no such property."""
        return {
            0x631: self.product,
            0x231E: tuple(self.wired),
            0x2325: self.counters,
            0x2322: self.lines,
            0x298C: self.alone_hz or None,
            0x298D: self.all_hz or None,
            0x299A: self.timed_hz or None,
            0x298F: int(self.simultaneous),
            0x2990: self.rails_v or None,
        }[number]


def paired(first: int, apart: int, both: int, one: int, whole: int) -> dict[str, int]:
    """Inputs of which n and n + apart make a pair, and how each is wired."""
    return {f"ai{n}": both if n % (2 * apart) < apart and n >= first else one for n in range(whole)}


M_RAILS, M_COUNTERS = rails(0.2, 1.0, 5.0, 10.0), ("ctr0", "ctr1")
DEVICES = {
    # USB-6001 user guide and specifications: 14 bits, 20 kS/s in all, ±10 V, P0.0-7, P1.0-3, P2.0; its counter counts
    "USB-6001": Facts(
        "USB-6001", paired(0, 4, RSE | DIFF, RSE, 8), 20e3, 20e3, rails(10.0), 14, lines(port0=8, port1=4, port2=1),
        converts=False,
    ),
    # USB-6008/6009 user guide and specifications: 14 bits as pairs, 13 alone and ±10 V only; 48 kS/s in all
    "USB-6009": Facts(
        "USB-6009", paired(0, 4, RSE | DIFF, RSE, 8), 48e3, 48e3, rails(1.0, 1.25, 2.0, 2.5, 4.0, 5.0, 10.0, 20.0), 14,
        lines(port0=8, port1=4), converts=False, real_v=10.0,
    ),
    "USB-6211": Facts(
        "USB-6211", paired(0, 8, RSE | NRSE | DIFF, RSE | NRSE, 16), 250e3, 250e3, M_RAILS, 16,
        lines(port1=4), M_COUNTERS,
    ),
    "USB-6218": Facts(
        "USB-6218 (BNC)", paired(0, 8, RSE | NRSE | DIFF, RSE | NRSE, 32), 250e3, 250e3, M_RAILS, 16,
        lines(port1=8), M_COUNTERS,
    ),
    # NI myDAQ user guide and specifications: two pairs of inputs, 200 kS/s, ±2 V and ±10 V, a counter
    "myDAQ": Facts(
        "myDAQ", {"ai0": DIFF, "ai1": DIFF, "audioInputLeft": DIFF, "dmm": DIFF}, 200e3, 200e3, rails(2.0, 10.0), 16,
        lines(port0=8), ("ctr0",),
    ),
    # USB-6356 (X series): a converter for each of eight inputs
    "USB-6356": Facts(
        "USB-6356", {f"ai{n}": DIFF for n in range(8)}, 1.25e6, 1.25e6, rails(1.0, 2.0, 5.0, 10.0), 16,
        lines(port0=8, port1=8, port2=8), ("ctr0", "ctr1", "ctr2", "ctr3"), simultaneous=True, timed_hz=1e6,
    ),
    # USB-6289: 18 bits
    "USB-6289": Facts(
        "USB-6289", paired(0, 8, RSE | NRSE | DIFF, RSE | NRSE, 32), 625e3, 500e3, rails(0.1, 1.0, 5.0, 10.0), 18,
        lines(port0=32), ("ctr0", "ctr1", "freqout"),
    ),
    # USB-6501: digital lines alone
    "USB-6501": Facts("USB-6501", {}, 0.0, 0.0, (), 0, lines(port0=8, port1=8, port2=8)),
}  # fmt: skip
