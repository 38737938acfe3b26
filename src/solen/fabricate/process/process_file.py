"""Process file: the properties of a printer and a resin, each parameter with its uncertainty and source.

A prediction is only as good as its inputs. The file therefore has three tables with the same keys: values
(``[process]``), standard uncertainties (``[uncertainty]``) and sources (``[source]``). It also contains the covariance
of parameters that were calibrated together. Missing values are those of the default process, with their sources.

The default follows the paper on which solen is based (Cafiso et al., Methods) where possible: 13 mW/cm², layers of
25 µm, 2 s, and six burn-in layers of 3 s. The paper reports only bounds of the working curve, and nothing about the
projector: those values are assumptions, and marked as such in the file.

`read_process` and `default_process` return a `Process` with these tables; `process_text` writes one.
"""

from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import tomli_w
from pydantic import Field, model_validator

from solen.arrays import FloatArray
from solen.errors import DataError, SolenError
from solen.fabricate.grey import Greys
from solen.fabricate.process.response import light_of_file
from solen.fabricate.process.settings import KEYS, UNCERTAIN, Settings
from solen.files import read_text
from solen.ranks import Caution, do_not_use, warning
from solen.spec.strict import (
    Document,
    Migrations,
    NotNegative,
    Number,
    Strict,
    Text,
    error_context,
    migrated,
    parse_toml,
    refused,
)

SCHEMA = 1
MIGRATIONS: Migrations = {}
GROWTH = "growth_um"
"""Key of the growth of a straight wall, which a calibration determines instead of the critical dose."""
CRITICAL = "Ec_mJ_per_cm2"
U_RESPONSE = 0.05
"""Default standard uncertainty of the scale of a response."""


class Calibration(Strict):
    """Parameters that were fitted together, and their covariance in the units of their keys.

    If ``growth_um`` is one of them, the growth of walls is kept when other parameters are varied.
    """

    table: ClassVar[str] = "calibration"
    error: ClassVar[type[SolenError]] = DataError

    keys: tuple[Text, ...] = Field(description="keys of the parameters.")
    covariance: tuple[tuple[Number, ...], ...] = Field(description="covariance matrix, one row per parameter.")
    features: Annotated[int, Field(strict=True, ge=0)] = Field(0, description="Number of features in the fit.")
    simulated: Annotated[bool, Field(strict=True)] = Field(False, description="Whether the features were simulated.")

    @model_validator(mode="after")
    def _check_covariance(self) -> Self:
        allowed, count = (GROWTH, *UNCERTAIN), len(self.keys)
        unknown = next((key for key in self.keys if key not in allowed), None)
        if unknown is not None:
            raise refused("keys", f"must be among {', '.join(allowed)}", value=unknown)
        if not count:
            raise refused("keys", "must name at least one parameter")
        if [len(row) for row in self.covariance] != [count] * count:
            raise refused("covariance", f"must be {count} rows of {count} numbers, one for each of {list(self.keys)}")
        matrix = np.array(self.covariance, dtype=float)
        if not np.allclose(matrix, matrix.T):
            raise refused("covariance", "must be symmetric", remedy="copy the whole matrix of the fit")
        smallest = float(np.linalg.eigvalsh(matrix).min())
        if smallest < -1e-9 * abs(np.trace(matrix)):
            limit = f"must have no negative eigenvalue, but has {smallest:.3g}"
            raise refused("covariance", limit, remedy="copy the whole matrix with all its digits")
        return self


