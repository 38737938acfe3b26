"""Warnings about a readout: `cautions` checks the circuit, the load advice and the light."""

from collections.abc import Iterator

from solen.parts.light import MAX_PEAK_DIFFERENCE_NM
from solen.readout.advice import Advice
from solen.readout.circuit import Circuit

SETTLING_CONSTANTS = 5.0
"""Settling time in time constants; 0.7 % of a step remains after it."""
MIN_RESPONSE = 0.5
"""Smallest response to the light, relative to that at the datasheet's wavelength, that causes no warning."""
MAX_EXPONENT_DEVIATION = 0.05
"""Largest deviation from the exponent 1 of a flat window that causes no warning."""
VISIBLE_PART = "TEMT7000X01"


def cautions(
    circuit: Circuit, advice: Advice, wavelength_nm: float, dark_V: float, *, in_space: bool, emitters: int = 1
) -> list[str]:
    """Return the warnings about a readout.

    Parameters
    ----------
    circuit, advice
        Circuit with typical parts, and the advice on its load.
    wavelength_nm
        Wavelength of the traced light.
    dark_V
        Highest reading, with the emitter off.
    in_space
        Whether rays were traced in space rather than in the plane.
    emitters
        Number of emitters that are switched in sequence, each followed by an off phase.
    """
    sentences = [
        *_wavelength(circuit, wavelength_nm),
        *_voltages(circuit, advice),
        *_limits(circuit, dark_V),
        *_timing(circuit, emitters),
    ]
    if not in_space:
        sentences.append(
            "the powers come from rays in the plane, so light emitted out of the plane is assumed to arrive in the "
            'same fractions; set trace.dimension = "extruded" to trace this light'
        )
    return sentences


def _wavelength(circuit: Circuit, wavelength_nm: float) -> Iterator[str]:
    part, drive = circuit.transistor, circuit.drive
    if part.response < MIN_RESPONSE:
        yield (
            f"the sensitivity of {part.name} at {wavelength_nm:g} nm is {100.0 * part.response:.2g} % of its specified "
            f"sensitivity, which reduces the signal by a factor of {1.0 / part.response:.3g}; "
            f"{_remedy(part.name)}"
        )
    if abs(drive.peak_nm - wavelength_nm) > MAX_PEAK_DIFFERENCE_NM:
        yield (
            f"the power is that of {drive.name}, which emits at {drive.peak_nm:g} nm, but the light is traced at "
            f"{wavelength_nm:g} nm: set readout.emitter_part to the emitter of this design"
        )
    if abs(part.exponent - 1.0) > MAX_EXPONENT_DEVIATION:
        yield (
            f"the response of {part.name} is directional, cos^{part.exponent:.3g}: the reading depends on the "
            "alignment of the receiver, whose axis is assumed to be perpendicular to the face"
        )


def _remedy(name: str) -> str:
    example = "" if name == VISIBLE_PART else f", e.g. {VISIBLE_PART} for visible light"
    return f"set readout.part to a receiver for this wavelength{example}"


def _voltages(circuit: Circuit, advice: Advice) -> Iterator[str]:
    typical, brightest = advice.of("typical"), advice.of("brightest")
    load = circuit.load_ohm[0]
    if typical.saturates:
        yield (
            f"typical parts saturate: {typical.volts_bright:.2f} V at the brightest angle, but the voltage follows the "
            f"light only down to {advice.target_V:.2f} V; use a load of at most {typical.largest_ohm:.0f} ohm instead "
            f"of {load:g} ohm"
        )
    elif brightest.saturates:
        yield (
            f"the brightest parts saturate with a load of {load:g} ohm, but typical parts do not: the brightest parts "
            f"require at most {brightest.largest_ohm:.0f} ohm"
        )
    if advice.emitter_current_mA is None:
        yield (
            "no allowed emitter current brings the load for all parts within the trimmer's range: "
            "select parts, or use another trimmer"
        )


def _limits(circuit: Circuit, dark_V: float) -> Iterator[str]:
    part, drive, adc = circuit.transistor, circuit.drive, circuit.adc
    if drive.current_mA > drive.max_current_mA:
        yield (
            f"the emitter current of {drive.current_mA:g} mA exceeds the {drive.max_current_mA:g} mA "
            f"that {drive.name} may carry continuously: reduce readout.emitter_current_ma"
        )
    if circuit.supply_V > part.max_supply_V:
        yield (
            f"the supply voltage of {circuit.supply_V:g} V exceeds the {part.max_supply_V:g} V that {part.name} "
            "tolerates: reduce readout.supply_v"
        )
    max_mA = 1e3 * circuit.supply_V / min(circuit.load_ohm)
    if max_mA > part.max_current_mA:
        yield (
            f"a load of {min(circuit.load_ohm):g} ohm allows up to {max_mA:.3g} mA, which exceeds the "
            f"{part.max_current_mA:g} mA that {part.name} may carry: increase the load"
        )
    if dark_V > adc.top_V or min(0.0, part.saturation_V) < adc.low_V:
        yield (
            f"readings up to {dark_V:.3g} V with the emitter off are outside the range of {adc.name}, {adc.low_V:g} to "
            f"{adc.high_V:g} V: they are clipped, and ambient light is not fully subtracted; set readout.adc_range_v"
        )


def _timing(circuit: Circuit, emitters: int) -> Iterator[str]:
    tau_us, slot_us = float(circuit.time_constant_us.max()), 0.5e6 / (circuit.rate_hz * emitters)
    if SETTLING_CONSTANTS * tau_us > slot_us:
        yield (
            f"the receivers need about {SETTLING_CONSTANTS * tau_us:.0f} µs to settle after switching, but a phase "
            f"lasts only {slot_us:.0f} µs at {circuit.rate_hz:g} Hz: reduce the load or the rate"
        )
