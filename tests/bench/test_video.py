"""An angle from a video: from synthetic markers, through video files, to a response."""

import re
from pathlib import Path

import h5netcdf
import numpy as np
import pytest

from solen.analysis import study
from solen.analysis.sensor_response import AnalysisOptions
from solen.arrays import FloatArray
from solen.bench.simulated.stage import Axis
from solen.bench.video import VideoMotion, VideoOptions, motion_of
from solen.errors import DataError, OutputError, SpecError
from solen.pipeline.bench.video import video
from tests.bench.video_support import Camera, cells, oblique_view, write_avi, write_mkv

pytest.importorskip("cv2")
RATE_HZ = 30.0


def paper_motion(cycles: int = 1, begin_s: float = 0.6) -> Axis:
    """The motion of the paper: 3 degrees to either side at 15 degrees per second, with holds."""
    axis, time_s = Axis(200.0), begin_s
    for _ in range(cycles):
        for target in (-3.0, 3.0, 0.0):
            time_s = axis.send(time_s, target, 15.0).end_s + 0.4
    return axis


def camera(dictionary: str = "DICT_4X4_1000", size: int = 6, **options: object) -> Camera:
    marker = cells(dictionary, 7, size)
    return Camera(oblique_view(25.0, 15.0), marker, **options)  # type: ignore[arg-type]  # options of a test


def write_motion(path: Path, camera: Camera, axis: Axis, duration_s: float) -> tuple[FloatArray, FloatArray]:
    """Write a video of a motion, and return times and angles of its frames."""
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    angles = axis.positions(time_s)
    write_avi(path, (camera.frame(angle) for angle in angles), RATE_HZ)
    return time_s, angles


def errors(motion: VideoMotion, time_s: FloatArray, angle: FloatArray) -> FloatArray:
    return np.asarray(motion.angle_deg - np.interp(motion.time_s, time_s, angle))


@pytest.mark.parametrize(
    ("options", "camera"),
    [
        ({}, camera()),
        ({}, camera(blur_px=2.0, noise=6.0)),
        ({"dictionary": "apriltag-36h11"}, camera("DICT_APRILTAG_36h11", 8)),
        ({"marker": 7}, Camera(oblique_view(40.0, -20.0, 8.0), cells("DICT_4X4_1000", 7, 6), blur_px=0.8)),
    ],
)
def test_measures_angle_of_marker(tmp_path: Path, options: dict[str, object], camera: Camera) -> None:
    time_s, angle = write_motion(tmp_path / "turn.avi", camera, paper_motion(), 2.5)
    motion = motion_of(tmp_path / "turn.avi", VideoOptions(readout_ms=1e-9, **options))
    error = errors(motion, time_s, angle)
    rms = float(np.sqrt(np.mean(error**2)))
    covered = float(np.mean(np.abs(error) <= 2.0 * motion.u_angle_deg))
    slope = np.polyfit(angle, motion.angle_deg, 1)[0]
    print(f"\n  RMS {rms:.4f} deg, u {motion.u_angle_deg:.4f}, within 2 u {covered:.2f}, slope {slope:.5f}")
    assert rms < 0.05
    assert covered > 0.9
    assert motion.u_angle_deg < 3.0 * rms
    assert slope == pytest.approx(1.0, abs=5e-3)
    assert (motion.marker, motion.frames, motion.without, motion.ambiguous) == (7, 75, 0, 0)
    assert motion.rate_hz == pytest.approx(RATE_HZ)
    assert motion.warnings == ()


def test_uses_irregular_time_stamps(tmp_path: Path) -> None:
    rng, eye = np.random.default_rng(3), camera()
    step_ms = rng.integers(25, 42, 60)
    step_ms[40] = 180  # dropped frames
    time_ms = np.cumsum(step_ms).tolist()
    angle = paper_motion().positions(1e-3 * np.array(time_ms, float))
    write_mkv(tmp_path / "uneven.mkv", (eye.frame(angle_deg) for angle_deg in angle), time_ms)
    motion = motion_of(tmp_path / "uneven.mkv")
    assert motion.time_s - motion.time_s[0] == pytest.approx(1e-3 * (np.array(time_ms) - time_ms[0]), abs=1e-6)
    assert motion.longest_gap_s == pytest.approx(0.18)
    assert np.sqrt(np.mean((motion.angle_deg - angle) ** 2)) < 0.05
    warnings = " ".join(motion.warnings)
    assert "number of gaps in the video: 1, up to 0.18 s" in warnings
    assert re.search(r"intervals between frames vary by \d\.\d ms about 3\d", warnings)
    assert "rolling shutter" in warnings


