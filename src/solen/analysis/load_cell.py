"""A load cell, which converts volts to newtons, with the errors specified by its manufacturer or a calibration.

The same factor applies over the entire range. All readings share two errors: the error of this factor, and the
non-linearity. Because these errors affect an entire calibration, they are not visible in the scatter of the readings;
the uncertainties of a sensitivity and of a decoded force include both errors. If forces are compared with readings of
the same cell, the common errors cancel and are not included.

Public names: `LoadCell`, `load_cell_of` and `least_certain`.
"""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.files import read_text
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, error_context, parse_toml, refused

_RATED_KEYS = ("mV_per_V", "excitation_V")


class LoadCell(Strict):
    """A load cell with its sensitivity, zero and uncertainties."""

    table: ClassVar[str] = "load_cell"

    name: Text = Field("load cell", description="Its name.")
    input: Annotated[int, Field(strict=True, ge=1, le=64)] | None = Field(
        None, description="In a rig: the input to which it is connected."
    )
    N_per_V: Number | None = Field(None, description="Sensitivity in N/V; negative if pressing lowers the voltage.")
    mV_per_V: Positive | None = Field(
        None, description="Alternatively: output at capacity_N, in millivolts per volt of excitation."
    )
    excitation_V: Positive | None = Field(None, description="With mV_per_V: the excitation voltage of the bridge.")
    gain: Positive | None = Field(None, description="With mV_per_V: the amplifier gain; default: 1.")
    capacity_N: Positive | None = Field(None, description="Rated load of the load cell.")
    u_sensitivity_percent: NotNegative | None = Field(
        None, description="Standard uncertainty of the sensitivity, including excitation and amplifier."
    )
    nonlinearity_percent: NotNegative = Field(
        0.0, description="Non-linearity: largest deviation from a straight line, in per cent of capacity_N."
    )
    zero_V: Number | None = Field(
        None, description="Voltage without load; default: its mean over the pause at the beginning (tare)."
    )

    @model_validator(mode="after")
    def _check_sensitivity(self) -> Self:
        rated = [key for key in (*_RATED_KEYS, "gain") if getattr(self, key) is not None]
        if (self.N_per_V is None) == (self.mV_per_V is None):
            limit = "must be specified by N_per_V, or by mV_per_V with excitation_V and capacity_N"
            raise refused("", limit, remedy="add, for example, N_per_V = 2.0")
        if self.N_per_V is not None and rated:
            limit = "cannot be combined with N_per_V"
            raise refused(rated[0], limit, value=getattr(self, rated[0]), remedy="omit one of the two")
        if self.N_per_V == 0.0:
            raise refused("N_per_V", "must not be 0", value=0.0)
        required = [] if self.mV_per_V is None else ["excitation_V", "capacity_N"]
        required += ["capacity_N"] if self.nonlinearity_percent else []
        missing = next((key for key in required if getattr(self, key) is None), None)
        if missing is not None:
            dependent = "mV_per_V" if self.N_per_V is None else "nonlinearity_percent"
            raise refused(missing, f"is missing, but {dependent} requires it")
        return self

    @property
    def sensitivity_N_per_V(self) -> float:
        """Sensitivity in newtons per volt."""
        if self.mV_per_V is None or self.excitation_V is None or self.capacity_N is None:
            return self.N_per_V or 0.0  # always given without mV_per_V
        return self.capacity_N / (1e-3 * self.mV_per_V * self.excitation_V * (self.gain or 1.0))

    @property
    def u_line_N(self) -> float:
        """Standard uncertainty due to non-linearity, taken as the half-width of a uniform distribution."""
        return 0.01 * self.nonlinearity_percent * (self.capacity_N or 0.0) / math.sqrt(3.0)

    @property
    def u_slope(self) -> float | None:
        """Relative standard uncertainty of a slope against force; None if the sensitivity has no specified u.

        A parabolic deviation of height b, i.e. b·4x(1 − x) at a fraction x of the capacity, changes the slope by at
        most 4b/capacity, at the ends of the range.
        """
        if self.u_sensitivity_percent is None:
            return None
        return math.hypot(0.01 * self.u_sensitivity_percent, 4.0 * self.u_line_N / (self.capacity_N or 1.0))

    def force_N(self, volts: FloatArray, zero_V: float) -> FloatArray:
        """Return the forces at the specified voltages, of any shape."""
        return self.sensitivity_N_per_V * (volts - zero_V)


def least_certain(cells: Iterable[LoadCell | None]) -> LoadCell | None:
    """Return the cell with the largest or an unknown uncertainty; None if any cell is not specified."""
    every = list(cells)
    known = [cell for cell in every if cell is not None]
    if not known or len(known) < len(every):
        return None
    return max(known, key=lambda cell: math.inf if cell.u_slope is None else cell.u_slope)


def load_cell_of(path: Path) -> LoadCell:
    """Load the table ``[load_cell]`` from a file, which may be a rig file.

    Raises
    ------
    SpecError
        If the file cannot be read, or the table is missing or invalid.
    """
    data = parse_toml(read_text(path, SpecError), str(path), SpecError)
    table = data.get("load_cell")
    if not isinstance(table, dict):
        raise SpecError(str(path), limit="has no table [load_cell]", remedy="add a table with N_per_V = 2.0")
    with error_context(f"{path}: load_cell"):
        return LoadCell(**table)
