"""The command that measures an angle in a video: `solen bench video`."""

from collections.abc import Iterator

from solen.bench.video import VideoMotion
from solen.cli.app import lines
from solen.pipeline.bench.video import video as video


@lines.register
def _(motion: VideoMotion) -> Iterator[str]:
    yield f"marker {motion.marker}, {motion.frames} frames at {motion.rate_hz:.4g} Hz"
    yield (
        f"from {motion.low_deg:+.3f}° to {motion.high_deg:+.3f}°, each ± {motion.u_angle_deg:.2g}°; corners "
        f"deviate from a square by {motion.misfit_px:.2g} px"
    )
    if motion.u_start_s is not None:
        times = " and off at ".join(f"{time_s:.3f} s" for time_s in motion.glow_s)
        yield f"the emitters switch on at {times} of the video, each ± {1e3 * motion.u_start_s:.2g} ms"