def test_omits_frames_with_hidden_or_ambiguous_marker(tmp_path: Path) -> None:
    eye, path = Camera(oblique_view(25.0, 15.0, 9.0), cells("DICT_4X4_1000", 7, 6)), tmp_path / "partly.avi"
    kinds = [{"hidden": True}] * 4 + [{"twice": True}] * 3 + [{}] * 20
    write_avi(path, (eye.frame(0.0, **kind) for kind in kinds), RATE_HZ)
    motion = motion_of(path)
    assert (motion.frames, motion.without, motion.ambiguous, len(motion.time_s)) == (27, 4, 3, 20)
    assert motion.time_s[0] == pytest.approx(7.0 / RATE_HZ)
    assert any("4 frames without" in warning and "3 that show it twice" in warning for warning in motion.warnings)
    with pytest.raises(DataError, match=r"usable marker 9 in 0 of 27 frames; .*--marker.* 7"):
        motion_of(path, VideoOptions(marker=9))
    write_avi(path, (eye.frame(0.0, hidden=True) for _ in range(20)), RATE_HZ)
    with pytest.raises(DataError, match=r"in 0 of 20 frames; 16 are needed; .*sharp.*--dictionary"):
        motion_of(path)
    other = Camera(eye.view, cells("DICT_4X4_1000", 12, 6))
    both = np.concatenate([eye.frame(0.0)[:, 100:260], other.frame(0.0)[:, 100:260]], axis=1)
    write_avi(path, [both] * 20, RATE_HZ)
    with pytest.raises(DataError, match=r"markers 7, 12; .*--marker"):
        motion_of(path)


GLOW = (290, 210, 20, 20)
ON_S, OFF_S, BEGIN_S = 0.41, 1.43, 12.5


def write_glow(path: Path, on_s: float = ON_S, off_s: float = OFF_S) -> None:
    eye, time_s = camera(), np.arange(0.0, 1.7, 1.0 / RATE_HZ)
    write_avi(path, (eye.frame(0.0, glow=60.0 * on) for on in (time_s > on_s) & (time_s < off_s)), RATE_HZ)


def write_recording(path: Path, duration_s: float) -> None:
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"period": 100}
        file.create_variable("time_s", ("period",), float)[...] = BEGIN_S + np.linspace(0.0, duration_s, 100)


def test_glow_of_emitters_gives_clock_of_recording(tmp_path: Path) -> None:
    path, recording = tmp_path / "lit.avi", tmp_path / "run.nc"
    write_glow(path)
    write_recording(recording, OFF_S - ON_S)
    plain = motion_of(path, VideoOptions(glow=GLOW))
    assert plain.u_start_s is not None
    assert plain.glow_s[0] == pytest.approx(ON_S, abs=2.0 * plain.u_start_s)
    assert plain.time_s[0] == pytest.approx(-plain.glow_s[0])
    matched = motion_of(path, VideoOptions(glow=GLOW, recording=recording))
    assert matched.time_s[0] == pytest.approx(BEGIN_S - ON_S, abs=2.0 * plain.u_start_s)
    assert not [warning for warning in matched.warnings if "belongs to this video" in warning]
    with pytest.raises(DataError, match="no times in its root"):
        motion_of(path, VideoOptions(glow=GLOW, recording=path))
    write_recording(recording, 20.0)
    other = motion_of(path, VideoOptions(glow=GLOW, recording=recording))
    assert re.search(r"emitters are visible for 1\.0\d s, and the recording lasts 20\.00 s", " ".join(other.warnings))
    shifted = motion_of(path, VideoOptions(offset_s=3.0, readout_ms=30.0))
    assert shifted.time_s[0] == pytest.approx(3.015, abs=0.004)  # the marker is in the middle of the rows


