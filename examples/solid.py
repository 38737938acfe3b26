"""The solid of a sensor: its volume from exact curves, the volume of its pockets, and the accuracy of its meshes.

`solen export` writes the same solid to files. The exact volume is the area of the outline, by Green's theorem, times
the thickness; a mesh within a tolerance may differ by that tolerance times the area of the walls.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

from solen.fabricate import as_stl, label_of, mesh_of, sensor_part
from solen.sensor import Sensor
from solen.spec import loads, template, with_values

TOLERANCES_MM = (1e-2, 1e-3, 1e-4)


def main() -> tuple[float, float, dict[float, float]]:
    """Return volumes in mm³: of the bare sensor, of the one with pockets, and of its meshes by their tolerance."""
    design = loads(template("paper-860"))
    seated = with_values(design, {"fabricate.pockets": True})
    bare, part = (sensor_part(one, Sensor.of(one).body()) for one in (design, seated))
    print(f"{bare.name}: {bare.volume_mm3:.4f} mm³, with pockets {part.volume_mm3:.4f} mm³")
    meshes = {tolerance_mm: mesh_of(part, tolerance_mm) for tolerance_mm in TOLERANCES_MM}
    for tolerance_mm, mesh in meshes.items():
        off, bound = mesh.volume_mm3 - part.volume_mm3, part.wall_mm2 * tolerance_mm
        print(
            f"within {tolerance_mm:g} mm: {len(mesh.triangles)} triangles, off by {off:.4f} of at most {bound:.3f} mm³"
        )
    with TemporaryDirectory() as folder:
        target = Path(folder) / "sensor.stl"
        target.write_bytes(as_stl(meshes[1e-3], label_of(seated, "with pockets")))
        print(f"{target.name}: {target.stat().st_size} bytes")
    return bare.volume_mm3, part.volume_mm3, {tolerance: mesh.volume_mm3 for tolerance, mesh in meshes.items()}


if __name__ == "__main__":
    main()
