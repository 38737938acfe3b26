"""The command that reads an angle from a video: `solen bench video`."""

from collections.abc import Iterator

from solen.bench.video import VideoMotion
from solen.cli.app import lines
from solen.pipeline.bench.video import video as video


@lines.register
def _(motion: VideoMotion) -> Iterator[str]:
    yield f"marker {motion.marker}, {motion.pictures} pictures at {motion.rate_hz:.4g} Hz"
    yield (
        f"from {motion.low_deg:+.3f}° to {motion.high_deg:+.3f}°, each ± {motion.u_angle_deg:.2g}°; corners "
        f"deviate from a square by {motion.misfit_px:.2g} px"
    )
    if motion.u_start_s is not None:
        seen = " and switch off at ".join(f"{at:.3f} s" for at in motion.glow_s)
        yield f"emitters switch on at {seen} of the video, each ± {1e3 * motion.u_start_s:.2g} ms"