def test_refuses_video_without_switching_glow_and_contradictory_options(tmp_path: Path) -> None:
    path = tmp_path / "lit.avi"
    write_glow(path, -1.0, 0.5)
    with pytest.raises(DataError, match="begins with the emitters on"):
        motion_of(path, VideoOptions(glow=GLOW))
    with pytest.raises(DataError, match="shows no glow in this region"):
        motion_of(path, VideoOptions(glow=(10, 10, 20, 20)))
    with pytest.raises(SpecError, match=r"--glow = '310 210 20 20'; .*320 by 240"):
        motion_of(path, VideoOptions(glow=(310, 210, 20, 20)))
    with pytest.raises(SpecError, match=r"--offset-s; .*--glow"):
        motion_of(path, VideoOptions(glow=GLOW, offset_s=1.0))
    with pytest.raises(SpecError, match=r"--recording; .*--glow"):
        motion_of(path, VideoOptions(recording=path))
    (tmp_path / "none.mp4").write_bytes(b"no video")
    with pytest.raises(DataError, match="is not a video that OpenCV can read"):
        motion_of(tmp_path / "none.mp4")
    with pytest.raises(DataError, match=r"gone\.mp4; does not exist"):
        motion_of(tmp_path / "gone.mp4")


def test_video_is_motion_log_of_recording(tmp_path: Path) -> None:
    axis, lag_s = paper_motion(3, 1.0), 0.2
    duration_s = axis.moves[-1].end_s + 0.5
    write_motion(tmp_path / "turn.avi", camera(), axis, duration_s)
    outcome = video(tmp_path / "turn.avi", options=VideoOptions(offset_s=lag_s), out=tmp_path / "log.csv")
    assert outcome.files["out"].read_text(encoding="utf-8").startswith("time_s,angle_deg,u_angle_deg\n")
    with pytest.raises(OutputError, match=r"log\.csv; .*exists"):
        video(tmp_path / "turn.avi", out=tmp_path / "log.csv")
    time_s = np.arange(0.0, duration_s, 2e-3)
    volts = 2.0 + 0.3 * axis.positions(time_s) + 1e-3 * np.random.default_rng(2).standard_normal(len(time_s))
    np.savetxt(
        tmp_path / "daq.csv", np.column_stack([time_s, volts]), delimiter=",", header="time_s,right (V)", comments=""
    )
    result = study([tmp_path / "daq.csv"], AnalysisOptions(angle_file=(tmp_path / "log.csv",)))
    (sensor,), (alignment,) = result.sensors.values(), result.alignment.values()
    print(f"\n  lag {alignment.lag_s:.4f} s +- {alignment.u_lag_s:.4f}")
    assert abs(alignment.lag_s - lag_s) < 3.0 * alignment.u_lag_s + 1e-3
    (receiver,) = sensor.to_dict()["receivers"].values()
    slope = np.polyfit(receiver["angle_deg"], np.array(receiver["mean_V"], float), 1)[0]
    assert slope == pytest.approx(0.3, rel=5e-3)
    assert receiver["hysteresis_percent"] < 1.0


def test_marker_that_moves_at_beginning_has_uncertain_zero(tmp_path: Path) -> None:
    time_s, eye = np.arange(0.0, 2.0, 1.0 / RATE_HZ), camera()
    angle = 3.0 * np.sin(2.0 * np.pi * time_s / 2.5)
    write_avi(tmp_path / "moving.avi", (eye.frame(angle_deg) for angle_deg in angle), RATE_HZ)
    motion = motion_of(tmp_path / "moving.avi", VideoOptions(readout_ms=1e-9))
    assert any("do not use" in warning and "0.5 s" in warning for warning in motion.warnings)
    error = np.abs(errors(motion, time_s, angle))
    assert error.min() > 1.0
    assert error.max() < 2.0 * motion.u_angle_deg
