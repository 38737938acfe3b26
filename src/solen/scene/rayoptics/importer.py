"""Conversion of a ray-optics file to a scene: its objects in order, with its detectors as monitors.

Unsupported content is omitted and listed, never guessed: an entire object, or one of its keys. A file is rejected only
if it is not a ray-optics scene or cannot be traced.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np

from solen import files
from solen.arrays import FloatArray
from solen.errors import DataError, DesignError, SolenError
from solen.results import Result
from solen.scene.model import Monitor, Scene
from solen.scene.rayoptics.arrangement import Element, Glass, arranged
from solen.scene.rayoptics.fields import GREEN_NM, MAX_NUMBER, Fields, NotUnderstood, UnreadableError
from solen.scene.rayoptics.formula import number_in
from solen.scene.rayoptics.modules import expanded
from solen.scene.rayoptics.objects import READERS
from solen.scene.rayoptics.outlines import SceneSettings, read_segment
from solen.scene.rayoptics.sources import EMISSIONS, SourceSettings, rays
from solen.scene.sources import Rays

VERSION = 5
MERGING = 1e-6
"""Points closer together than this distance, in length scales of the file, are merged."""
GREEN = ((GREEN_NM, 1.0),)
"""Spectrum of light at a grating in a scene without colours."""
MIN_BRIGHTNESS, MIN_CORRECT_BRIGHTNESS = 0.01, 1e-6
"""Brightness below which a split-off ray is dropped: by default, and if the scene requires correct brightnesses."""
NO_LIGHT = ("TextLabel", "LineArrow", "Ruler", "Protractor", "Drawing", "CropBox", "Handle")
"""Objects that do not interact with light."""
APPEARANCE = frozenset(
    {"version", "name", "importedFromBeta", "showGrid", "snapToGrid", "lockObjs", "gridSize", "observer", "origin"}
    | {"scale", "width", "height", "redWavelength", "violetWavelength", "showRayArrows", "symbolicBodyMerging"}
    | {"theme", "backgroundImage", "numericalTolerances"}
)
"""Scene keys that do not affect light, or only control how ray-optics computes it."""
LIGHT = frozenset(
    {"objs", "modules", "mode", "rayModeDensity", "imageModeDensity", "lengthScale", "simulateColors", "colorMode"}
    | {"randomSeed", "maxRayDepth"}
)
MODES = ("rays", "extended", "images", "observer")
MAX_MODULE_DEPTH = 8


class MonitorReading(Protocol):
    """Reading of a monitor in a trace."""

    @property
    def power(self) -> float:
        """Net power, as a fraction of the emitted power."""

    @property
    def power_by_bin(self) -> FloatArray:
        """Net power per bin, as a fraction of the emitted power."""


class Reading(Result):
    """Detector reading in the units of the file: power, and power per length in bins starting at ``position``."""

    power: float
    position: FloatArray | None = None
    irradiance: FloatArray | None = None


@dataclass(frozen=True)
class Detector:
    """A detector as one or two monitors: for its complete bins, and for the remainder of its line."""

    name: str
    monitors: tuple[Monitor, ...]
    bins: int = 0
    bin_size: float = 0.0

    def reading(self, monitors: Mapping[str, MonitorReading], emitted: float) -> Reading:
        """Return the detector reading from its monitor readings; bins without a monitor have no length and remain 0."""
        readings = [monitors[monitor.name] for monitor in self.monitors]
        power = emitted * math.fsum(reading.power for reading in readings)
        if not self.bins:
            return Reading(power)
        powers = np.concatenate([r.power_by_bin if len(r.power_by_bin) else np.array([r.power]) for r in readings])
        values = np.zeros(self.bins)
        values[: len(powers)] = powers
        return Reading(power, np.arange(float(self.bins)) * self.bin_size, values * (emitted / self.bin_size))


@dataclass(frozen=True)
class Imported:
    """A ray-optics scene as solen traces it.

    Lengths in the units of the file are interpreted as mm; y is inverted, so that z points up. Powers are ray-optics
    brightnesses.

    Attributes
    ----------
    scene
        The equivalent solen scene, with the rays of the file in their original order.
    detectors
        The detectors in the file.
    not_understood
        Parts of the file that were omitted.
    weak, weakest
        Brightness up to which ray-optics drops a ray that is split off, and one that continues.
    max_hits
        Maximum number of objects that a ray may hit; None for no limit.
    fresh
        For each ray, whether it starts a new sequence or continues that of the previous ray.
    """

    scene: Scene
    detectors: tuple[Detector, ...]
    not_understood: tuple[NotUnderstood, ...]
    weak: float
    weakest: float
    max_hits: int | None
    fresh: tuple[bool, ...] = field(repr=False)

    def readings(self, monitors: Mapping[str, MonitorReading]) -> dict[str, Reading]:
        """Return the readings of all detectors from the monitor readings of a trace."""
        return {detector.name: detector.reading(monitors, self.scene.emitted) for detector in self.detectors}


def load(path: Path | str, *, facets: bool = False) -> Imported:
    """Load a scene from a file; errors as in `loads`, and `DataError` if the file cannot be read."""
    return loads(files.read_text(Path(path), DataError), str(path), facets=facets)


def loads(text: str, where: str = "scene", *, facets: bool = False) -> Imported:
    """Load a scene from JSON text.

    Parameters
    ----------
    text
        Content of the file.
    where
        File name used in messages.
    facets
        Whether curves defined by formulas become the polylines that ray-optics traces, which only the tracers in plain
        Python support; by default they become the curves themselves, exactly or to 1e-7 of their size.

    Raises
    ------
    DataError
        If the text is not a ray-optics scene, version 5.
    DesignError
        If the scene cannot be traced: it has no light, or an index below 1.
    """
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as bad:
        raise DataError(where, limit=f"is not valid JSON: {bad}") from None
    if not recognised(data):
        raise DataError(where, limit="is not a ray-optics scene: it has no list objs and no version")
    if data["version"] != VERSION:
        raise DataError(
            f"{where}: version",
            value=data["version"],
            limit=f"this version of solen reads version {VERSION}",
            remedy="open the scene in ray-optics and save it again",
        )
    return _Scene(data, where, facets).imported()


def recognised(data: object) -> bool:
    """Return whether parsed JSON has the form of a ray-optics scene, of any version."""
    return isinstance(data, dict) and isinstance(data.get("objs"), list) and "version" in data


class _Scene:
    """Builder that converts the objects of a file to a scene."""

    def __init__(self, data: dict[str, Any], where: str, facets: bool) -> None:
        self.data = data
        self.facets = facets
        self.where = where
        self.omitted: list[NotUnderstood] = []
        self.parts: list[Glass | Element] = []
        self.sources: list[Rays] = []
        self.fresh: list[bool] = []
        self.detectors: list[Detector] = []
        self.counts: dict[str, int] = {}
        self.objects: dict[str, tuple[int, str]] = {}
        self.settings = Fields(0, "scene", data)
        self.settings.unread -= APPEARANCE
        try:
            self.scene_settings = self._scene_settings()
            self.source_settings = self._source_settings()
            self.max_hits = self._max_hits()
        except UnreadableError as bad:
            raise DataError(f"{where}: {bad.key}", limit=bad.reason) from None

    def imported(self) -> Imported:
        for number, item in self._objects():
            self._read(number, item)
        for key in sorted(self.settings.unread - LIGHT):
            self._omit(0, "scene", key, "unknown key")
        try:
            arrangement = arranged(self.parts, MERGING * self.scene_settings.length_scale, self.scene_settings.colours)
        except DesignError as bad:
            raise type(bad)(f"{self.where}: {bad.what}", value=bad.value, limit=bad.limit, remedy=bad.remedy) from None
        for name, reason in arrangement.rejected:
            self._omit(*self.objects[name], None, reason)
        if not self.sources:
            reasons = "; ".join(map(str, self.omitted[:2]))
            limit = f"contains no supported source{f' ({reasons})' if reasons else ''}"
            raise DataError(self.where, limit=limit, remedy="add a source")
        has_grating = any(interface.behaviour == "grating" for interface in arrangement.interfaces)
        scene = Scene(
            arrangement.regions,
            arrangement.interfaces,
            tuple(
                source if source.spectrum or not has_grating else replace(source, spectrum=GREEN)
                for source in self.sources
            ),
            tuple(monitor for detector in self.detectors for monitor in detector.monitors),
            str(self.data.get("name") or Path(self.where).stem),
            open_media=True,
        )
        weak = MIN_CORRECT_BRIGHTNESS if self.source_settings.correct else MIN_BRIGHTNESS
        weakest = MIN_CORRECT_BRIGHTNESS if self.source_settings.correct else 0.0
        return Imported(
            scene, tuple(self.detectors), tuple(self.omitted), weak, weakest, self.max_hits, tuple(self.fresh)
        )

    def _scene_settings(self) -> SceneSettings:
        scale = self.settings.number_of("lengthScale", 1.0, above=0.0)
        return SceneSettings(scale, self.settings.flag("simulateColors"), _span(self.data["objs"]), self.facets)

    def _source_settings(self) -> SourceSettings:
        mode = self.settings.string("mode", "rays")
        if mode not in MODES:
            raise UnreadableError("mode", f"must be one of {', '.join(MODES)}")
        densities = (self.settings.number_of("rayModeDensity", 0.1), self.settings.number_of("imageModeDensity", 1.0))
        density = densities[mode in ("images", "observer")]
        if not density > 0.0:
            raise UnreadableError("rayModeDensity", f"must be above 0, not {density:g}")
        correct = self.settings.string("colorMode", "default") != "default"
        seed = self.data.get("randomSeed")
        return SourceSettings(
            density,
            self.scene_settings.length_scale,
            self.scene_settings.colours,
            correct,
            observed=mode == "observer",
            seed=None if seed is None else str(seed),
        )

    def _max_hits(self) -> int | None:
        value = self.data.get("maxRayDepth")
        if value is None or isinstance(value, str):  # JSON has no infinity
            return None
        return max(int(self.settings.number_of("maxRayDepth")), 0)

    def _omit(self, number: int, kind: str, key: str | None, reason: str) -> None:
        self.omitted.append(NotUnderstood(number, kind, key, reason))

    def _objects(self) -> Iterator[tuple[int, dict[str, Any]]]:
        """Yield objects with their numbers in the file; modules are expanded in place."""
        for number, item in enumerate(self.data["objs"], 1):
            if isinstance(item, dict):
                yield from self._expanded(number, item, 0)
            else:
                self._omit(number, "object", None, "is not an object")

    def _expanded(self, number: int, item: dict[str, Any], depth: int) -> Iterator[tuple[int, dict[str, Any]]]:
        if item.get("type") != "ModuleObj":
            yield number, item
            return
        name = item.get("module")
        modules = self.data.get("modules") or {}
        definition = modules.get(name) if isinstance(modules, dict) and isinstance(name, str) else None
        if not isinstance(definition, dict) or depth > MAX_MODULE_DEPTH:
            self._omit(number, "ModuleObj", "module", f"{name!r} is not a module, or contains itself")
            return
        try:
            parts = expanded(definition, item.get("points", []), item.get("params", {}))
        except SolenError as bad:
            self._omit(number, "ModuleObj", str(name), str(bad))
            return
        for part in parts:
            yield from self._expanded(number, part, depth + 1)

    def _read(self, number: int, item: dict[str, Any]) -> None:
        """Add one object, or record why it cannot be added."""
        kind = item.get("type")
        if kind in NO_LIGHT:
            return
        readers: dict[str, Callable[[Fields], None]] = {
            **dict.fromkeys(READERS, self._take_part),
            **dict.fromkeys(EMISSIONS, self._take_source),
            "Detector": self._take_detector,
        }
        if not isinstance(kind, str) or kind not in readers:
            self._omit(number, str(kind), None, "solen does not support this type of object")
            return
        fields = Fields(number, kind, item)
        try:
            readers[kind](fields)
        except UnreadableError as bad:
            self._omit(number, kind, bad.key, f"{bad.reason}; the object is omitted")
            return
        except SolenError as bad:
            self._omit(number, kind, None, f"{bad}; the object is omitted")
            return
        for key in sorted(fields.unread):
            self._omit(number, kind, key, "unknown key")

    def _next_name(self, kind: str) -> str:
        """Return the name of the next object of a type, for example glass1."""
        self.counts[kind] = self.counts.get(kind, 0) + 1
        return f"{kind.lower()}{self.counts[kind]}"

    def _take_part(self, fields: Fields) -> None:
        name = self._next_name(fields.type)
        self.objects[name] = (fields.number, fields.type)
        self.parts += READERS[fields.type](fields, name, self.scene_settings)

    def _take_source(self, fields: Fields) -> None:
        sources, fresh = rays(fields, self.source_settings)
        self.sources += sources
        self.fresh += fresh

    def _take_detector(self, fields: Fields) -> None:
        """Add a detector: a monitor for its complete bins, and another for the remainder of its line."""
        segment, has_bins, size = read_segment(fields), fields.flag("irradMap"), fields.number_of("binSize", 1.0)
        name = self._detector_name(fields)
        if not has_bins:
            self.detectors.append(Detector(name, (Monitor(name, segment.a, segment.b),)))
            return
        if not size > 0.0 or segment.length_mm / size > 1e6:
            raise UnreadableError("binSize", f"must be above 0 and give at most a million bins, not {size:g}")
        bins, complete = math.ceil(segment.length_mm / size), math.floor(segment.length_mm / size)
        fraction = complete * size / segment.length_mm
        end = cast(
            "tuple[float, float]",
            tuple((1.0 - fraction) * a + fraction * b for a, b in zip(segment.a, segment.b, strict=True)),
        )
        monitors = [Monitor(name, segment.a, end if bins > complete else segment.b, complete)] if complete else []
        if bins > complete and end != segment.b:
            monitors.append(Monitor(f"{name} rest" if complete else name, end, segment.b))
        self.detectors.append(Detector(name, tuple(monitors), bins, size))

    def _detector_name(self, fields: Fields) -> str:
        """Return the name of a detector in the file, or a numbered name if it has none or the name is not unique."""
        numbered, name = self._next_name("Detector"), fields.data.get("name")
        is_unique = all(detector.name != name for detector in self.detectors)
        return name if isinstance(name, str) and name and is_unique else numbered


def _span(objects: list[Any]) -> float:
    """Return the difference between the largest and the smallest coordinate in the file."""
    values: list[float] = []
    stack: list[Any] = [objects]
    while stack:
        item = stack.pop()
        if isinstance(item, dict):
            stack += item.values()
            numbers = (number_in(item.get(key)) for key in ("x", "y"))
            values += [x for x in numbers if x is not None and abs(x) <= MAX_NUMBER]
        elif isinstance(item, list):
            stack += item
    return max(values) - min(values) if values else 0.0
