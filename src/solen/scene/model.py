"""The scene: all input of the tracer.

*Regions* are named media. *Interfaces* are curves between two regions, one on the left and one on the right of the
curve, with a behaviour: refracting, mirror, absorbing, receiver, grating, or the ideal elements splitter and lens. A
`Surface` adds coatings, tables, scatter and other treatments. *Sources* launch rays. There are two kinds of detectors.
A **receiver** is made of interfaces and absorbs all light that arrives; light that arrives on its left side, its face,
is detected and enters the ledger. A **monitor** is a line that measures the power crossing it, positive towards its
left; it does not change any ray and does not enter the ledger. A scene can have any number of each, and does not depend
on the kind of body.

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
from solen.scene.closed_media import check_closed
from solen.scene.overlaps import LINE_TOLERANCE_MM, check_overlaps, overlap_mm
from solen.scene.sources import Source
from solen.scene.surface import Surface

Behaviour = Literal["refracting", "mirror", "absorbing", "receiver", "splitter", "lens", "grating"]
BEHAVIOURS: tuple[Behaviour, ...] = get_args(Behaviour)


@dataclass(frozen=True)
class Region:
    """A homogeneous medium with a real index (a number or a dispersion) and power absorption per mm (Beer–Lambert).

    In a turbid medium rays are scattered after free paths of mean length 1/``scattering_per_mm``, with the
    Henyey–Greenstein phase function and the mean cosine ``anisotropy`` (Astrophys. J. 93, 70, 1941; in the plane the
    wrapped Cauchy distribution, which has the same form). Counting mode includes scattering but not absorption.
    """

    name: str
    index: float | Dispersion
    absorption_per_mm: float = 0.0
    scattering_per_mm: float = 0.0
    anisotropy: float = 0.0

    def index_at(self, wavelength_nm: float | None) -> float:
        """Return the index at a wavelength.

        Raises
        ------
        DataError
            If the wavelength is outside the range of the dispersion.
        """
        if not isinstance(self.index, Dispersion):
            return self.index
        if wavelength_nm is None:
            raise DesignError(
                f"region {self.name} index",
                limit="depends on the wavelength, so every source requires a spectrum",
                remedy="specify a spectrum for the sources, or a constant index for the region",
            )
        return self.index.index(wavelength_nm)


@dataclass(frozen=True)
class Interface:
    """A curve between the region on its left and the region on its right; part of the named ``receiver``, if any.

    ``surface`` describes the surface if it is not smooth and bare. In an extruded scene an interface extends from
    bottom to top. If ``height_mm`` is specified, a receiver extends only over that range of y, from the first value to
    the second; above and below it, the interface is refracting.
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
    """A straight line from ``start`` to ``end`` that measures power, optionally in equal ``bins`` along the line."""

    name: str
    start: Point
    end: Point
    bins: int = 0

    def __post_init__(self) -> None:
        what = f"monitor {self.name}"
        check_points(what, self.start, self.end)
        if self.start == self.end:
            raise DesignError(f"{what} end", value=self.end, limit="must differ from the start")
        check_count(f"{what} bins", self.bins, 0)

    @property
    def segment(self) -> Segment:
        """The line as a curve."""
        return Segment(self.start, self.end)


