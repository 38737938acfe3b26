"""Record the studio for the documentation: browser frames while the lens is turned and the emitter is dragged.

    python tools/studio_film.py docs/images/studio-moving.webp docs/images/studio.png

The first file is the animation, the second its first frame at full resolution. The tool requires Chromium, Node, and
`npm ci` in web/.
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
MAX_BYTES = 1_000_000
"""Maximum size of the animation."""


def recorded_frames(folder: Path) -> list[Image.Image]:
    """Return the frames of the page in chronological order."""
    browser = shutil.which("chromium") or shutil.which("google-chrome") or sys.exit("Chromium is not installed")
    server, listening, page = server_at(Document(folder / "sensor.toml"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        command = [shutil.which("node") or "node", str(DRIVER), page, str(folder), browser]
        subprocess.run(command, check=True)  # noqa: S603  own driver
    finally:
        server.should_exit = True
        thread.join(10)
        listening.close()
    return [Image.open(path).convert("RGB") for path in sorted(folder.glob("frame-*.png"))]


def main() -> None:
    """Write both files."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("animation", type=Path)
    parser.add_argument("still", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        frames = recorded_frames(Path(name))
    frames[0].quantize(256).save(options.still, optimize=True)
    height = round(WIDTH * frames[0].height / frames[0].width)
    resized = [frame.resize((WIDTH, height), Image.Resampling.LANCZOS) for frame in frames]
    resized[0].save(
        options.animation,
        save_all=True,
        append_images=resized[1:],
        duration=FRAME_MS,
        loop=0,
        quality=QUALITY,
        method=6,
    )
    size = options.animation.stat().st_size
    print(f"{len(frames)} frames, {size / 1000:.0f} kB")
    if size > MAX_BYTES:
        sys.exit(f"must be at most {MAX_BYTES / 1000:.0f} kB: reduce QUALITY or WIDTH")


if __name__ == "__main__":
    main()
