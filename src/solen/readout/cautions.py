"""Warnings about a readout: `cautions` checks a circuit, its load advice and its light."""

from collections.abc import Iterator

from solen.parts.light import FAR_NM
from solen.readout.advice import Advice
from solen.readout.circuit import Circuit

SETTLED = 5.0
"""Number of time constants after which 0.7 % of a step remains."""
DIM, OTHER_WINDOW = 0.5, 0.05
FOR_VISIBLE = "TEMT7000X01"


def cautions(
    circuit: Circuit, advice: Advice, wavelength_nm: float, dark_V: float, *, in_space: bool, emitters: int = 1
) -> list[str]:
    """Warnings about a readout; empty if there are none.

    Parameters
    ----------
    circuit, advice
        Circuit with typical parts, and the advice on its loads.
    wavelength_nm
        Wavelength of the traced light.
    dark_V
        Highest reading, i.e. with the emitter off.
    in_space
        Whether rays were traced in space rather than in the plane.
    emitters
        Number of emitters that are switched in sequence, each followed by an off phase.
    """
    sentences = [
        *_wavelength(circuit, wavelength_nm),
        *_range(circuit, advice),
        *_limits(circuit, dark_V),
        *_time(circuit, emitters),
    ]
    if not in_space:
        sentences.append(
            "the powers come from rays in the plane, so light emitted above and below the plane is assumed to "
            "arrive in the same "
            'fractions; use trace.dimension = "extruded" to trace it'
        )
    return sentences


def _wavelength(circuit: Circuit, wavelength_nm: float) -> Iterator[str]:
    part, drive = circuit.transistor, circuit.drive
    if part.response < DIM:
        yield (
            f"the sensitivity of {part.name} at {wavelength_nm:g} nm is {100.0 * part.response:.2g} % of its specified "
            f"sensitivity, which reduces the signal by a factor of {1.0 / part.response:.3g}; "
            f"{_remedy(part.name)} (readout.part)"
        )
    if abs(drive.peak_nm - wavelength_nm) > FAR_NM:
        yield (
            f"the power is specified for {drive.name}, which emits at {drive.peak_nm:g} nm, but the light is traced at "
            f"{wavelength_nm:g} nm: name the emitter of this design (readout.emitter_part)"
        )
    if abs(part.exponent - 1.0) > OTHER_WINDOW:
        yield (
            f"{part.name} is directional, cos^{part.exponent:.3g}: its reading depends on its alignment with the "
            "face, to which its axis is assumed to be perpendicular"
        )


def _remedy(name: str) -> str:
    other = "" if name == FOR_VISIBLE else f", e.g. {FOR_VISIBLE} for visible light"
    return f"choose a receiver for this wavelength{other}"


def _range(circuit: Circuit, advice: Advice) -> Iterator[str]:
    usual, bright = advice.of("typical"), advice.of("brightest")
    load = circuit.load_ohm[0]
    if usual.saturates:
        yield (
            f"typical parts saturate: {usual.volts_bright:.2f} V at the brightest angle, but the voltage "
            "follows the light only "
            f"down to {advice.target_V:.2f} V; use a load of at most {usual.largest_ohm:.0f} ohm instead of "
            f"{load:g} ohm"
        )
    elif bright.saturates:
        yield (
            f"the brightest parts saturate at {load:g} ohm, but typical parts do not: the brightest parts "
            f"require at most {bright.largest_ohm:.0f} ohm"
        )
    if advice.emitter_current_mA is None:
        yield (
            "no allowed emitter current brings all parts within the trimmer's range: select parts, or use another load"
        )


def _limits(circuit: Circuit, dark_V: float) -> Iterator[str]:
    part, drive, adc = circuit.transistor, circuit.drive, circuit.adc
    if drive.current_mA > drive.max_current_mA:
        yield (
            f"the emitter current of {drive.current_mA:g} mA exceeds the {drive.max_current_mA:g} mA "
            f"that {drive.name} may carry continuously"
        )
    if circuit.supply_V > part.max_supply_V:
        yield (
            f"the supply voltage of {circuit.supply_V:g} V exceeds the {part.max_supply_V:g} "
            f"V that {part.name} tolerates"
        )
    max_mA = 1e3 * circuit.supply_V / min(circuit.load_ohm)
    if max_mA > part.max_current_mA:
        yield (
            f"a load of {min(circuit.load_ohm):g} ohm allows up to {max_mA:.3g} mA, which exceeds the "
            f"{part.max_current_mA:g} mA that {part.name} may carry"
        )
    if dark_V > adc.top_V or min(0.0, part.saturation_V) < adc.low_V:
        yield (
            f"dark readings of {dark_V:.3g} V are outside the range of {adc.name}, {adc.low_V:g} to "
            f"{adc.high_V:g} V, so "
            "they are clipped, and with them the ambient light to be subtracted"
        )


def _time(circuit: Circuit, emitters: int) -> Iterator[str]:
    tau_us, slot_us = float(circuit.time_constant_us.max()), 0.5e6 / (circuit.rate_hz * emitters)
    if SETTLED * tau_us > slot_us:
        yield (
            f"after switching, the receivers need about {SETTLED * tau_us:.0f} µs to settle, but a slot at "
            f"{circuit.rate_hz:g} Hz "
            f"lasts only {slot_us:.0f} µs: reduce the load or the rate"
        )
