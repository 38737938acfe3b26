"""Derivatives of a network's powers by its motions and its numbers, and which motions they tell apart.

The idea: light of a chip in a network is divided at many faces, and its integral is no smooth function to 1e-6, as a
derivative in the limit needs. So a derivative is a difference over a stated step, both ends sampled by the same rays.
Its uncertainty is that of the two powers; what curves within the step is part of the value.

The singular values of the derivatives by the motions say what the readings tell of them: a combination of motions whose
singular value is small changes all readings by little.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray, Progress
from solen.errors import SolenError, SpecError
from solen.ranks import look_at
from solen.results import Result
from solen.sensor.network.response import NetworkResponse, in_turn, network_response, unread_in
from solen.sensor.numbers import number, tolerance_of
from solen.spec import Design, value_at, with_values
from solen.spec.network import NamedMotion

SLOPE_TOLERANCE = 3e-4
"""Uncertainty of the powers that a difference is taken of."""
SURE = 2.0
"""How many uncertainties a singular value must exceed for a combination of motions to be determined."""


@dataclass(frozen=True)
class Combination:
    """A combination of motions, by their shares of a unit vector, and how much it changes all readings together.

    Attributes
    ----------
    shares
        By motion: angles whose squares add up to 1 deg².
    singular_per_deg, u_singular_per_deg
        Root of the sum of squares of the changes of all powers, per degree; its uncertainty is a bound.
    """

    shares: dict[str, float]
    singular_per_deg: float
    u_singular_per_deg: float


class NetworkSensitivities(Result):
    """Derivatives of a network's powers, by key, emitter and receiver.

    Attributes
    ----------
    name
        Name of the design.
    emitters, receivers, readings
        Their names.
    keys
        Keys of the numbers; those of motions end in ``at_deg``.
    value, step
        (keys,) value of each number, and half the difference between the two at which powers are taken.
    slope, u_slope
        (keys, emitters, receivers) derivative by the number, per its unit, and its uncertainty.
    reading_slope, u_reading_slope
        (keys, readings) derivative of each reading by the number, per its unit, NaN where it has none, and a bound of
        its uncertainty.
    skipped
        Reasons why numbers were left out, by key.
    combinations
        Combinations of the motions among the keys, from the best determined to the worst.
    told_apart
        Whether every one of them changes the readings by more than the uncertainty; None without a motion.
    warnings
        Warnings about the numbers.
    simulated
        Always true.
    """

    name: str
    emitters: tuple[str, ...]
    receivers: tuple[str, ...]
    readings: tuple[str, ...]
    keys: tuple[str, ...]
    value: FloatArray
    step: FloatArray
    slope: FloatArray
    u_slope: FloatArray
    reading_slope: FloatArray
    u_reading_slope: FloatArray
    skipped: dict[str, str]
    combinations: tuple[Combination, ...]
    told_apart: bool | None
    warnings: tuple[str, ...]
    simulated: bool = True


def network_sensitivities(
    design: Design,
    keys: Sequence[str] = (),
    tolerance: float = SLOPE_TOLERANCE,
    progress: Progress | None = None,
) -> NetworkSensitivities:
    """Derivatives of a network's powers by numbers of its design, and what they tell of its motions.

    Parameters
    ----------
    design
        The network, its motions as they stand.
    keys
        Dotted keys of numbers; default: the angles of its motions.
    tolerance
        Uncertainty of the powers that differences are taken of.
    progress
        Called with the completed share, up to 1.

    Raises
    ------
    SpecError
        If a key is not that of a real number stated in the design, or there is none.
    """
    sensors = in_turn(design)
    chosen = list(dict.fromkeys(keys)) or [f"network.motion[{i}].at_deg" for i in range(len(design.network.motion))]
    if not chosen:
        raise SpecError(
            "network.motion", limit="has no motions: name keys of the design", remedy="add [[network.motion]]"
        )
    for key in chosen:
        number(sensors[0], key)
    rows: list[tuple[str, float, float, FloatArray, FloatArray, FloatArray, FloatArray]] = []
    unread: dict[str, None] = {}
    skipped: dict[str, str] = {}
    rest: NetworkResponse | None = None
    for done, key in enumerate(chosen, start=1):
        value = number(sensors[0], key)
        low, high = _ends(design, key, value, tolerance_of(sensors[0], key)[0])
        try:
            ends = [network_response(with_values(design, {key: end}), [{}], tolerance) for end in (low, high)]
        except SolenError as bad:
            skipped[key] = f"not on both sides of {value:g}: {bad}"
        else:
            rest, step = ends[0], high - low
            u, u_read = (np.hypot(*sides) / step for sides in _pairs(ends, "u_power", "u_reading"))
            slope, read = ((after - before) / step for before, after in _pairs(ends, "power", "reading"))
            rows.append((key, value, 0.5 * step, slope, u, read, u_read))
            unread |= dict.fromkeys(text for end in ends for text in unread_in(end))
        if progress is not None:
            progress(done / len(chosen))
    if rest is None:
        key, why = next(iter(skipped.items()))
        raise SpecError(key, limit=why, remedy="name other keys")
    names, values, steps, slopes, u_slopes, read_slopes, u_read_slopes = zip(*rows, strict=True)
    motions = {f"network.motion[{i}].at_deg": one for i, one in enumerate(design.network.motion)}
    found = _combinations(motions, names, np.array(slopes), np.array(u_slopes))
    told = all(one.singular_per_deg > SURE * one.u_singular_per_deg for one in found) if found else None
    return NetworkSensitivities(
        name=design.name,
        emitters=rest.emitters,
        receivers=rest.receivers,
        readings=rest.readings,
        keys=names,
        value=np.array(values),
        step=np.array(steps),
        slope=np.array(slopes),
        u_slope=np.array(u_slopes),
        reading_slope=np.array(read_slopes),
        u_reading_slope=np.array(u_read_slopes),
        skipped=skipped,
        combinations=found,
        told_apart=told,
        warnings=(*dict.fromkeys(text for sensor in sensors for text in sensor.warnings), *unread, *_untold(found)),
    )


def _pairs(ends: Sequence[NetworkResponse], *names: str) -> list[list[FloatArray]]:
    """Arrays of two responses in one state, by the names of their fields."""
    return [[getattr(end, name)[0] for end in ends] for name in names]


def _ends(design: Design, key: str, value: float, tolerance: float) -> tuple[float, float]:
    """Values on either side of a number: by its tolerance, a motion by half a step of its range and within that."""
    holder, _, name = key.rpartition(".")
    motion = value_at(design, holder) if name == "at_deg" and holder.startswith("network.motion[") else None
    if not isinstance(motion, NamedMotion):
        return value - tolerance, value + tolerance
    half = 0.5 * (motion.to_deg - motion.from_deg) / motion.steps
    return max(motion.at_deg - half, motion.from_deg), min(motion.at_deg + half, motion.to_deg)


def _combinations(
    motions: dict[str, NamedMotion], keys: Sequence[str], slope: FloatArray, u_slope: FloatArray
) -> tuple[Combination, ...]:
    """Combinations of motions, from the best determined to the worst, by singular values of their derivatives."""
    places = [place for place, key in enumerate(keys) if key in motions]
    if not places:
        return ()
    names = [motions[keys[place]].name for place in places]
    jacobian = slope[places].reshape(len(places), -1).T
    _, singular, rows = np.linalg.svd(jacobian, full_matrices=False)
    u = math.sqrt(float(np.sum(u_slope[places] ** 2)))
    values = [*singular.tolist(), *[0.0] * (len(places) - len(singular))]
    rows = np.linalg.svd(jacobian)[2] if len(places) > len(singular) else rows
    shares = [dict(zip(names, row.tolist(), strict=True)) for row in rows]
    return tuple(Combination(share, value, u) for share, value in zip(shares, values, strict=True))


def _untold(found: Sequence[Combination]) -> list[str]:
    """Warnings about combinations of motions that the readings do not tell."""
    return [
        look_at(
            f"the readings do not tell this combination of motions: {words(one)}; together they change by "
            f"{one.singular_per_deg:.1e} ± {one.u_singular_per_deg:.1e} of the emitted power per degree"
        )
        for one in found
        if one.singular_per_deg <= SURE * one.u_singular_per_deg
    ]


def words(combination: Combination) -> str:
    """A combination of motions: ``+0.71 index, -0.70 ring``."""
    return ", ".join(f"{share:+.2f} {name}" for name, share in combination.shares.items())
