"""Write the sample data that `solen project examples` copies: ``python -m tools.samples``.

Nothing was measured: tables state this in their first line, images and the video in their names and descriptions.
Images are computed with an image model of the tests, which shares no code with the evaluation.
"""

import io
import math
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image, PngImagePlugin

from solen.arrays import FloatArray
from solen.bench.record import RecordOptions, record
from solen.bench.starter import starter_files
from solen.geometry.coupons import layout
from solen.material.index import forward
from tests.bench.video_support import Camera as VideoCamera
from tests.bench.video_support import cells, oblique_view, write_avi
from tests.fabricate.test_printed_command import features_file
from tests.metrology.coupon_support import Camera, Print
from tests.metrology.test_micrometer import ruler
from tools.micrograph import NAME, micrograph
from tools.recording import recording, second_day

ROOT = Path(__file__).resolve().parents[1]
SAMPLES = ROOT / "src" / "solen" / "examples"
IRRADIANCE_MW_PER_CM2 = 13.0
DP_UM, EC_MJ_PER_CM2 = 110.0, 6.0
SECONDS = (0.6, 0.8, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
LOSSES_DB_PER_CM = {"flat": 1.3, "upright": 2.1}
LENGTHS_MM = (10, 20, 30, 40, 50)


def discs() -> str:
    """Return cured discs, three per exposure time, with 5 % scatter; one is torn, and one exposure was too short."""
    rng = np.random.default_rng(39)
    rows = [
        f"# simulated: Dp {DP_UM:g} µm, Ec {EC_MJ_PER_CM2:g} mJ/cm², 13 mW/cm²; discs scatter by 5 %, one is torn",
        "exposure_s,thickness_um,replicate",
        "0.4,0,1",
    ]
    for seconds in SECONDS:
        for replicate in (1, 2, 3):
            depth_um = DP_UM * math.log(IRRADIANCE_MW_PER_CM2 * seconds / EC_MJ_PER_CM2) * rng.normal(1.0, 0.05)
            factor = 0.55 if (seconds, replicate) == (4.0, 2) else 1.0
            rows.append(f"{seconds:g},{factor * depth_um:.1f},{replicate}")
    return "\n".join(rows) + "\n"


def guides() -> str:
    """Return guides of five lengths, three each in two orientations, read twice; a defect costs one of them 4 dB."""
    rng = np.random.default_rng(41)
    rows = [
        "# simulated: 1.3 dB/cm flat, 2.1 upright; coupling 5 dB; guides scatter by 0.3 dB; guide 8 is bad",
        "length_mm,power_uW,guide,orientation",
    ]
    number = 0
    for orientation, loss in LOSSES_DB_PER_CM.items():
        for mm in LENGTHS_MM:
            for _ in range(3):
                number += 1
                level_db = -5.0 - loss * mm / 10.0 + rng.normal(0.0, 0.3) - (4.0 if number == 8 else 0.0)
                for _ in range(2):
                    power = 800.0 * 10.0 ** ((level_db + rng.normal(0.0, 0.05)) / 10.0)
                    rows.append(f"{mm},{power:.4g},{number},{orientation}")
    return "\n".join(rows) + "\n"


def table(header: str, *columns: ArrayLike, number_format: str = "%.6g", comment: str = "# simulated") -> str:
    """Return a table whose first line states that its numbers are simulated."""
    text = io.StringIO()
    rows = np.column_stack([np.asarray(column, float) for column in columns])
    np.savetxt(text, rows, number_format, ",", header=f"{comment}\n{header}", comments="")
    return text.getvalue()


def layer() -> str:
    """Return T and R of a layer of 50 µm, n = 1.48 + 0.005 µm²/λ² and k = 1e-6, with noise of 0.05 %."""
    nm = np.arange(430.0, 901.0, 2.0)
    reflected, transmitted = forward(1.48 + 5e3 / nm**2, 1e-6, 50.0, nm)
    noise = 5e-4 * np.random.default_rng(5).standard_normal((2, nm.size))
    comment = "# simulated: 50 µm, n = 1.48 + 0.005 µm²/λ², k = 1e-6; noise of 0.05 % in T and in R"
    return table("wavelength_nm,T,R", nm, transmitted + noise[0], reflected + noise[1], comment=comment)


def absorbance() -> str:
    """Return the decadic absorbance of a 93 µm film of liquid resin, which decreases from 360 to 440 nm."""
    nm = np.arange(360.0, 441.0, 2.0)
    noise = 0.002 * np.random.default_rng(6).standard_normal(nm.size)
    absorbance = 0.02 + 0.9 / (1.0 + np.exp((nm - 398.0) / 7.0))
    return table("wavelength_nm,absorbance", nm, absorbance + noise, comment="# simulated: 93 µm of liquid resin")


def exposures() -> str:
    """Return the transmittance of layers exposed for 2, 4 and 6 s."""
    nm, rng = np.arange(440.0, 881.0, 10.0), np.random.default_rng(7)
    curves = [91.0 - 0.5 * s + 1e-3 * nm + 0.05 * rng.standard_normal(nm.size) for s in (2, 4, 6)]
    return table("wavelength_nm,layer 2 s (%T),layer 4 s (%T),layer 6 s (%T)", nm, *curves, number_format="%.5g")


def cube() -> str:
    """Return two cycles of compression of a neo-Hookean cube of 10 mm, C10 = 0.2 MPa, after a gap of 0.2 mm."""
    travel = np.concatenate([np.linspace(0, 3, 150), np.linspace(3, 0, 150)[1:]] * 2)
    stretch = 1.0 - np.maximum(travel - 0.2, 0.0) / 10.0
    force = 100.0 * 0.4 * (stretch**-2 - stretch) + 0.02 * np.random.default_rng(8).standard_normal(travel.size)
    return table("displacement (mm),force (N)", travel, force, comment="# simulated: cube of 10 mm, C10 = 0.2 MPa")


def greys() -> str:
    """Return thicknesses of the discs of the grey-steps coupon, three per grey level, for dose ∝ grey^1.8."""
    grey = np.repeat([255.0, 225.0, 200.0, 175.0, 150.0, 125.0], 3)
    um = 300.0 + DP_UM * 1.8 * np.log(grey / 255.0) + 2.0 * np.random.default_rng(9).standard_normal(grey.size)
    return table(
        "grey,thickness_um", grey, um, number_format="%.1f", comment="# simulated: light = (grey / 255)^1.8, Dp 110 µm"
    )


def switched() -> str:
    """Return readings of a receiver, its emitter switched at 100 Hz, in ambient light that drifts and flickers."""
    time_s = np.arange(0.0, 3.0, 0.005)
    on = np.arange(time_s.size) % 2 == 0
    ambient = 0.4 + 0.05 * time_s + 0.03 * np.sin(2 * np.pi * 1.3 * time_s)
    swing = 0.3 * np.sin(2 * np.pi * 0.5 * time_s)
    noise = 0.002 * np.random.default_rng(10).standard_normal(time_s.size)
    volts = 4.5 - ambient - np.where(on, 1.0 + swing, 0.0) + noise
    return table("time_s,right (V),led", time_s, volts, on, comment="# simulated: an emitter switched at 100 Hz")


def png(grey: FloatArray, description: str) -> bytes:
    """Return a grey-scale image of 32 levels whose description states that it is simulated."""
    file, metadata = io.BytesIO(), PngImagePlugin.PngInfo()
    metadata.add_text("Description", f"simulated: {description}")
    Image.fromarray(8 * np.rint(31.0 * np.clip(grey, 0.0, 1.0)).astype(np.uint8)).save(
        file, "PNG", pnginfo=metadata, optimize=True
    )
    return file.getvalue()


def pillars() -> bytes:
    """Return an image of the group-a coupon under a microscope, 14 µm per pixel."""
    return png(Camera(14.0, 3.0, blur_px=1.2, noise=0.005).image(Print(layout("group-a"))), "coupon group-a")


def holes() -> bytes:
    """Return an image of the holes coupon under the same microscope."""
    return png(Camera(14.0, -2.0, blur_px=1.2, noise=0.005).image(Print(layout("holes"))), "coupon holes")


def micrometer() -> bytes:
    """Return an image of a stage micrometer with a line every 10 µm, 0.625 µm per pixel."""
    return png(ruler(np.random.default_rng(1), 16.0, 3.0, noise=0.01), "stage micrometer, 10 µm")


def marker() -> bytes:
    """Return a video of a marker that rests, then turns by ±3° and back, in two seconds."""
    eye = VideoCamera(oblique_view(20.0, 0.0), cells("DICT_4X4_1000", 3, 6), noise=1.0)
    angles = 3.0 * np.sin(2 * np.pi * np.clip(np.arange(42) - 12, 0, 30) / 30)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "marker.avi"
        write_avi(file, (eye.frame(float(angle)) for angle in angles), 20.0)
        return file.read_bytes()


def features() -> bytes:
    """Return sizes of coupon features from a printer that blurs by 20 µm, as `solen print fidelity` writes them."""
    with tempfile.TemporaryDirectory() as folder:
        return features_file(Path(folder) / "features.json").read_bytes()


def journal() -> bytes:
    """Return the journal of an interrupted run on the simulated rig."""

    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for stem, text in starter_files().items():
            (folder / f"{stem}.toml").write_text(text, encoding="utf-8")
        with suppress(KeyboardInterrupt), patch("platform.platform", return_value="simulated"):
            record(folder / "rotation.toml", folder / "rig.toml", folder, RecordOptions(), watch=interrupt)
        return next(folder.glob("*.journal")).read_bytes()


TABLES: dict[str, Callable[[], str]] = {
    "discs-simulated.csv": discs,
    "guides-simulated.csv": guides,
    "layer-simulated.csv": layer,
    "absorbance-simulated.csv": absorbance,
    "exposures-simulated.csv": exposures,
    "cube-simulated.csv": cube,
    "greys-simulated.csv": greys,
    "switched-simulated.csv": switched,
}
OTHER_FILES: dict[str, Callable[[], bytes]] = {
    NAME: micrograph,
    "pillars-simulated.png": pillars,
    "holes-simulated.png": holes,
    "micrometer-simulated.png": micrometer,
    "features-simulated.json": features,
    "marker-simulated.avi": marker,
    "interrupted-simulated.journal": journal,
    "rotation-simulated.csv": lambda: recording().encode(),
    "scene.json": (ROOT / "tests" / "scenes" / "oval-relay.json").read_bytes,
    "again-simulated.csv": lambda: second_day().encode(),
}


def main() -> None:
    """Write all sample data."""
    tables = {name: lambda write=write: write().encode() for name, write in TABLES.items()}
    for name, write in (tables | OTHER_FILES).items():
        (SAMPLES / name).write_bytes(write())
        print(f"{name}: {(SAMPLES / name).stat().st_size} bytes")


if __name__ == "__main__":
    main()
