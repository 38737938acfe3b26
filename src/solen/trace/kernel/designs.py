"""Designs as arrays, and the tables and rays of one design at all angles and positions, concatenated."""

from typing import NamedTuple

from solen.arrays import FloatArray, IntArray
from solen.trace.kernel.batch import Starts
from solen.trace.kernel.buffers import Rows
from solen.trace.kernel.compiled import called
from solen.trace.kernel.extruded import RowsInSpace
from solen.trace.kernel.lattices import launch, launch_in_space, light_row
from solen.trace.kernel.y_tables import Pose, front_of, y_row, y_tables
from solen.trace.tables import Tables


class Sensors(NamedTuple):
    """Sensors as arrays of parameters."""

    body: FloatArray
    """(D, 26) rows of `Y`"""
    light: FloatArray
    """(D, 8) rows of `Light`"""
    thickness: FloatArray
    """(D,) mm; 0 in the plane"""
    pieces: FloatArray
    """(N, 12) pieces of spline lenses, in their own frames"""
    before: IntArray
    """(N,) index of the piece that each piece continues"""
    pattern: FloatArray
    """(T, 2) rows of tabulated patterns: angle in radians, relative intensity"""


class Bins(NamedTuple):
    """Position bins (B,) in front of the lens, from ``low`` to ``high`` in mm to the right of the axis."""

    low: FloatArray
    high: FloatArray


@called
def prepare(
    sensors: Sensors,
    d: int,
    angle_deg: FloatArray,
    tables: Tables,
    starts: Starts,
    poses: FloatArray,
    soundness: IntArray,
) -> None:
    """Write the tables of a design, its emitter poses (A, 3) and its soundness codes (A,) at each angle."""
    y, first = y_row(sensors.body, d), 0
    front = front_of(y)
    for a in range(len(angle_deg)):
        starts.piece[a] = first
        last, code, pose = y_tables(tables, sensors.pieces, sensors.before, y, front, angle_deg[a], first)
        poses[a, 0], poses[a, 1], poses[a, 2] = pose
        soundness[a] = code
        tables.refractive_index[a, 1], tables.absorption[a, 1] = y.refractive_index, y.absorption
        first = last
    starts.piece[len(angle_deg)] = first


@called
def launch_all(
    sensors: Sensors, d: int, tables: Tables, starts: Starts, poses: FloatArray, bins: Bins, seed: int, rays: Rows,
    rays_per_bin: int,
) -> None:  # fmt: skip
    """Write the rays for each angle and bin."""
    light = light_row(sensors.light, d)
    for a in range(len(poses)):
        pose = Pose(poses[a, 0], poses[a, 1], poses[a, 2])
        for b in range(len(bins.low)):
            launch(
                tables, starts.piece[a], starts.piece[a + 1], pose, light, sensors.pattern, bins.low[b], bins.high[b],
                seed, a, b, rays, (a * len(bins.low) + b) * rays_per_bin, rays_per_bin,
            )  # fmt: skip


@called
def launch_all_in_space(
    sensors: Sensors, d: int, tables: Tables, starts: Starts, poses: FloatArray, bins: Bins, seed: int,
    rays: RowsInSpace, rays_per_bin: int,
) -> None:  # fmt: skip
    """As `launch_all`, in space."""
    light, half = light_row(sensors.light, d), 0.5 * sensors.thickness[d]
    for a in range(len(poses)):
        pose = Pose(poses[a, 0], poses[a, 1], poses[a, 2])
        for b in range(len(bins.low)):
            launch_in_space(
                tables, starts.piece[a], starts.piece[a + 1], pose, light, sensors.pattern, half, bins.low[b],
                bins.high[b], seed, a, b, rays, (a * len(bins.low) + b) * rays_per_bin, rays_per_bin,
            )  # fmt: skip
