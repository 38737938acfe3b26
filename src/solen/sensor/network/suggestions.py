"""Most useful positions for another emitter or receiver of a network: positions are tried in turn and ranked.

A part added to a network takes light from the others and moves corners, so its effect is found by tracing the network
with the part. Every position is first traced with a large tolerance. The best positions of each kind are traced again
with the full tolerance, by the function that also traces the changed design file, so that the numbers agree.

The positions are guide ends without a part, for a receiver or for a lens with its emitter; and a quarter, half and
three quarters of the length of every side, if free, for a receiver or an emitter without a lens.

Public name: `suggestions`.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from statistics import median

import numpy as np

from solen.curve.length import ArcLength
from solen.errors import DesignError, SolenError
from solen.geometry.network import at_rest
from solen.progress import Progress, part_of, tracked
from solen.sensor.network.motions import Suggestion
from solen.sensor.network.slopes import SLOPE_TOLERANCE, network_sensitivities
from solen.spec import Design, with_values

SIDE_FRACTIONS = (0.25, 0.5, 0.75)
"""Positions on a side that are tried, as fractions of its length."""
WIDTH_MM = 2.0
"""Length of a receiver on a side in a network without one; otherwise, it is the median length of those present."""
TRIAL_TOLERANCE, RETRIED = 1e-3, 3
"""Power uncertainty in the first trial, and number of positions of each kind that are tried again."""

Tables = Mapping[str, Sequence[Mapping[str, object]]]


def suggestions(
    design: Design, tolerance: float = SLOPE_TOLERANCE, progress: Progress | None = None
) -> tuple[Suggestion, ...]:
    """Return positions at which another receiver or emitter would improve a network most, the best first.

    These are the best `RETRIED` of each kind that improve on the original network (`Determination.improves_on`).
    They are ranked by the number of determined combinations, then by the worst standard deviation of a motion at rest.

    Parameters
    ----------
    design
        The network, with its motions at rest.
    tolerance
        Uncertainty of the powers, as in `network_sensitivities`.
    progress
        Function called with the completed fraction, up to 1.

    Raises
    ------
    DesignError
        If the network is drawn, since no part can then be added.
    """
    if design.body.file is not None:
        limit, remedy = "is drawn: no part can be added to it", "draw the part, and compare with solen sensitivity"
        raise DesignError("body.file", value=design.body.file, limit=limit, remedy=remedy)
    trials = [(part, place, dict(tables)) for part, place, tables in _trials(design)]
    trial_count, count = len(trials), len(trials) + 2 * RETRIED
    rough_tolerance = max(tolerance, TRIAL_TOLERANCE)
    rough = [
        (trial, suggestion)
        for trial in tracked(trials, part_of(progress, 0, count, trial_count))
        if (suggestion := _suggestion(design, trial, rough_tolerance)) is not None
    ]
    retried = []
    for kind in ("receiver", "emitter"):
        ranked = sorted((each for each in rough if each[1].part == kind), key=lambda each: _apparent_sd_deg(each[1]))
        retried += [trial for trial, _ in ranked[:RETRIED]]
    rest = part_of(progress, trial_count, count, count - trial_count)
    best = [_suggestion(design, trial, tolerance) for trial in tracked(retried, rest)]
    current = network_sensitivities(design, tolerance=tolerance).by_voltages
    improvements = [each for each in best if each and (current is None or each.by_voltages.improves_on(current))]
    return tuple(sorted(improvements, key=lambda each: (-each.rank, each.worst_sd_deg)))


Trial = tuple[str, str, Tables]


def _suggestion(design: Design, trial: Trial, tolerance: float) -> Suggestion | None:
    """Return the result of a trial; None if the network cannot be built."""
    part, place, tables = trial
    try:
        determination = network_sensitivities(_with(design, tables), tolerance=tolerance).by_voltages
    except SolenError:
        return None
    if determination is None or len(determination.motions) < len(design.network.motion):
        return None
    return Suggestion(part, place, _toml(tables), determination.worst_sd_deg, determination.rank, determination)


def _apparent_sd_deg(suggestion: Suggestion) -> float:
    """Return the worst standard deviation of a motion as if all combinations were determined, to rank first trials."""
    combinations = suggestion.by_voltages.combinations
    rows = np.array([list(combination.shares.values()) for combination in combinations])
    values = np.array([combination.singular_per_deg for combination in combinations])
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.sqrt(np.max(np.sum((rows / values[:, None]) ** 2, axis=0))))


def _with(design: Design, tables: Tables) -> Design:
    """Return the design with tables added to the lists of its network."""
    network = design.network.model_dump(exclude_defaults=True)
    return with_values(design, {"network": network | {key: [*network.get(key, ()), *tables[key]] for key in tables}})


def _trials(design: Design) -> Iterator[Trial]:
    """Yield parts that can be added, each with its position and tables."""
    network = design.network
    occupied = {part.node for part in (*network.lenses, *network.emitters, *network.receivers)}
    for node in network.nodes:
        if sum(node.name in guide.nodes for guide in network.guides) == 1 and node.name not in occupied:
            name, end = _new_name(design, node.name), f"end {node.name}"
            yield "receiver", end, {"receivers": [{"name": name, "node": node.name}]}
            lens = {"lenses": [{"name": name, "node": node.name}], "emitters": [{"name": name, "lens": name}]}
            yield "emitter", f"{end}, with a lens", lens
    yield from _on_sides(design)


def _on_sides(design: Design) -> Iterator[Trial]:
    """Yield parts that can be added to the sides of guides, each with its position and tables."""
    lengths = [
        receiver.to_mm - receiver.from_mm
        for receiver in design.network.receivers
        if receiver.to_mm and receiver.from_mm is not None
    ]
    width = median(lengths) if lengths else WIDTH_MM
    for name, guide_path in at_rest(design).paths.items():
        for side, wall in guide_path.walls.items():
            length = ArcLength(wall).length_mm
            new = _new_name(design, f"{name}-{side}")
            for fraction in SIDE_FRACTIONS:
                at_mm = round(fraction * length, 1)
                from_mm, to_mm = round(at_mm - 0.5 * width, 2), round(at_mm + 0.5 * width, 2)
                if from_mm < 0.0 or to_mm > length:
                    continue
                side_part: dict[str, object] = {"name": new, "guide": name, "side": side}
                side_text = f"{side} side of {name}"
                receiver = {"receivers": [side_part | {"from_mm": from_mm, "to_mm": to_mm}]}
                yield "receiver", f"{side_text}, {from_mm:g} to {to_mm:g} mm", receiver
                yield "emitter", f"{side_text} at {at_mm:g} mm", {"emitters": [side_part | {"at_mm": at_mm}]}


def _new_name(design: Design, name: str) -> str:
    """Return a name that no part of a network has: ``tip``, or ``tip-2`` if ``tip`` is taken."""
    network = design.network
    names = {part.name for part in (*network.lenses, *network.emitters, *network.receivers)}
    number = 1
    while (new := name if number == 1 else f"{name}-{number}") in names:
        number += 1
    return new


def _toml(tables: Tables) -> str:
    """Format tables for a design file."""
    texts = (
        "\n".join([f"[[network.{key}]]", *(f"{name} = {json.dumps(value)}" for name, value in part.items())])
        for key, parts in tables.items()
        for part in parts
    )
    return "\n\n".join(texts)