class Process(Strict):
    """A process file: its name, and values, uncertainties and sources by key."""

    error: ClassVar[type[SolenError]] = DataError

    name: Text = Field(description="name of the process, in one line.")
    process: Settings = Field(default_factory=Settings, description="Values of the process.")
    uncertainty: dict[str, NotNegative] = Field(default_factory=dict, description="Standard uncertainties, by key.")
    source: dict[str, str] = Field(default_factory=dict, description="Source of each value, by key.")
    calibration: Calibration | None = Field(None, description="Covariance of the calibrated parameters.")

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        for table, allowed in (("uncertainty", UNCERTAIN), ("source", KEYS)):
            for key in getattr(self, table):
                if key not in allowed:
                    raise refused(table, f"must be one of {', '.join(allowed)}", value=key)
        unused, has = ("response_scale", "no") if self.process.response is None else ("sigma_um", "a")
        if unused in self.uncertainty:
            limit = f"does not apply to this process, which has {has} pixel response"
            raise refused(f"uncertainty.{unused}", limit, value=self.uncertainty[unused], remedy=f"omit {unused}")
        return self

    @property
    def keeps_growth(self) -> bool:
        """Whether the growth of walls was calibrated, and is kept when other parameters are varied."""
        return self.calibration is not None and GROWTH in self.calibration.keys

    def covariance(self) -> tuple[tuple[str, ...], FloatArray]:
        """Return the keys of the uncertain parameters, and their covariance.

        Parameters that were not calibrated together are independent. If the growth of walls was calibrated, it replaces
        the critical dose.
        """
        joint: tuple[str, ...] = () if self.calibration is None else self.calibration.keys
        independent = [key for key in UNCERTAIN if self.uncertainty.get(key, 0.0) > 0.0 and key not in joint]
        if self.keeps_growth and CRITICAL in independent:
            independent.remove(CRITICAL)
        matrix = np.diag([0.0] * len(joint) + [self.uncertainty[key] ** 2 for key in independent])
        if self.calibration is not None:
            matrix[: len(joint), : len(joint)] = self.calibration.covariance
        return (*joint, *independent), matrix

    def with_settings(self, **values: Any) -> "Process":
        """Return a process with some values changed, without the uncertainties and sources of the old values."""
        data = self.model_dump(exclude_unset=False)
        data["process"] |= values
        for key in values:
            data["uncertainty"].pop(key, None)
            data["source"].pop(key, None)
        if set(values) - {"pixel_um", "pixel_y_um"}:
            data["calibration"] = None
        return Process(**data)

    @property
    def greys(self) -> Greys:
        """Light of grey pixels, with the pixel size of the process unless that is an assumption."""
        assumed = self.source.get("pixel_um", "").lower().startswith("assum")
        return replace(self.process.greys, pixels_um=None) if assumed else self.process.greys

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Keys of assumed values, whose source begins with "assum" or is missing."""
        unused = {"sigma_um"} if self.process.response is not None else {"response", "response_scale"}
        used = [key for key in KEYS if key not in unused]
        return tuple(key for key in used if self.source.get(key, "assumption").lower().startswith("assum"))

    def warnings(self) -> list[Caution]:
        """Return warnings about prints modelled with these parameters."""
        messages, s = [], self.process
        if s.cure_depth_um < s.layer_um:
            depth = f"{s.exposure_s:g} s ({s.dose_mJ_per_cm2:.3g} mJ/cm²) cure {s.cure_depth_um:.3g} µm"
            text = f"{depth}, less than a layer of {s.layer_um:g} µm: the layers would not adhere to each other"
            messages.append(do_not_use(f"{text}; expose for longer or use thinner layers"))
        hot_pixel = None if s.response is None else s.response.hot_pixel
        if hot_pixel is not None:
            row, column, ratio = hot_pixel
            sample = f"sample {column} of row {row} is {ratio:.3g} times as bright as its brightest neighbour"
            cause = "probably a hot pixel of the camera; replace the sample with the mean of its neighbours"
            messages.append(do_not_use(f"process.response: {sample}: {cause}"))
        assumed = [key for key in self.assumptions if key in UNCERTAIN]
        if assumed:
            remedy = "calibrate them with coupons and solen print calibrate"
            messages.append(warning(f"assumed, not measured: {', '.join(assumed)}; {remedy}"))
        if self.calibration is not None and self.calibration.simulated:
            messages.append(warning("the process was calibrated with simulated coupons or a simulated working curve"))
        return messages


def default_process() -> Process:
    """Return the default process, whose file is shipped with solen."""
    text = (files("solen.fabricate.process") / "default.toml").read_text(encoding="utf-8")
    return parsed_process(text, "default process")


def read_process(path: Path) -> Process:
    """Read a process file; raise `DataError` if it cannot be read or is invalid."""
    return parsed_process(read_text(path, DataError), str(path), path.parent)


def response_file(path: Path) -> Path | None:
    """Return the path of the pixel response that a process file names; None if it names none."""
    data: Any = parse_toml(read_text(path, DataError), str(path), DataError)
    for key in ("process", "response", "file"):
        data = data.get(key) if isinstance(data, dict) else None
    return path.parent / data if isinstance(data, str) else None


def parsed_process(text: str, what: str, folder: Path = Path()) -> Process:
    """Return the process in a TOML document; missing values are those of the default, with uncertainty and source.

    ``folder`` is the base folder of the path of a pixel response.
    """
    data = migrated(parse_toml(text, what, DataError), what, current=SCHEMA, migrations=MIGRATIONS, error=DataError)
    _read_response(data, what, folder)
    with error_context(what):
        process = Process(**data)
        return process if what == "default process" else _completed(process)


def _read_response(data: Document, what: str, folder: Path) -> None:
    """Replace the file name of a pixel response by the light in that file, and add the file to the sources."""
    table = data.get("process", {}).get("response") if isinstance(data.get("process"), dict) else None
    if not isinstance(table, dict) or "file" not in table:
        return
    file = table.pop("file")
    subject = f"{what}: process.response.file"
    if not isinstance(file, str):
        raise DataError(subject, value=file, limit="must be the name of a file")
    if "light" in table:
        limit = "cannot be combined with process.response.light"
        raise DataError(subject, value=file, limit=limit, remedy="omit one of them")
    table["light"] = light_of_file(folder / file)
    if isinstance(source := data.setdefault("source", {}), dict):
        source.setdefault("response", f"measured: {file}")


def _completed(process: Process) -> Process:
    """Return the process with default values, uncertainties and sources for missing keys."""
    default = default_process()
    if process.process.response is not None and "response_scale" not in process.uncertainty:
        source = {"response_scale": f"assumption: image scale and focus known to {100 * U_RESPONSE:g} %"}
        is_set = "response_scale" in process.process.model_fields_set
        u = process.uncertainty | ({} if is_set else {"response_scale": U_RESPONSE})
        process = process.model_copy(update={"source": source | process.source, "uncertainty": u})
    missing = [key for key in KEYS if key not in process.process.model_fields_set]
    values = {key: getattr(default.process, key) for key in missing}
    u = {key: default.uncertainty[key] for key in missing if key in default.uncertainty}
    source = {key: default.source[key] for key in missing if key in default.source}
    data = process.model_dump()
    data["process"] |= values
    data["uncertainty"] = u | data["uncertainty"]
    data["source"] = source | data["source"]
    return Process(**data)


def process_text(process: Process) -> str:
    """Return a process with all its values as a TOML document, which `read_process` can read."""
    data: Mapping[str, Any] = process.model_dump(exclude_none=True)
    return tomli_w.dumps({"schema": SCHEMA, **{key: value for key, value in data.items() if value or key == "name"}})
