"""Where another emitter or receiver would help a network most: places tried one by one, ranked by what they determine.

The idea: a part added to a network takes light from the others and moves corners, so nothing short of tracing it again
says what it brings. Every place is tried roughly, and the best of each kind again to the full tolerance, with the same
function and so the same numbers that the changed design file gives.

Places tried are ends of guides where nothing stands, for a receiver, or a lens with its emitter; and at a quarter, half
and three quarters of every side, where there is room, for a receiver or an emitter without a lens.
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
"""Where on a side places are tried."""
WIDTH_MM = 2.0
"""Length of a receiver on a side where the network has none; else that of the middle one of its own."""
ROUGH_TOLERANCE, TRIED_AGAIN = 1e-3, 3
"""Uncertainty of the powers of the first trial, and how many places of each kind are tried again."""

Tables = Mapping[str, Sequence[Mapping[str, object]]]


def suggestions(
    design: Design, tolerance: float = SLOPE_TOLERANCE, progress: Progress | None = None
) -> tuple[Suggestion, ...]:
    """Places where another receiver or emitter would help a network most, the best first.

    The best `TRIED_AGAIN` of each kind that improve on the network as it is (`Determination.improves_on`). By the
    worst standard deviation of a motion with the motions as they stand, after the number of combinations that are
    determined.

    Parameters
    ----------
    design
        The network, its motions as they stand.
    tolerance
        Uncertainty of the powers, as of `network_sensitivities`.
    progress
        Called with the completed share, up to 1.

    Raises
    ------
    DesignError
        If the network is drawn, so that no part can be added.
    """
    if design.body.file is not None:
        limit, remedy = "is drawn: no part can be added to it", "draw it, and compare by solen sensitivity"
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
    """A trial with what it gives; None where it cannot be built."""
    part, place, tables = trial
    try:
        found = network_sensitivities(_with(design, tables), tolerance=tolerance).by_voltages
    except SolenError:
        return None
    if found is None or len(found.motions) < len(design.network.motion):
        return None
    return trial, Suggestion(part, place, _toml(tables), found.worst_sd_deg, found.rank, found)


def _apparent(one: Suggestion) -> float:
    """Worst standard deviation of a motion as if every combination were determined: to rank rough trials by."""
    rows = np.array([list(each.shares.values()) for each in one.by_voltages.combinations])
    values = np.array([each.singular_per_deg for each in one.by_voltages.combinations])
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.sqrt(np.max(np.sum((rows / values[:, None]) ** 2, axis=0))))


def _with(design: Design, tables: Tables) -> Design:
    """Design with tables added to the lists of its network."""
    network = design.network.model_dump(exclude_defaults=True)
    return with_values(design, {"network": network | {key: [*network.get(key, ()), *tables[key]] for key in tables}})


def _places(design: Design) -> Iterator[Trial]:
    """Parts that may be added, where, and their tables."""
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
    """The same on the sides of guides."""
    lengths = [one.to_mm - one.from_mm for one in design.network.receivers if one.to_mm and one.from_mm is not None]
    width = median(lengths) if lengths else WIDTH_MM
    for name, way in at_rest(design).ways.items():
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
    """A name that no part of a network has: ``tip``, or else ``tip-2``."""
    network = design.network
    taken = {one.name for many in (network.lenses, network.emitters, network.receivers) for one in many}
    number = 1
    while (new := name if number == 1 else f"{name}-{number}") in taken:
        number += 1
    return new


def _toml(tables: Tables) -> str:
    """Tables as they are added to a design file."""
    parts = (
        "\n".join([f"[[network.{key}]]", *(f"{name} = {json.dumps(value)}" for name, value in one.items())])
        for key, many in tables.items()
        for one in many
    )
    return "\n\n".join(parts)
