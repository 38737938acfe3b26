"""Film the studio: frames of a real browser while the lens is turned and the emitter is dragged, for the documentation.

    python tools/studio_film.py docs/images/studio-moving.webp docs/images/studio.png

The first file is the moving picture, the second one of its frames with sharp text. The tool needs Chromium, Node, and
`npm ci` in web/; it draws nothing that the page did not show.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from PIL import Image

from solen.studio.document import Document
from solen.studio.server import server_at

DRIVER = Path(__file__).resolve().parents[1] / "web" / "tests" / "film.mjs"
WIDTH, FRAME_MS, QUALITY = 1000, 90, 58
LARGEST = 1_000_000
"""Largest size of the moving picture in bytes."""


def filmed(folder: Path) -> list[Image.Image]:
    """Return the frames of the page in their order."""
    browser = shutil.which("chromium") or shutil.which("google-chrome") or sys.exit("no Chromium")
    server, listening, page = server_at(Document(folder / "sensor.toml"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        command = [shutil.which("node") or "node", str(DRIVER), page, str(folder), browser]
        subprocess.run(command, check=True)  # noqa: S603  its own
    finally:
        server.should_exit = True
        thread.join(10)
        listening.close()
    return [Image.open(path).convert("RGB") for path in sorted(folder.glob("frame-*.png"))]


def main() -> None:
    """Write both pictures."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("moving", type=Path)
    options.add_argument("still", type=Path)
    asked = options.parse_args()
    with tempfile.TemporaryDirectory() as name:
        frames = filmed(Path(name))
    frames[0].quantize(256).save(asked.still, optimize=True)
    height = round(WIDTH * frames[0].height / frames[0].width)
    small = [frame.resize((WIDTH, height), Image.Resampling.LANCZOS) for frame in frames]
    small[0].save(
        asked.moving, save_all=True, append_images=small[1:], duration=FRAME_MS, loop=0, quality=QUALITY, method=6
    )
    size = asked.moving.stat().st_size
    print(f"{len(frames)} frames, {size / 1000:.0f} kB")
    if size > LARGEST:
        sys.exit(f"larger than {LARGEST / 1000:.0f} kB: lower QUALITY or WIDTH")


if __name__ == "__main__":
    main()
