"""An angle from a video: of markers that are drawn here, through files of video, to a response."""

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
from tests.bench.video_support import Camera, cells, seen_by, write_avi, write_mkv

pytest.importorskip("cv2")
RATE_HZ = 30.0


def axis(cycles: int = 1, begin_s: float = 0.6) -> Axis:
    """The paper's turn: 3 degrees to either side at 15 degrees per second, with holds."""
    moved, at = Axis(200.0), begin_s
    for _ in range(cycles):
        for target in (-3.0, 3.0, 0.0):
            at = moved.send(at, target, 15.0).end_s + 0.4
    return moved


def camera(kind: str = "DICT_4X4_1000", size: int = 6, **more: object) -> Camera:
    return Camera(seen_by(25.0, 15.0), cells(kind, 7, size), **more)  # type: ignore[arg-type]  # what a test asks for


def filmed(path: Path, eye: Camera, moved: Axis, duration_s: float) -> tuple[FloatArray, FloatArray]:
    """Times and angles of the pictures of a video that is written."""
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    angle = moved.positions(time_s)
    write_avi(path, (eye.picture(one) for one in angle), RATE_HZ)
    return time_s, angle


def errors(motion: VideoMotion, time_s: FloatArray, angle: FloatArray) -> FloatArray:
    return np.asarray(motion.angle_deg - np.interp(motion.time_s, time_s, angle))


@pytest.mark.parametrize(
    ("options", "eye"),
    [
        ({}, camera()),
        ({}, camera(blur_px=2.0, noise=6.0)),
        ({"dictionary": "apriltag-36h11"}, camera("DICT_APRILTAG_36h11", 8)),
        ({"marker": 7}, Camera(seen_by(40.0, -20.0, 8.0), cells("DICT_4X4_1000", 7, 6), blur_px=0.8)),
    ],
)
def test_the_angle_of_a_marker_is_that_it_was_drawn_at(tmp_path: Path, options: dict[str, object], eye: Camera) -> None:
    time_s, angle = filmed(tmp_path / "turn.avi", eye, axis(), 2.5)
    motion = motion_of(tmp_path / "turn.avi", VideoOptions(readout_ms=1e-9, **options))
    off = errors(motion, time_s, angle)
    rms = float(np.sqrt(np.mean(off**2)))
    covered = float(np.mean(np.abs(off) <= 2.0 * motion.u_angle_deg))
    slope = np.polyfit(angle, motion.angle_deg, 1)[0]
    print(f"\n  rms {rms:.4f} deg, u {motion.u_angle_deg:.4f}, within 2 u {covered:.2f}, slope {slope:.5f}")
    assert rms < 0.05
    assert covered > 0.9
    assert motion.u_angle_deg < 3.0 * rms
    assert slope == pytest.approx(1.0, abs=5e-3)
    assert (motion.marker, motion.pictures, motion.without, motion.ambiguous) == (7, 75, 0, 0)
    assert motion.rate_hz == pytest.approx(RATE_HZ)
    assert motion.warnings == ()


def test_times_are_those_of_the_pictures_however_uneven(tmp_path: Path) -> None:
    rng, moved, eye = np.random.default_rng(3), axis(), camera()
    step_ms = rng.integers(25, 42, 90)
    step_ms[40] = 180  # pictures were dropped
    time_ms = np.cumsum(step_ms).tolist()
    angle = moved.positions(1e-3 * np.array(time_ms, float))
    write_mkv(tmp_path / "uneven.mkv", (eye.picture(one) for one in angle), time_ms)
    motion = motion_of(tmp_path / "uneven.mkv")
    assert motion.time_s - motion.time_s[0] == pytest.approx(1e-3 * (np.array(time_ms) - time_ms[0]), abs=1e-6)
    assert motion.longest_gap_s == pytest.approx(0.18)
    assert np.sqrt(np.mean((motion.angle_deg - angle) ** 2)) < 0.05
    said = " ".join(motion.warnings)
    assert "1 gaps in the video, up to 0.18 s" in said
    assert re.search(r"intervals vary by 4\.\d ms about 33", said)
    assert "rolling shutter" in said


