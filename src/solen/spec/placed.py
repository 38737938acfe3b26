"""Tables of the parts of a network: the shared tables of the design, overridden by the keys of each part."""

from collections.abc import Iterator, Mapping
from itertools import product
from typing import TYPE_CHECKING

from solen.errors import SpecError
from solen.spec.body import Lens
from solen.spec.light import Emitter
from solen.spec.network import Network, PlacedEmitter, PlacedLens

if TYPE_CHECKING:
    from solen.spec.design import Design
    from solen.spec.strict import Strict

REPLACED_BY_PART = ("wavelength_nm", "spectrum", "fwhm_nm", "width_mm", "height_mm", "cone_deg", "pattern", "exponent")
"""Shared keys of ``[emitter]`` that do not apply to an emitter whose own table names a part."""
REPLACED_BY_SHAPE = ("knots_um", "min_feature_um")
"""Shared keys of ``[lens]`` that do not apply to a lens whose own table gives a shape."""

MAX_COMBINED = 6
"""Maximum number of motions for which all combinations of the ends of their ranges are checked."""


def lens_table(design: "Design", placed: PlacedLens, half_width_mm: float | None) -> Lens:
    """Return the table of a lens in a network; ``half_width_mm`` is used if no table gives a half width."""
    own = _given_keys(placed, Lens)
    shared = {} if half_width_mm is None else {"half_width_mm": half_width_mm}
    shared |= {key: getattr(design.lens, key) for key in design.lens.model_fields_set}
    dropped = REPLACED_BY_SHAPE if "shape" in own else ()
    return Lens(**({key: value for key, value in shared.items() if key not in dropped} | own))


def lit(design: "Design", name: str | None = None) -> "Design":
    """Return the design of a network with one emitter lit, by default ``network.lit``, otherwise the first emitter.

    The ``[emitter]`` table of the result is the table of the lit emitter.
    """
    network = design.network
    name = name or network.lit or network.emitters[0].name
    (placed,) = (emitter for emitter in network.emitters if emitter.name == name)
    return design.with_emitter(emitter_table(design, placed), network.model_copy(update={"lit": name}))


def emitter_table(design: "Design", placed: PlacedEmitter) -> Emitter:
    """Return the table of an emitter in a network."""
    own = _given_keys(placed, Emitter)
    emitter = design.shared_emitter
    shared = {key: getattr(emitter, key) for key in emitter.model_fields_set}
    dropped = REPLACED_BY_PART if "part" in own else ()
    return Emitter(**({key: value for key, value in shared.items() if key not in dropped} | own))


def state_of(design: "Design", angles_deg: Mapping[str, float]) -> "Design":
    """Return the design of a network with some of its motions at other angles, keyed by the name of the motion.

    Raises
    ------
    SpecError
        If no motion has one of these names, or an angle is outside the range of its motion.
    """
    known = {motion.name: motion for motion in design.network.motion}
    for name, angle in angles_deg.items():
        if name not in known:
            limit = f"is not the name of a motion; known names: {', '.join(known) or 'none'}"
            raise SpecError("network.motion", value=name, limit=limit)
        if not known[name].from_deg <= angle <= known[name].to_deg:
            limit = f"must be {known[name].from_deg:g} to {known[name].to_deg:g} deg, the range of this motion"
            raise SpecError(f"network.motion {name}", value=angle, limit=limit)
    motions = tuple(
        motion.model_copy(update={"at_deg": angles_deg.get(name, motion.at_deg)}) for name, motion in known.items()
    )
    network = design.network.model_copy(update={"motion": motions})
    return design.model_copy(update={"network": network}).in_folder(design.folder)


def states(network: Network) -> Iterator[dict[str, float]]:
    """Yield the states at which the motions of a network are checked.

    Each motion goes through its range while the others stay at their current angles. With at most `MAX_COMBINED`
    motions, all combinations of the ends of their ranges follow.
    """
    yield {}
    for motion in network.motion:
        yield from ({motion.name: angle} for angle in motion.angles_deg())
    if 1 < len(network.motion) <= MAX_COMBINED:
        names = [motion.name for motion in network.motion]
        for ends in product(*((motion.from_deg, motion.to_deg) for motion in network.motion)):
            yield dict(zip(names, ends, strict=True))


def _given_keys(placed: "Strict", kind: "type[Strict]") -> dict[str, object]:
    """Return the keys of a shared table that the table of a part overrides, with their values."""
    return {key: value for key in kind.model_fields if (value := getattr(placed, key, None)) is not None}
