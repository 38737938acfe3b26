"""The commands that check a design and that describe its lens."""

from collections.abc import Iterator

from solen.cli.app import lines, listing, text
from solen.pipeline.design.check import check as check
from solen.pipeline.design.check import lens as lens
from solen.results import scalars
from solen.sensor import Check, Focus, LensCheck
from solen.sensor.network import NetworkCheck
from solen.trace.scene_file import SceneCheck


@lines.register
def _(result: Check) -> Iterator[str]:
    yield f"{result.name}: a valid sensor at all {result.angles} {'loads' if result.loaded else 'angles'}"
    material = {name: getattr(result.material, name) for name in ("index", "u_index", "mode")}
    focus = scalars(result.foci[len(result.foci) // 2]) if result.foci else ()
    lens = {"shape": "drawn"} if result.lens is None else dict(scalars(result.lens))
    yield from listing(_listed(material | lens | dict(focus) | dict(scalars(result.body))))
    yield from _foci(result.foci)
    yield f"faces: {', '.join(result.body.faces)}"


@lines.register
def _(result: NetworkCheck) -> Iterator[str]:
    yield f"{result.name}: a valid network in {result.states} states of its motions"
    names = ("guides", "receivers", "motions")
    numbers = {"index": result.material.index, "area_mm2": result.area_mm2}
    rows = {name: ", ".join(getattr(result, name)) or ("drawn" if name == "guides" else "none") for name in names}
    yield from listing(rows | numbers)
    yield from (f"  reading {name}: {expression}" for name, expression in result.readings.items())
    for front in result.lenses:
        sizes = f"half width {front.half_width_mm:.4g} mm, depth {front.depth_mm:.4g} mm"
        spot = "" if front.best_focus_mm is None else f", smallest spot at {text(front.best_focus_mm)} mm"
        yield f"  lens {front.name}: {front.shape}, {sizes}{spot}"
    for emitter in result.emitters:
        position = f"x {emitter.x_mm:.4g}, z {emitter.z_mm:.4g} mm, axis at {emitter.axis_deg:.4g} deg"
        yield f"  emitter {emitter.name}: {position}, {emitter.wavelength_nm:g} nm"
    yield f"faces: {', '.join(result.faces)}"


@lines.register
def _(result: SceneCheck) -> Iterator[str]:
    yield f"{result.name}: a valid scene of {result.format}"
    names = {"receivers": ", ".join(result.receivers), "monitors": ", ".join(result.monitors)}
    numbers = {name: getattr(result, name) for name in ("regions", "interfaces", "sources", "rays")}
    yield from listing(numbers | {name: value for name, value in names.items() if value})
    if result.in_space:
        yield "extruded: rays are traced in space"
    if result.is_random:
        yield "some surfaces scatter light: the powers are sampled, not integrated"
    for part in result.not_understood:
        yield f"ignored: {part}"


@lines.register
def _(result: LensCheck) -> Iterator[str]:
    focus = scalars(result.foci[len(result.foci) // 2]) if result.foci else ()
    yield from listing(_listed(dict(scalars(result.lens)) | dict(focus)))
    yield from _foci(result.foci)


def _listed(values: dict[str, object]) -> dict[str, object]:
    """Return the values that are printed: those that are not None, without the shift of the index."""
    return {
        name: value for name, value in values.items() if value is not None and name not in ("step", "by_uncertainty")
    }


def _foci(foci: tuple[Focus, ...]) -> Iterator[str]:
    """Yield the foci for indices one standard uncertainty below and above the nominal one."""
    for focus in foci:
        if focus.by_uncertainty:
            yield (
                f"  index {focus.material_index:.6g} (shifted by its uncertainty, {focus.step:+.2g}): paraxial focus "
                f"{text(focus.paraxial_focus_mm)} mm, smallest spot {text(focus.best_focus_mm)} mm"
            )
