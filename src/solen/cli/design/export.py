"""The command that writes the solid and the drawings of a design."""

from collections.abc import Iterator

from solen.cli.app import lines, listing
from solen.fabricate import ExportedSolid
from solen.pipeline.design.solid import export as export


@lines.register
def _(solid: ExportedSolid) -> Iterator[str]:
    yield solid.name
    yield from listing({key: getattr(solid, key) for key in ("thickness_mm", "area_mm2", "volume_mm3")})
    for seat in solid.seats:
        yield f"  {seat.name}: removes {seat.volume_mm3:.4g} mm3"
    if (mesh := solid.mesh) is not None:
        yield f"mesh: {mesh.triangles} triangles within {mesh.tolerance_mm:g} mm, {mesh.volume_mm3:.6g} mm3"
    if solid.layers is not None:
        yield from list(lines(solid.layers))[1:]
