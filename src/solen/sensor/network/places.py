"""Most useful places for another emitter or receiver of a network: places are tried in turn and ranked.

A part added to a network takes light from the others and moves corners, so its effect can only be found by tracing the
network again. Every place is first traced with a large tolerance. The best places of each kind are traced again with
the full tolerance, by the same function, so the numbers equal those for the changed design file.

The places are guide ends without a part, for a receiver or for a lens with its emitter; and free positions at a
quarter, half and three quarters of every side, for a receiver or an emitter without a lens.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from statistics import median

import numpy as np

from solen.curve.length import Measure
from solen.errors import DesignError, SolenError
from solen.geometry.network import at_rest
from solen.progress import Progress, part_of, tracked
from solen.sensor.network.motions import Suggestion
from solen.sensor.network.slopes import SLOPE_TOLERANCE, network_sensitivities
from solen.spec import Design, with_values

SHARES = (0.25, 0.5, 0.75)
"""Places on a side that are tried, as fractions of its length."""
WIDTH_MM = 2.0
"""Length of a receiver on a side if the network has none there; otherwise the median length of those present is
used.
"""
ROUGH_TOLERANCE, TRIED_AGAIN = 1e-3, 3
"""Power uncertainty in the first trial, and number of places of each kind that are tried again."""

Tables = Mapping[str, Sequence[Mapping[str, object]]]


def suggestions(
    design: Design, tolerance: float = SLOPE_TOLERANCE, progress: Progress | None = None
) -> tuple[Suggestion, ...]:
    """Return places where another receiver or emitter would improve a network most, the best first.

    These are the best `TRIED_AGAIN` of each kind that improve on the original network (`Determination.improves_on`).
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
        limit, remedy = "is drawn: no part can be added to it", ("draw the part, and compare with solen sensitivity")
        raise DesignError("body.file", value=design.body.file, limit=limit, remedy=remedy)
    trials = [(part, place, dict(tables)) for part, place, tables in _places(design)]
    first, count = len(trials), len(trials) + 2 * TRIED_AGAIN
    turns = tracked(trials, part_of(progress, 0, count, first))
    rough = [found for trial in turns if (found := _tried(design, trial, max(tolerance, ROUGH_TOLERANCE)))]
    again = []
    for kind in ("receiver", "emitter"):
        mine = sorted((one for one in rough if one[1].part == kind), key=lambda one: _apparent(one[1]))
        again += [trial for trial, _ in mine[:TRIED_AGAIN]]
    best = [
        _tried(design, trial, tolerance) for trial in tracked(again, part_of(progress, first, count, count - first))
    ]
    now = network_sensitivities(design, tolerance=tolerance).by_voltages
    better = [one[1] for one in best if one and (now is None or one[1].by_voltages.improves_on(now))]
    return tuple(sorted(better, key=lambda one: (-one.rank, one.worst_sd_deg)))


Trial = tuple[str, str, Tables]


def _tried(design: Design, trial: Trial, tolerance: float) -> tuple[Trial, Suggestion] | None:
    """Return a trial with its result; None if the network cannot be built."""
    part, place, tables = trial
    try:
        found = network_sensitivities(_with(design, tables), tolerance=tolerance).by_voltages
    except SolenError:
        return None
    if found is None or len(found.motions) < len(design.network.motion):
        return None
    return trial, Suggestion(part, place, _toml(tables), found.worst_sd_deg, found.rank, found)


def _apparent(one: Suggestion) -> float:
    """Return the worst standard deviation of a motion if all combinations were determined, to rank first trials."""
    rows = np.array([list(each.shares.values()) for each in one.by_voltages.combinations])
    values = np.array([each.singular_per_deg for each in one.by_voltages.combinations])
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.sqrt(np.max(np.sum((rows / values[:, None]) ** 2, axis=0))))


def _with(design: Design, tables: Tables) -> Design:
    """Return the design with tables added to the lists of its network."""
    network = design.network.model_dump(exclude_defaults=True)
    return with_values(design, {"network": network | {key: [*network.get(key, ()), *tables[key]] for key in tables}})


def _places(design: Design) -> Iterator[Trial]:
    """Yield parts that can be added, with their places and tables."""
    network = design.network
    every = (*network.lenses, *network.emitters, *network.receivers)
    taken = {one.node for one in every}
    for node in network.nodes:
        if sum(node.name in guide.nodes for guide in network.guides) == 1 and node.name not in taken:
            name, end = _new_name(design, node.name), f"end {node.name}"
            yield "receiver", end, {"receivers": [{"name": name, "node": node.name}]}
            lens = {"lenses": [{"name": name, "node": node.name}], "emitters": [{"name": name, "lens": name}]}
            yield "emitter", f"{end}, with a lens", lens
    yield from _on_sides(design)


def _on_sides(design: Design) -> Iterator[Trial]:
    """Yield parts that can be added to the sides of guides."""
    lengths = [
        receiver.to_mm - receiver.from_mm
        for receiver in design.network.receivers
        if receiver.to_mm and receiver.from_mm is not None
    ]
    width = median(lengths) if lengths else WIDTH_MM
    for name, way in at_rest(design).paths.items():
        for side, wall in way.walls.items():
            length = Measure(wall).length_mm
            new = _new_name(design, f"{name}-{side}")
            for share in SHARES:
                at = round(share * length, 1)
                low, high = round(at - 0.5 * width, 2), round(at + 0.5 * width, 2)
                if low < 0.0 or high > length:
                    continue
                stands: dict[str, object] = {"name": new, "guide": name, "side": side}
                where = f"{side} side of {name}"
                receiver = {"receivers": [stands | {"from_mm": low, "to_mm": high}]}
                yield "receiver", f"{where}, {low:g} to {high:g} mm", receiver
                yield "emitter", f"{where} at {at:g} mm", {"emitters": [stands | {"at_mm": at}]}


def _new_name(design: Design, name: str) -> str:
    """Return a name that no part of a network has: ``tip``, or else ``tip-2``."""
    network = design.network
    taken = {one.name for many in (network.lenses, network.emitters, network.receivers) for one in many}
    number = 1
    while (new := name if number == 1 else f"{name}-{number}") in taken:
        number += 1
    return new


def _toml(tables: Tables) -> str:
    """Format tables for a design file."""
    parts = (
        "\n".join([f"[[network.{key}]]", *(f"{name} = {json.dumps(value)}" for name, value in one.items())])
        for key, many in tables.items()
        for one in many
    )
    return "\n\n".join(parts)