def test_a_marker_that_is_hidden_doubled_or_one_of_several(tmp_path: Path) -> None:
    eye, path = Camera(seen_by(25.0, 15.0, 9.0), cells("DICT_4X4_1000", 7, 6)), tmp_path / "partly.avi"
    kinds = [{"hidden": True}] * 4 + [{"twice": True}] * 3 + [{}] * 20
    write_avi(path, (eye.picture(0.0, **more) for more in kinds), RATE_HZ)
    motion = motion_of(path)
    assert (motion.pictures, motion.without, motion.ambiguous, len(motion.time_s)) == (27, 4, 3, 20)
    assert motion.time_s[0] == pytest.approx(7.0 / RATE_HZ)
    assert "4 pictures show no usable marker, 3 show it twice" in motion.warnings
    with pytest.raises(DataError, match=r"usable marker 9 in 0 of 27 pictures; .*it shows 7"):
        motion_of(path, VideoOptions(marker=9))
    write_avi(path, (eye.picture(0.0, hidden=True) for _ in range(20)), RATE_HZ)
    with pytest.raises(DataError, match="in 0 of 20 pictures; 16 are needed; check that it is sharp"):
        motion_of(path)
    other = Camera(eye.view, cells("DICT_4X4_1000", 12, 6))

    def both() -> np.ndarray:
        first, second = eye.picture(0.0), other.picture(0.0)
        return np.concatenate([first[:, 100:260], second[:, 100:260]], axis=1)

    write_avi(path, (both() for _ in range(20)), RATE_HZ)
    with pytest.raises(DataError, match="shows markers 7, 12; choose the rotating one with --marker"):
        motion_of(path)


GLOW = (290, 210, 20, 20)
ON_S, OFF_S, BEGAN_S = 0.41, 2.33, 12.5


def lit_video(path: Path, *, always: bool = False) -> None:
    eye, time_s = camera(), np.arange(0.0, 2.7, 1.0 / RATE_HZ)
    lit = ((time_s > ON_S) & (time_s < OFF_S)) | always
    write_avi(path, (eye.picture(0.0, glow=60.0 * one) for one in lit), RATE_HZ)


def recorded(path: Path, duration_s: float) -> None:
    with h5netcdf.File(path, "w") as file:
        file.dimensions = {"period": 100}
        file.create_variable("time_s", ("period",), float)[...] = BEGAN_S + np.linspace(0.0, duration_s, 100)


def test_the_emitters_own_light_puts_a_video_on_the_recording_s_clock(tmp_path: Path) -> None:
    lit_video(tmp_path / "lit.avi")
    recorded(tmp_path / "run.nc", OFF_S - ON_S)
    plain = motion_of(tmp_path / "lit.avi", VideoOptions(glow=GLOW))
    assert plain.u_start_s is not None
    assert plain.glow_s[0] == pytest.approx(ON_S, abs=2.0 * plain.u_start_s)
    assert plain.time_s[0] == pytest.approx(-plain.glow_s[0])
    at = motion_of(tmp_path / "lit.avi", VideoOptions(glow=GLOW, recording=tmp_path / "run.nc"))
    assert at.time_s[0] == pytest.approx(BEGAN_S - ON_S, abs=2.0 * plain.u_start_s)
    assert not [one for one in at.warnings if "belongs to this video" in one]
    with pytest.raises(DataError, match="contains no times in its root"):
        motion_of(tmp_path / "lit.avi", VideoOptions(glow=GLOW, recording=tmp_path / "lit.avi"))
    recorded(tmp_path / "run.nc", 20.0)
    other = motion_of(tmp_path / "lit.avi", VideoOptions(glow=GLOW, recording=tmp_path / "run.nc"))
    assert re.search(r"emitters are visible for 1\.9\d s, and the recording lasts 20\.00 s", " ".join(other.warnings))
    stated = motion_of(tmp_path / "lit.avi", VideoOptions(offset_s=3.0))
    assert stated.time_s[0] == pytest.approx(3.0)
    slow = motion_of(tmp_path / "lit.avi", VideoOptions(offset_s=3.0, readout_ms=30.0))
    assert slow.time_s[0] == pytest.approx(3.015, abs=0.004)  # the marker is in the middle of the rows


