"""The solid of a sensor: its exact volume, the volume of its pockets, and the accuracy of its meshes.

`solen export` writes this solid to files. The exact volume is the area of the outline, by Green's theorem, times the
thickness; the volume of a mesh may deviate by at most its tolerance times the area of the walls.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from solen.fabricate import as_stl, label_of, mesh_of, sensor_part
from solen.sensor import Sensor
from solen.spec import loads, template, with_values

TOLERANCES_MM = (1e-2, 1e-3, 1e-4)


def main() -> tuple[float, float, dict[float, float]]:
    """Return the volumes without pockets, with pockets, and of the meshes, keyed by tolerance, in mm³."""
    design = loads(template("paper-860"))
    with_pockets = with_values(design, {"fabricate.pockets": True})
    solid, part = (sensor_part(variant, Sensor.of(variant).body()) for variant in (design, with_pockets))
    print(f"{solid.name}: {solid.volume_mm3:.4f} mm³, with pockets {part.volume_mm3:.4f} mm³")
    meshes = {tolerance_mm: mesh_of(part, tolerance_mm) for tolerance_mm in TOLERANCES_MM}
    for tolerance_mm, mesh in meshes.items():
        error, limit = mesh.volume_mm3 - part.volume_mm3, part.wall_mm2 * tolerance_mm
        print(
            f"within {tolerance_mm:g} mm: {len(mesh.triangles)} triangles, error {error:.4f} mm³, limit {limit:.3f} mm³"
        )
    with TemporaryDirectory() as folder:
        target = Path(folder) / "sensor.stl"
        target.write_bytes(as_stl(meshes[1e-3], label_of(with_pockets, "with pockets")))
        print(f"{target.name}: {target.stat().st_size} bytes")
    return solid.volume_mm3, part.volume_mm3, {tolerance: mesh.volume_mm3 for tolerance, mesh in meshes.items()}


if __name__ == "__main__":
    main()
