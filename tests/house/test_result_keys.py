"""One convention for the keys of results, over the JSON of every command: docs/conventions.md states it."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from solen.cli.design.schema import commands, result_schema, result_type
from tests.command_support import answered

_UNITS = """
V mV uV A mA uA nA W mW uW J mJ ohm kohm kPa MPa N g kg mL K C mm mm2 mm3 cm cm2 um um2 um4 nm px deg s ms us min h hz
Hz kHz percent ppm dB dBm MB bytes rows layers samples cycle slot
"""
UNITS = tuple(_UNITS.split())
_ONE = "|".join(UNITS)
UNIT = re.compile(rf"(?:^|_)(?:(?:{_ONE})_)?per_(?:{_ONE})$|(?:^|_)(?:{_ONE})$")
PREFIXES = ("u", "interval95", "sd")
_OPTICS = "n n_D k B abbe T R A common_n random_n substrate_n index_estimate bend scale"
_STATISTICS = """
F p t r_squared chi2 chi2_reduced aicc delta_aicc rms rms_relative lag_one degrees_of_freedom start_degrees_of_freedom
p_curved p_orientation effective_points neighbours widened weighted_squares correlation covariance covariance_ln sigma
chance probability independent_values ratio snr clearness
"""
_SHARES = """
strain peak_strain residual_strain strain_at_break strain_at_strength loss_fraction peak_stress stress_at_half work_in
shift end low high length area overcure scatter_exponent halo_fraction halo_per_depth ln_Ec dose_below_over_Ec
interior_over_single_layer phr volume_error bridged outside share on_share between_share depth
seen contrast pitch_ratio factor scale_factor rms_um_per_percent_of_scale
ambiguous within_68 within_95
"""
_CONTRASTS, _IN_THE_FILES_UNIT = "largest_change at_low at_high", "dark"
_OF_LIGHT = """
power power_by_source detected escaped absorbed truncated missed leaked reflected beside above_below right left emitted
error single_error ledger_error received_share received_plane received_space used_of_supply contrast contrast_from
contrast_to index material_index step response exponent gain
"""
DIMENSIONLESS = frozenset(" ".join((_OPTICS, _STATISTICS, _SHARES, _CONTRASTS, _IN_THE_FILES_UNIT, _OF_LIGHT)).split())
"""Names of numbers without a unit: indices, shares from 0 to 1, contrasts, probabilities, factors."""
RELATIVE = {"ln_Ec", "length", "area"}
OF_ALL = {"power"}
"""Values that several names beside an uncertainty hold: the powers at all receivers."""
"""Values whose uncertainty is stated relative to them, or of their logarithm."""
OF_ROWS = {
    *("value", "u", "u_before", "u_value", "design_value", "u_prior"),
    *("mean", "sd", "u_reading", "mean_ambient", "sd_ambient", "sd_slot"),
}
"""Numbers of tables over parameters or channels of any unit, whose row says which."""
ECHOED = {"options", "settings"}
"""What was asked for, by the names that options and files have."""
CONVERTED = [name for name, place in commands().items() if result_type(place) is not None]

Key = tuple[str, str, dict[str, Any], Mapping[str, Any]]


def keys(schema: dict[str, Any], where: str) -> Iterator[Key]:
    """Where, name, schema and neighbours of every key of a schema."""
    for one in schema.get("anyOf", ()):
        yield from keys(one, where)
    if isinstance(schema.get("items"), dict):
        yield from keys(schema["items"], where)
    if isinstance(schema.get("additionalProperties"), dict):
        yield from keys(schema["additionalProperties"], where)
    properties = schema.get("properties", {})
    for name, inner in properties.items():
        if name in ECHOED:
            continue
        yield where, name, inner, properties
        yield from keys(inner, f"{where}.{name}")


def is_number(schema: dict[str, Any]) -> bool:
    """Whether a key holds numbers that are no counts: alone, in lists, or null."""
    kinds = [schema, *schema.get("anyOf", ())]
    kinds += [kind["items"] for kind in kinds if isinstance(kind.get("items"), dict)]
    return any("number" in (kind.get("type") or ()) for kind in kinds)


def bare(name: str) -> str:
    """A name without the prefix that says what of a value it is."""
    prefix, _, rest = name.partition("_")
    return rest if prefix in PREFIXES and rest else name


def violations(command: str) -> list[str]:
    found = []
    for where, name, schema, beside in keys(result_schema(tuple(command.split())), command):
        faults = []
        if name in OF_ROWS:
            continue
        if is_number(schema) and not UNIT.search(bare(name)) and bare(name) not in DIMENSIONLESS:
            faults.append("a number without a unit")
        if re.search(r".(interval95$|_interval95|_u$|(?<!_of)_u_)", name):
            faults.append("what it is of a value is the first part of a name")
        of = bare(name).rpartition("_")[2]
        if bare(name) not in {name, *RELATIVE, *OF_ALL} and not any(
            bare(other) == other and other.endswith(of) for other in beside
        ):
            faults.append(f"there is no value of {of} beside it")
        if name == "simulated" and schema.get("type") != "boolean":
            faults.append("not a boolean")
        found += [f"{where}.{name}: {fault}" for fault in faults]
    return found


@pytest.mark.parametrize("command", CONVERTED)
def test_keys_follow_the_convention(command: str) -> None:
    assert violations(command) == []


QUICK = (
    ("doctor",),
    ("resin refractometer", "resin", "refractometer", "1.49", "--u", "0.001"),
    ("print printers", "print", "printers"),
)
"""Commands that need no file, as they are typed."""


@pytest.mark.parametrize(("command", "arguments"), [(first, rest or (first,)) for first, *rest in QUICK])
def test_what_a_command_prints_is_what_its_schema_says(
    capfd: pytest.CaptureFixture[str], command: str, arguments: tuple[str, ...]
) -> None:
    if command in CONVERTED:
        assert misfits(result_schema(tuple(command.split())), answered(capfd, *arguments)) == []


def misfits(schema: dict[str, Any], value: Any, where: str = "$") -> list[str]:
    """Where a value is not what its JSON Schema says, as far as `solen schema` uses that language."""
    if "anyOf" in schema:
        tried = [misfits(kind, value, where) for kind in schema["anyOf"]]
        return min(tried, key=len) if all(tried) else []
    if "enum" in schema:
        return [] if value in schema["enum"] else [f"{where}: {value!r} is not one of {schema['enum']}"]
    kinds = schema.get("type", [])
    if kinds and not any(_is_a(kind, value) for kind in ([kinds] if isinstance(kinds, str) else kinds)):
        return [f"{where}: {value!r:.60} is not of type {kinds}"]
    found = []
    if isinstance(value, dict) and "properties" in schema:
        unknown = sorted(value.keys() - schema["properties"].keys())
        missing = sorted(set(schema.get("required", ())) - value.keys())
        found += [f"{where}: {name} is not stated" for name in unknown]
        found += [f"{where}: {name} is missing" for name in missing]
        for key in value.keys() & schema["properties"].keys():
            found += misfits(schema["properties"][key], value[key], f"{where}.{key}")
    if (
        isinstance(value, dict)
        and "additionalProperties" in schema
        and isinstance(schema["additionalProperties"], dict)
    ):
        for key, inner in value.items():
            found += misfits(schema["additionalProperties"], inner, f"{where}.{key}")
    if isinstance(value, list) and "items" in schema:
        for place, inner in enumerate(value):
            found += misfits(schema["items"], inner, f"{where}[{place}]")
    return found


_TYPES: dict[str, type | tuple[type, ...]] = {
    "null": type(None),
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "string": str,
    "array": list,
    "object": dict,
}


def _is_a(kind: str, value: Any) -> bool:
    return isinstance(value, _TYPES[kind]) and not (isinstance(value, bool) and kind in {"integer", "number"})
