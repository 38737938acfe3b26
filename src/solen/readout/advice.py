"""Advice on the load that keeps readings within the supply voltage, for the dimmest and the brightest parts.

The brightest reading of the motion may drop to a target, several knee widths above saturation, where the current is
reduced by less than one per cent. The load for this target is R = (V_supply − V_target)/I_brightest. The target is the
same for all parts but the load is not, so the load should be adjusted by the reading and not by its resistance.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.parts import TrimmerPart
from solen.readout.circuit import Case, Circuit, Floats, spread
from solen.readout.emitter import REFERENCE_C

KNEES = 5.0
"""Height of the target above saturation in knee widths; there the current is reduced by e⁻⁵, 0.7 %."""
ROOM = 0.9
"""Fraction of a trimmer's minimum end-to-end resistance that the dimmest parts may require."""


@dataclass(frozen=True)
class Setting:
    """A set of parts with the present load, and the load that suits it.

    ``volts_bright`` and ``volts_dark`` are the lowest and the highest reading over the motion; ``used`` is the fraction
    of the supply voltage between them. ``largest_ohm`` is the load that brings the lowest reading to the target, and
    ``turn`` the trimmer position for this load, None if out of range. With the nearest possible load, ``set_ohm``,
    ``used_then`` is the fraction of the supply voltage used. ``saturates`` is true if the reading with the present load
    is below the target.
    """

    case: Case
    volts_bright: float
    volts_dark: float
    used: float
    saturates: bool
    largest_ohm: float
    set_ohm: float
    turn: float | None
    used_then: float


@dataclass(frozen=True)
class Advice:
    """Settings for the three sets of parts, and their common target.

    ``emitter_current_mA`` is the emitter current at which the trimmer suits all three sets; None if no current within
    the emitter's continuous rating suits them.
    """

    target_V: float
    settings: tuple[Setting, ...]
    emitter_current_mA: float | None

    def of(self, case: Case) -> Setting:
        """Setting for a set of parts."""
        return next(setting for setting in self.settings if setting.case == case)


def advise(
    circuit: Circuit,
    power_fraction: FloatArray,
    trimmer: TrimmerPart,
    ambient_mW_cm2: Floats = 0.0,
    temperature_C: float = REFERENCE_C,
) -> Advice:
    """Compute the load advice for the range of a motion.

    Parameters
    ----------
    circuit
        Circuit with typical parts.
    power_fraction
        Fractions (A, R) at the angles of the motion.
    trimmer
        The trimmer that sets the loads.
    ambient_mW_cm2, temperature_C
        As in `Circuit.current_mA`.
    """
    part = circuit.transistor
    target = min(part.saturation_V + KNEES * part.knee_V, 0.5 * (part.saturation_V + circuit.supply_V))
    light = (power_fraction, ambient_mW_cm2, temperature_C)
    settings = tuple(_setting(case, one, light, trimmer, target) for case, one in spread(circuit).items())
    return Advice(target, settings, _emitter_mA(circuit, light, trimmer, target))


def _emitter_mA(
    circuit: Circuit, light: tuple[FloatArray, Floats, float], trimmer: TrimmerPart, target_V: float
) -> float | None:
    """Emitter current at which the trimmer suits both the dimmest and the brightest parts.

    Light is assumed proportional to the current.
    """
    cases, (fractions, *around) = spread(circuit), light
    whole = trimmer.resistance_ohm.min or trimmer.resistance_ohm.nominal
    asked, rest = {}, {}
    for case, one in cases.items():
        dark = one.current_mA(np.zeros_like(fractions), *around)
        rest[case] = float(dark.max())
        asked[case] = float((one.current_mA(*light) - dark).max())
    wanted = _target_mA(circuit, target_V) / (1e-3 * ROOM * whole)
    if not asked["dimmest"] > 0.0:
        return None
    times = (wanted - rest["dimmest"]) / asked["dimmest"]
    emitter_mA = times * circuit.drive.current_mA
    needs_ohm = 1e3 * _target_mA(circuit, target_V) / (times * asked["brightest"] + rest["brightest"])
    return emitter_mA if 0.0 < emitter_mA <= circuit.drive.max_current_mA and needs_ohm >= end_ohm(trimmer) else None


def end_ohm(trimmer: TrimmerPart) -> float:
    """Largest residual resistance of a trimmer."""
    end = trimmer.end_ohm
    return 0.0 if end is None else end.max or end.nominal


def _setting(
    case: Case,
    circuit: Circuit,
    light: tuple[FloatArray, Floats, float],
    trimmer: TrimmerPart,
    target_V: float,
) -> Setting:
    current = circuit.current_mA(*light)
    volts = circuit.load_line(current).volts
    low, high = float(volts.min()), float(volts.max())
    largest = 1e3 * _load_kohm(circuit, float(current.max()), target_V)
    whole = trimmer.resistance_ohm.nominal
    chosen = min(max(largest, end_ohm(trimmer)), whole)
    then = circuit.with_load(chosen).load_line(current).volts
    return Setting(
        case=case,
        volts_bright=low,
        volts_dark=high,
        used=(high - low) / circuit.supply_V,
        saturates=low < target_V,
        largest_ohm=largest,
        set_ohm=chosen,
        turn=largest / whole if end_ohm(trimmer) <= largest <= whole else None,
        used_then=float(then.max() - then.min()) / circuit.supply_V,
    )


def _load_kohm(circuit: Circuit, most_mA: float, target_V: float) -> float:
    """Load that brings the brightest reading to the target, including the knee."""
    return _target_mA(circuit, target_V) / most_mA if most_mA > 0.0 else math.inf


def _target_mA(circuit: Circuit, target_V: float) -> float:
    """Photocurrent that brings the reading to the target with a load of 1 kΩ."""
    part = circuit.transistor
    return (circuit.supply_V - target_V) / -math.expm1(-(target_V - part.saturation_V) / part.knee_V)


def slopes_V_per_deg(angle_deg: FloatArray, volts: FloatArray) -> FloatArray:
    """Second-order derivative of voltages (A, R) with respect to ascending angles (A,); 0 for a single angle."""
    if len(angle_deg) < 2:
        return np.zeros_like(volts)
    return np.asarray(np.gradient(volts, angle_deg, axis=0, edge_order=2 if len(angle_deg) > 2 else 1))
