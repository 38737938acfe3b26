"""Advice on the load: the widest range of readings without saturation, for the dimmest to the brightest parts.

The brightest reading of the motion may drop to a target several knee widths above saturation, where the current is
reduced by less than one per cent. The load for this target is R = (V_supply − V_target)/I_brightest. The target is the
same for all parts but the load is not, so a trimmer should be set by the reading and not by its resistance.

Public names: `advise`, `Advice`, `Setting`, `end_ohm` and `slopes_V_per_deg`.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.parts import TrimmerPart
from solen.readout.circuit import Case, Circuit, Floats, cases_of
from solen.readout.emitter import REFERENCE_C

TARGET_KNEES = 5.0
"""Target above the saturation voltage, in knee widths; there the current is reduced by e⁻⁵, 0.7 %."""
MAX_TRIMMER_FRACTION = 0.9
"""Largest load that the dimmest parts may require, as a fraction of a trimmer's minimum end-to-end resistance."""


@dataclass(frozen=True)
class Setting:
    """A set of parts with the present load, and the best load for it.

    Attributes
    ----------
    case
        Set of parts: ``dimmest``, ``typical`` or ``brightest``.
    volts_bright, volts_dark
        Lowest and highest reading over the motion.
    used
        Range of the readings as a fraction of the supply voltage.
    saturates
        Whether the lowest reading is below the target.
    largest_ohm
        Load that brings the lowest reading to the target.
    set_ohm
        The nearest load within the trimmer's range.
    turn
        Trimmer position for ``largest_ohm``, from 0 to 1; None if out of range.
    used_then
        Range of the readings with ``set_ohm``, as a fraction of the supply voltage.
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

    Attributes
    ----------
    target_V
        Target of the lowest reading.
    settings
        Settings for the dimmest, the typical and the brightest parts.
    emitter_current_mA
        Emitter current at which the trimmer can be set for all three sets; None if no current up to the emitter's
        continuous rating allows it.
    """

    target_V: float
    settings: tuple[Setting, ...]
    emitter_current_mA: float | None

    def of(self, case: Case) -> Setting:
        """Return the setting for a set of parts."""
        return next(setting for setting in self.settings if setting.case == case)


def advise(
    circuit: Circuit,
    power_fraction: FloatArray,
    trimmer: TrimmerPart,
    ambient_mW_cm2: Floats = 0.0,
    temperature_C: float = REFERENCE_C,
) -> Advice:
    """Return advice on the load for the readings over a motion.

    Parameters
    ----------
    circuit
        Circuit with typical parts.
    power_fraction
        Fractions (A, R) at the angles of the motion.
    trimmer
        The trimmer that sets the loads.
    ambient_mW_cm2, temperature_C
        Equivalent irradiance of the ambient light, and temperature: a single number, or one for each angle or reading.
    """
    part = circuit.transistor
    target = min(part.saturation_V + TARGET_KNEES * part.knee_V, 0.5 * (part.saturation_V + circuit.supply_V))
    light = (power_fraction, ambient_mW_cm2, temperature_C)
    settings = tuple(_setting(case, parts, light, trimmer, target) for case, parts in cases_of(circuit).items())
    return Advice(target, settings, _emitter_mA(circuit, light, trimmer, target))


def _emitter_mA(
    circuit: Circuit, light: tuple[FloatArray, Floats, float], trimmer: TrimmerPart, target_V: float
) -> float | None:
    """Return the emitter current at which the trimmer can be set for both the dimmest and the brightest parts, or None.

    The emitted power is assumed to be proportional to the current.
    """
    fractions, *background = light
    end_to_end_ohm = trimmer.resistance_ohm.min or trimmer.resistance_ohm.nominal
    signal_mA, dark_mA = {}, {}
    for case, parts in cases_of(circuit).items():
        dark = parts.current_mA(np.zeros_like(fractions), *background)
        dark_mA[case] = float(dark.max())
        signal_mA[case] = float((parts.current_mA(*light) - dark).max())
    if not signal_mA["dimmest"] > 0.0:
        return None
    wanted_mA = _target_mA(circuit, target_V) / (1e-3 * MAX_TRIMMER_FRACTION * end_to_end_ohm)
    factor = (wanted_mA - dark_mA["dimmest"]) / signal_mA["dimmest"]
    emitter_mA = factor * circuit.drive.current_mA
    load_ohm = 1e3 * _target_mA(circuit, target_V) / (factor * signal_mA["brightest"] + dark_mA["brightest"])
    return emitter_mA if 0.0 < emitter_mA <= circuit.drive.max_current_mA and load_ohm >= end_ohm(trimmer) else None


def end_ohm(trimmer: TrimmerPart) -> float:
    """Return the largest residual resistance of a trimmer."""
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
    brightest_mA = float(current.max())
    largest_ohm = 1e3 * _target_mA(circuit, target_V) / brightest_mA if brightest_mA > 0.0 else math.inf
    end_to_end_ohm = trimmer.resistance_ohm.nominal
    set_ohm = min(max(largest_ohm, end_ohm(trimmer)), end_to_end_ohm)
    then = circuit.with_load(set_ohm).load_line(current).volts
    return Setting(
        case=case,
        volts_bright=low,
        volts_dark=high,
        used=(high - low) / circuit.supply_V,
        saturates=low < target_V,
        largest_ohm=largest_ohm,
        set_ohm=set_ohm,
        turn=largest_ohm / end_to_end_ohm if end_ohm(trimmer) <= largest_ohm <= end_to_end_ohm else None,
        used_then=float(then.max() - then.min()) / circuit.supply_V,
    )


def _target_mA(circuit: Circuit, target_V: float) -> float:
    """Return the photocurrent that brings the reading to the target with a load of 1 kΩ."""
    part = circuit.transistor
    return (circuit.supply_V - target_V) / -math.expm1(-(target_V - part.saturation_V) / part.knee_V)


def slopes_V_per_deg(angle_deg: FloatArray, volts: FloatArray) -> FloatArray:
    """Return dV/dangle of voltages (A, R) at angles (A,) in ascending order, from differences of second-order accuracy.

    It is 0 for a single angle.
    """
    if len(angle_deg) < 2:
        return np.zeros_like(volts)
    return np.asarray(np.gradient(volts, angle_deg, axis=0, edge_order=2 if len(angle_deg) > 2 else 1))