def test_glow_that_is_not_seen_or_always_on_and_options_that_do_not_go_together(tmp_path: Path) -> None:
    path = tmp_path / "lit.avi"
    lit_video(path, always=True)
    with pytest.raises(DataError, match="shows no glow in this area"):
        motion_of(path, VideoOptions(glow=GLOW))
    with pytest.raises(SpecError, match=r"--glow = '310 210 20 20'; must be within the picture of 320 by 240"):
        motion_of(path, VideoOptions(glow=(310, 210, 20, 20)))
    with pytest.raises(SpecError, match="--offset-s; is already determined"):
        motion_of(path, VideoOptions(glow=GLOW, offset_s=1.0))
    with pytest.raises(SpecError, match="--recording; needs --glow"):
        motion_of(path, VideoOptions(recording=path))
    (tmp_path / "none.mp4").write_bytes(b"no video")
    with pytest.raises(DataError, match="is not a video that OpenCV can read"):
        motion_of(tmp_path / "none.mp4")
    with pytest.raises(DataError, match="no such file"):
        motion_of(tmp_path / "gone.mp4")


def test_a_video_is_the_motion_log_of_a_recording(tmp_path: Path) -> None:
    moved, late_s = axis(3, 1.0), 0.2
    duration_s = moved.moves[-1].end_s + 0.5
    filmed(tmp_path / "turn.avi", camera(), moved, duration_s)
    answer = video(tmp_path / "turn.avi", options=VideoOptions(offset_s=late_s), out=tmp_path / "log.csv")
    assert answer.files["out"].read_text(encoding="utf-8").startswith("time_s,angle_deg,u_angle_deg\n")
    with pytest.raises(OutputError, match=r"log\.csv; already exists"):
        video(tmp_path / "turn.avi", out=tmp_path / "log.csv")
    time_s = np.arange(0.0, duration_s, 2e-3)
    volts = 2.0 + 0.3 * moved.positions(time_s) + 1e-3 * np.random.default_rng(2).standard_normal(len(time_s))
    np.savetxt(
        tmp_path / "daq.csv", np.column_stack([time_s, volts]), delimiter=",", header="time_s,right (V)", comments=""
    )
    found = study([tmp_path / "daq.csv"], AnalysisOptions(angle_file=(tmp_path / "log.csv",)))
    (sensor,), (aligned,) = found.sensors.values(), found.alignment.values()
    print(f"\n  lag {aligned.lag_s:.4f} s +- {aligned.u_lag_s:.4f}")
    assert abs(aligned.lag_s - late_s) < 3.0 * aligned.u_lag_s + 1e-3
    (receiver,) = sensor.to_dict()["receivers"].values()
    slope = np.polyfit(receiver["angle_deg"], np.array(receiver["mean_V"], float), 1)[0]
    assert slope == pytest.approx(0.3, rel=5e-3)
    assert receiver["hysteresis_percent"] < 1.0


def test_a_marker_that_moves_at_the_beginning_has_no_zero(tmp_path: Path) -> None:
    time_s, eye = np.arange(0.0, 2.5, 1.0 / RATE_HZ), camera()
    angle = 3.0 * np.sin(2.0 * np.pi * time_s / 2.5)
    write_avi(tmp_path / "moving.avi", (eye.picture(one) for one in angle), RATE_HZ)
    motion = motion_of(tmp_path / "moving.avi", VideoOptions(readout_ms=1e-9))
    assert any("do not use" in line and "0.5 s" in line for line in motion.warnings)
    off = np.abs(errors(motion, time_s, angle))
    assert off.min() > 1.0
    assert off.max() < 2.0 * motion.u_angle_deg