@dataclass(frozen=True)
class Extrusion:
    """A third dimension: everything extends along y over ``thickness_mm``, centred on y = 0.

    The media above and below have their own indices. Light that leaves the slab through its top or bottom never
    returns.
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
    """Regions, interfaces, sources and monitors, checked on construction; a `DesignError` identifies any fault.

    Interfaces must be separate (see `solen.scene.overlaps`) and media closed (see `solen.scene.closed_media`). With
    ``open_media`` neither is checked, for drawings in which a medium has no outer boundary, such as a half-space or an
    infinite plate: a ray that passes around an open end may meet an interface from a region that the interface does
    not border; the ray ends there, and the trace counts it as undefined. A ``front`` is a face of an extruded scene
    that is not vertical.
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
            check_overlaps(self.interfaces)
        if not self.sources:
            raise DesignError("scene sources", value=0, limit="a scene requires at least one source")
        for source in self.sources:
            source.check()
        self._check_wavelengths()
        for monitor in self.monitors:
            self._check_monitor(monitor)
        self._check_front()

    @property
    def receivers(self) -> tuple[str, ...]:
        """Names of the receivers, in the order in which their first interfaces appear."""
        return tuple(dict.fromkeys(i.receiver for i in self.interfaces if i.receiver is not None))

    @property
    def rays(self) -> int:
        """Number of rays launched by all sources."""
        return sum(source.rays for source in self.sources)

    @property
    def wavelengths_nm(self) -> tuple[float, ...]:
        """Wavelengths of all sources, ascending; empty if no source has a spectrum."""
        return tuple(sorted({wavelength_nm for source in self.sources for wavelength_nm, _ in source.spectrum}))

    @property
    def emitted(self) -> float:
        """Total power of all sources."""
        return math.fsum(source.power for source in self.sources)

    def _check_wavelengths(self) -> None:
        """Check that all sources or none have a spectrum, and that each region has an index at each wavelength."""
        without = [source for source in self.sources if not source.spectrum]
        if self.wavelengths_nm and without:
            limit = f"is missing in {len(without)} of {len(self.sources)} sources: all of them must have one, or none"
            raise DesignError("source spectrum", limit=limit)
        for region in self.regions:
            for wavelength_nm in self.wavelengths_nm or (None,):
                region.index_at(wavelength_nm)

    def _check_interface(self, interface: Interface) -> None:
        what = f"interface {interface.name}"
        names = {region.name for region in self.regions}
        for side in (interface.left, interface.right):
            if side not in names:
                raise DesignError(what, value=side, limit=f"must be a region: {', '.join(sorted(names))}")
        if interface.behaviour not in BEHAVIOURS:
            raise DesignError(
                f"{what} behaviour", value=interface.behaviour, limit=f"must be one of {', '.join(BEHAVIOURS)}"
            )
        if (interface.behaviour == "receiver") != (interface.receiver is not None):
            limit = "must be the name of a receiver if the behaviour is receiver, and must be omitted otherwise"
            raise DesignError(f"{what} receiver", value=interface.receiver, limit=limit)
        self._check_surface(interface)

    def _check_surface(self, interface: Interface) -> None:
        """Raise `DesignError` if a surface has a property that does not apply to its interface."""
        what, surface, behaviour = f"interface {interface.name}", interface.surface or Surface(), interface.behaviour
        ideal, focuses = behaviour in ("splitter", "lens"), surface.focal_mm is not None
        absorbs, coated = behaviour in ("absorbing", "receiver"), surface.coating is not None
        ruled, tables = behaviour == "grating", [t for t in (surface.table, surface.table_right) if t is not None]
        transmits = any(any(table.transmitted + table.transmitted_p) for table in tables)
        straight, one_medium = isinstance(interface.curve, Segment), interface.left == interface.right
        faults = (
            (behaviour == "lens" and not focuses, "focal_mm", "is required by a lens"),
            (behaviour == "splitter" and interface.surface is None, "transmitted", "is required by a splitter"),
            (ideal and not one_medium, "", f"is a {behaviour}, which must have the same region on both sides"),
            (focuses and not straight, "focal_mm", "requires a straight segment"),
            (focuses and behaviour not in ("lens", "mirror"), "focal_mm", f"does not apply to behaviour {behaviour}"),
            (absorbs and (surface.is_random or coated), "", "absorbs light, so it cannot scatter or have a coating"),
            (coated and behaviour != "refracting", "coating", "requires a refracting interface"),
            (ruled and surface.grating is None, "grating", "is required by behaviour grating"),
            (surface.grating is not None and not ruled, "grating", f"does not apply to behaviour {behaviour}"),
            (ruled and (surface.scatter or surface.texture), "grating", "cannot have scatter or a texture"),
            (tables and behaviour not in ("refracting", "mirror"), "table", f"does not apply to behaviour {behaviour}"),
            (tables and (coated or focuses), "table", "cannot be combined with coating or focal_mm"),
            (transmits and behaviour == "mirror", "table", "of a mirror cannot transmit light"),
            (
                transmits and surface.table_right is None and not one_medium,
                "table_right",
                "is required, because the media on the two sides differ",
            ),
        )
        for wrong, key, limit in faults:
            if wrong:
                raise DesignError(f"{what} surface.{key}" if key else what, limit=limit)
        if (coated or ruled) and not self.wavelengths_nm:
            limit = f"has a {'coating' if coated else 'grating'}, so its effect depends on the wavelength"
            raise DesignError(what, limit=limit, remedy="specify a spectrum for the sources")
        if interface.height_mm is not None:
            check_numbers(f"{what} height_mm", *interface.height_mm)
            if not interface.height_mm[0] < interface.height_mm[1]:
                raise DesignError(f"{what} height_mm", value=interface.height_mm, limit="must be in ascending order")

    @property
    def is_random(self) -> bool:
        """Whether any surface or medium scatters rays at random."""
        rough = any(i.surface is not None and i.surface.is_random for i in self.interfaces)
        return rough or self.is_turbid

    @property
    def is_turbid(self) -> bool:
        """Whether any medium scatters."""
        return any(region.scattering_per_mm > 0.0 for region in self.regions)

    def _check_front(self) -> None:
        """Check that a face in space belongs to an extruded scene and replaces a smooth and bare interface."""
        if self.front is None:
            return
        what, wall = "scene front", {i.name: i for i in self.interfaces}.get(self.front.interface)
        if self.extrusion is None:
            raise DesignError(what, limit="requires an extruded scene", remedy="specify an extrusion")
        if wall is None or wall.behaviour != "refracting" or wall.surface is not None:
            limit = "must be the name of an interface that is refracting, smooth and bare"
            raise DesignError(f"{what} interface", value=self.front.interface, limit=limit)
        if self.extrusion.thickness_mm != self.front.lens.thickness_mm:
            limit = f"must be {self.front.lens.thickness_mm:g} mm, for which the scene front was designed"
            raise DesignError("extrusion thickness_mm", value=self.extrusion.thickness_mm, limit=limit)
        if self.monitors:
            raise DesignError("scene monitors", limit="cannot be combined with a face in space")

    def _check_monitor(self, monitor: Monitor) -> None:
        """Raise `DesignError` if a monitor overlaps an interface: rounding would then determine what it measures."""
        for interface in self.interfaces:
            if (
                isinstance(interface.curve, Segment)
                and overlap_mm(interface.curve, monitor.segment) > LINE_TOLERANCE_MM
            ):
                raise DesignError(
                    f"monitor {monitor.name}",
                    limit=f"must not overlap an interface, but lies on {interface.name}",
                    remedy="move it slightly to the side where light is to be measured",
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
    known: set[str] = set()
    for name in names:
        if name in known:
            raise DesignError(f"scene {what}", value=name, limit="must be unique", remedy="rename one")
        known.add(name)
