"""Which load keeps the range of a motion inside the supply, for the dimmest and the brightest parts that one may get.

The idea: the brightest reading of the motion may come down to a target, some knees above saturation, where the current
falls short by less than one percent. The load that brings it there is R = (V_supply − V_target)/I_brightest. The target
is the same for all parts, and the load is not: so the load is set by what the receiver reads, not by a number of ohms.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.parts import TrimmerPart
from solen.readout.circuit import Case, Circuit, Floats, spread
from solen.readout.emitter import REFERENCE_C

KNEES = 5.0
"""Knees above saturation that the target stands: there the current falls short by e⁻⁵, 0.7 %."""
ROOM = 0.9
"""Share of the smallest whole resistance of a trimmer that the dimmest parts may need."""


@dataclass(frozen=True)
class Setting:
    """One set of parts on the load as it is, and the load that suits it.

    ``volts_bright`` and ``volts_dark`` are the lowest and the highest reading over the motion; ``used`` is the share of
    the supply between them. ``largest_ohm`` is the load that brings the lowest to the target, ``turn`` the share of the
    trimmer that this is, None if the trimmer does not reach it; with the nearest it reaches, ``set_ohm``,
    ``used_then`` of the supply is used. ``saturates`` says whether the load as it is goes below the target.
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
    """Settings of the three sets of parts, and what they are set to.

    ``emitter_current_mA`` is the emitter's current with which the trimmer suits all three; None if there is none
    that the emitter may carry steadily.
    """

    target_V: float
    settings: tuple[Setting, ...]
    emitter_current_mA: float | None

    def of(self, case: Case) -> Setting:
        """Setting of a set of parts."""
        return next(setting for setting in self.settings if setting.case == case)


def advise(
    circuit: Circuit,
    power_fraction: FloatArray,
    trimmer: TrimmerPart,
    ambient_mW_cm2: Floats = 0.0,
    temperature_C: float = REFERENCE_C,
) -> Advice:
    """Loads for the range of a motion.

    Parameters
    ----------
    circuit
        With typical parts.
    power_fraction
        Shape (A, R): at the angles of the motion.
    trimmer
        What the loads are set with.
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
    """Current of the emitter with which the dimmest parts need most of the smallest trimmer, the brightest not its end.

    Light is taken as proportional to the current.
    """
    cases, (fractions, *around) = spread(circuit), light
    whole = trimmer.resistance_ohm.least or trimmer.resistance_ohm.usual
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
    return emitter_mA if 0.0 < emitter_mA <= circuit.drive.most_current_mA and needs_ohm >= end_ohm(trimmer) else None


def end_ohm(trimmer: TrimmerPart) -> float:
    """Largest resistance of a trimmer at its end."""
    end = trimmer.end_ohm
    return 0.0 if end is None else end.most or end.usual


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
    whole = trimmer.resistance_ohm.usual
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
    """Load that brings the brightest reading to the target, the knee included."""
    return _target_mA(circuit, target_V) / most_mA if most_mA > 0.0 else math.inf


def _target_mA(circuit: Circuit, target_V: float) -> float:
    """Current that light must ask for to bring a load of 1 kΩ to the target."""
    part = circuit.transistor
    return (circuit.supply_V - target_V) / -math.expm1(-(target_V - part.saturation_V) / part.knee_V)


def slopes_V_per_deg(angle_deg: FloatArray, volts: FloatArray) -> FloatArray:
    """Change of volts (A, R) per degree along ascending angles (A,): central differences; 0 for a single angle."""
    if len(angle_deg) < 2:
        return np.zeros_like(volts)
    return np.asarray(np.gradient(volts, angle_deg, axis=0))
