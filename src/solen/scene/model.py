"""A scene: everything that the tracer needs, and nothing else.

*Regions* are media by name. *Interfaces* are curves between two regions, the one on the curve's left and the one on its
right, with a behaviour: refracting, mirror, absorbing, receiver, grating, or the ideal elements splitter and lens; a
`Surface` adds coatings, tables, scatter and the like. *Sources* launch rays. Detectors come in two kinds:
a **receiver** is made of interfaces; it absorbs what arrives, and what arrives on its left, its face, is detected and
enters the ledger. A **monitor** is a line that counts the power crossing it, positive towards its left, changes no ray
and is not in the ledger. There may be any number of each; the model is independent of the kind of body.

Coordinates are (x, z) in mm, angles in degrees counter-clockwise from +z.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

from solen.curve import Curve, Segment, check_count, check_numbers, check_points, check_range
from solen.errors import DesignError
from solen.geometry import Front
from solen.material import Dispersion
from solen.plane import Point
from solen.scene.apart import ON_IT_MM, check_apart, overlap_mm
from solen.scene.closed_media import check_closed
from solen.scene.sources import Source
from solen.scene.surface import Surface

Behaviour = Literal["refracting", "mirror", "absorbing", "receiver", "splitter", "lens", "grating"]
BEHAVIOURS: tuple[Behaviour, ...] = get_args(Behaviour)


@dataclass(frozen=True)
class Region:
    """A homogeneous medium: real index, a number or a dispersion, and absorption of power per mm (Beer–Lambert).

    Where it is turbid, a ray is scattered after a free path of 1/``scattering_per_mm`` in the mean, by Henyey and
    Greenstein's phase function, whose mean cosine is ``anisotropy`` (Astrophys. J. 93, 70, 1941; in the plane the
    wrapped Cauchy distribution, which has the same form). Counting includes scattering but no absorption.
    """

    name: str
    index: float | Dispersion
    absorption_per_mm: float = 0.0
    scattering_per_mm: float = 0.0
    anisotropy: float = 0.0

    def index_at(self, wavelength_nm: float | None) -> float:
        """Index at a wavelength; `DataError` if its dispersion does not reach there."""
        if not isinstance(self.index, Dispersion):
            return self.index
        if wavelength_nm is None:
            raise DesignError(
                f"region {self.name}",
                value="an index that depends on the wavelength",
                limit="every source needs a spectrum",
                remedy="give the sources a spectrum, or the region a number",
            )
        return self.index.index(wavelength_nm)


@dataclass(frozen=True)
class Interface:
    """A curve between the region on its left and the one on its right; part of the named ``receiver``, if any.

    ``surface`` describes it where it is not smooth and bare. In an extruded scene an interface reaches from bottom to
    top, but a receiver only over ``height_mm`` (from y, to y) where that is given: above and below it is refracting.
    """

    name: str
    curve: Curve
    left: str
    right: str
    behaviour: Behaviour = "refracting"
    receiver: str | None = None
    surface: Surface | None = None
    height_mm: tuple[float, float] | None = None


@dataclass(frozen=True)
class Monitor:
    """A straight line from ``start`` to ``end`` that counts power; ``bins`` equal bins along it if a map is wanted."""

    name: str
    start: Point
    end: Point
    bins: int = 0

    def __post_init__(self) -> None:
        what = f"monitor {self.name}"
        check_points(what, self.start, self.end)
        if self.start == self.end:
            raise DesignError(what, value=f"from {self.start} to itself", limit="must have a length")
        check_count(f"{what} bins", self.bins, 0)

    @property
    def segment(self) -> Segment:
        """The line as a curve."""
        return Segment(self.start, self.end)


@dataclass(frozen=True)
class Extrusion:
    """A third dimension: everything reaches along y over the ``thickness_mm``, half of it on either side of 0.

    Above and below is a medium of an index of its own. What leaves the slab there never comes back.
    """

    thickness_mm: float
    index_above: float = 1.0
    index_below: float = 1.0

    def __post_init__(self) -> None:
        check_range("extrusion thickness_mm", self.thickness_mm, above=0.0)
        check_range("extrusion index_above", self.index_above, 1.0)
        check_range("extrusion index_below", self.index_below, 1.0)


@dataclass(frozen=True)
class Scene:
    """Regions, interfaces, sources and monitors; checked when made, `DesignError` names what does not fit.

    Interfaces lie apart (see `solen.scene.apart`) and media are closed (`solen.scene.closed_media`). ``open_media``
    leaves both unchecked, for media that end in nothing, as a half-space or an endless plate does in a drawing: a ray
    that goes round such an end and meets a medium that it is not in ends there, and the trace counts it as undefined.
    A ``front`` is a face of an extruded scene that is not upright.
    """

    regions: tuple[Region, ...]
    interfaces: tuple[Interface, ...]
    sources: tuple[Source, ...]
    monitors: tuple[Monitor, ...] = ()
    name: str = "scene"
    open_media: bool = False
    extrusion: Extrusion | None = None
    front: Front | None = None

    def __post_init__(self) -> None:
        _unique("region", (region.name for region in self.regions))
        _unique("interface", (interface.name for interface in self.interfaces))
        _unique("detector", (*self.receivers, *(monitor.name for monitor in self.monitors)))
        for region in self.regions:
            _check_region(region)
        for interface in self.interfaces:
            self._check_interface(interface)
        if not self.open_media:
            check_closed(self.interfaces)
            check_apart(self.interfaces)
        if not self.sources:
            raise DesignError("scene sources", value=0, limit="at least one is needed")
        for source in self.sources:
            source.check()
        self._check_wavelengths()
        for monitor in self.monitors:
            self._check_monitor(monitor)
        self._check_front()

    @property
    def receivers(self) -> tuple[str, ...]:
        """Names of the receivers, in the order of their first interface."""
        return tuple(dict.fromkeys(i.receiver for i in self.interfaces if i.receiver is not None))

    @property
    def rays(self) -> int:
        """Rays launched by all sources."""
        return sum(source.rays for source in self.sources)

    @property
    def wavelengths_nm(self) -> tuple[float, ...]:
        """Wavelengths of all sources, ascending; none where no source has a spectrum."""
        return tuple(sorted({wavelength_nm for source in self.sources for wavelength_nm, _ in source.spectrum}))

    @property
    def emitted(self) -> float:
        """Power of all sources together."""
        return math.fsum(source.power for source in self.sources)

    def _check_wavelengths(self) -> None:
        """Either all sources have a spectrum or none, and every region has an index at every wavelength."""
        silent = [source for source in self.sources if not source.spectrum]
        if self.wavelengths_nm and silent:
            limit = "either all sources of a scene have a spectrum, or none"
            raise DesignError("source spectrum", value=f"missing in {len(silent)} of {len(self.sources)}", limit=limit)
        for region in self.regions:
            for wavelength_nm in self.wavelengths_nm or (None,):
                region.index_at(wavelength_nm)

    def _check_interface(self, interface: Interface) -> None:
        what = f"interface {interface.name}"
        names = {region.name for region in self.regions}
        for side in (interface.left, interface.right):
            if side not in names:
                raise DesignError(what, value=side, limit=f"no such region; there are {', '.join(sorted(names))}")
        if interface.behaviour not in BEHAVIOURS:
            raise DesignError(what, value=interface.behaviour, limit=f"must be one of {', '.join(BEHAVIOURS)}")
        if (interface.behaviour == "receiver") != (interface.receiver is not None):
            raise DesignError(
                what, value=interface.receiver, limit="a receiver, and only a receiver, names its detector"
            )
        self._check_surface(interface)

    def _check_surface(self, interface: Interface) -> None:
        """`DesignError` if a surface states something that does not apply to its interface."""
        what, surface, behaviour = f"interface {interface.name}", interface.surface or Surface(), interface.behaviour
        is_ideal, focuses = behaviour in ("splitter", "lens"), surface.focal_mm is not None
        absorbs, coated = behaviour in ("absorbing", "receiver"), surface.coating is not None
        ruled, tables = behaviour == "grating", [t for t in (surface.table, surface.table_right) if t is not None]
        transmits = any(any(table.transmitted + table.transmitted_p) for table in tables)
        both = "has one table: light from its two sides meets different media"
        straight, one_medium = isinstance(interface.curve, Segment), interface.left == interface.right
        refusals = (
            (behaviour == "lens" and not focuses, None, "a lens needs surface.focal_mm"),
            (behaviour == "splitter" and interface.surface is None, None, "needs a surface with its transmitted share"),
            (is_ideal and not one_medium, behaviour, "must have the same region on both sides"),
            (focuses and not straight, "focal_mm", "an ideal element is a straight segment"),
            (focuses and behaviour not in ("lens", "mirror"), "focal_mm", f"does not apply to behaviour {behaviour}"),
            (absorbs and (surface.is_random or coated), behaviour, "absorbs all light: no scatter, texture or coating"),
            (coated and behaviour != "refracting", behaviour, "a coating needs a refracting interface"),
            (ruled != (surface.grating is not None), behaviour, "a grating, and only a grating, has surface.grating"),
            (ruled and (surface.scatter or surface.texture), behaviour, "has orders: no scatter or texture"),
            (
                tables and behaviour not in ("refracting", "mirror"),
                behaviour,
                "has no table",
            ),
            (tables and (coated or focuses), "table", "has its shares: no coating or focal_mm beside it"),
            (transmits and behaviour == "mirror", "table", "a mirror transmits nothing"),
            (transmits and surface.table_right is None and not one_medium, "table", both),
        )
        for wrong, value, limit in refusals:
            if wrong:
                raise DesignError(what, value=value, limit=limit)
        if (coated or ruled) and not self.wavelengths_nm:
            limit = f"a {'coating' if coated else 'grating'} needs wavelengths"
            raise DesignError(what, value="sources without spectrum", limit=limit, remedy="give the sources a spectrum")
        if interface.height_mm is not None:
            check_numbers(f"{what} height_mm", *interface.height_mm)
            if not interface.height_mm[0] < interface.height_mm[1]:
                raise DesignError(what, value=interface.height_mm, limit="height_mm must run from low to high")

    @property
    def is_random(self) -> bool:
        """Whether any surface or medium scatters rays at random."""
        rough = any(i.surface is not None and i.surface.is_random for i in self.interfaces)
        return rough or self.is_turbid

    @property
    def is_turbid(self) -> bool:
        """Whether some medium scatters."""
        return any(region.scattering_per_mm > 0.0 for region in self.regions)

    def _check_front(self) -> None:
        """A face in space needs space, and the smooth and bare interface that it stands for."""
        if self.front is None:
            return
        what, wall = "scene front", {i.name: i for i in self.interfaces}.get(self.front.interface)
        if self.extrusion is None:
            raise DesignError(what, value="in the plane", limit="is a face in space", remedy="state an extrusion")
        if wall is None or wall.behaviour != "refracting" or wall.surface is not None:
            limit = "must replace a refracting, smooth and bare interface"
            raise DesignError(what, value=self.front.interface, limit=limit)
        if self.extrusion.thickness_mm != self.front.lens.thickness_mm:
            limit = f"is cut for a body of {self.front.lens.thickness_mm:g} mm"
            raise DesignError(what, value=f"{self.extrusion.thickness_mm:g} mm", limit=limit)
        if self.monitors:
            raise DesignError(what, value=f"{len(self.monitors)} monitors", limit="is traced without monitors")

    def _check_monitor(self, monitor: Monitor) -> None:
        """`DesignError` for a monitor along an interface, where rounding would decide what it counts."""
        for interface in self.interfaces:
            if isinstance(interface.curve, Segment) and overlap_mm(interface.curve, monitor.segment) > ON_IT_MM:
                raise DesignError(
                    f"monitor {monitor.name}",
                    value=f"lies on interface {interface.name}",
                    limit="must lie off every interface",
                    remedy="move it a little to the side that you want counted",
                )


def _check_region(region: Region) -> None:
    what = f"region {region.name}"
    if not isinstance(region.index, Dispersion):
        check_range(f"{what} index", region.index, 1.0)
    check_range(f"{what} absorption_per_mm", region.absorption_per_mm, 0.0)
    check_range(f"{what} scattering_per_mm", region.scattering_per_mm, 0.0)
    if not -1.0 < region.anisotropy < 1.0:
        raise DesignError(f"{what} anisotropy", value=region.anisotropy, limit="must be above -1 and below 1")


def _unique(what: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise DesignError(f"scene {what}", value=name, limit="must be unique", remedy="rename one")
        seen.add(name)
