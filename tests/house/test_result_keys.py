"""The keys in the JSON output of every command follow the naming convention in docs/conventions.md."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from solen.cli.design.schema import commands, result_schema, result_type

_UNITS = """
V mV uV A mA uA nA W mW uW J mJ ohm kohm kPa MPa N Nmm g kg mL K C mm mm2 mm3 cm cm2 um um2 um4 nm px deg mrad s ms us
min h hz
Hz kHz percent ppm dB dBm MB bytes rows layers samples cycle slot
"""
UNITS = tuple(_UNITS.split())
_ANY_UNIT = "|".join(UNITS)
UNIT = re.compile(rf"(?:^|_)(?:(?:{_ANY_UNIT})_)?per_(?:{_ANY_UNIT})$|(?:^|_)(?:{_ANY_UNIT})$")
PREFIXES = ("u", "interval95", "sd")
_OPTICS = "n n_D k B abbe T R A common_n random_n substrate_n index_estimate bend scale"
_STATISTICS = """
F p t r_squared chi2 chi2_reduced aicc delta_aicc rms rms_relative lag_one degrees_of_freedom start_degrees_of_freedom
p_curved p_orientation effective_points parameters residual neighbours widened weighted_squares correlation covariance
covariance_ln sigma
chance probability ln_likelihood_ratio p_form independent_values ratio snr clearness
"""
_SHARES = """
strain strain_largest peak_strain residual_strain strain_at_break strain_at_strength loss_fraction peak_stress
stress_at_half work_in
shift end low high length area overcure scatter_exponent halo_fraction halo_per_depth ln_Ec dose_below_over_Ec
interior_over_single_layer interior_over_jacobs phr volume_error bridged outside share on_share between_share depth
seen contrast apart visibility pitch_ratio factor load_factor scale_factor size_factor rms_um_per_percent_of_scale
ambiguous within_68 within_95 scatter unseparated
"""
_CONTRASTS, _IN_THE_FILES_UNIT = "largest largest_change effect at_low at_high", "dark"
_OF_LIGHT = """
light power power_by_source detected escaped absorbed truncated missed leaked reflected beside above_below right left
emitted error single_error design_index outside_index na_object na_image magnification edge_slope ledger_error
received_share received used_of_supply contrast contrast_from
contrast_to rigid_contrast index material_index step response exponent gain nonlinearity off_contrast off_received
"""
_SEARCHED = "low high before after goal goals claimed sampled_difference merits worst"
_PRINTS = """adjusted_share calibrated_share share_if_exact factor_alone factor_together deviation base first_order
total held_out"""
_NAMES = (_OPTICS, _STATISTICS, _SHARES, _CONTRASTS, _IN_THE_FILES_UNIT, _OF_LIGHT, _PRINTS, _SEARCHED)
DIMENSIONLESS = frozenset(" ".join(_NAMES).split())
"""Names of numbers without a unit: indices, fractions, contrasts, probabilities, factors."""
SHARED = {"power", "slope_mrad"}
"""Values whose uncertainty applies to several keys: powers at all receivers, slopes along a profile."""
RELATIVE = {"ln_Ec", "length", "area"}
"""Values whose uncertainty is relative, or that of their logarithm."""
UNITS_IN_ROW = {
    *("value", "tolerance", "u", "u_before", "u_value", "design_value", "u_prior"),
    *("paper_value", "u_paper_value", "solen_value", "u_solen_value"),
    *("mean", "sd", "u_reading", "mean_ambient", "sd_ambient", "sd_slot"),
}
"""Numbers in tables of parameters or channels, whose unit is in the same row."""
ECHOED = {"options", "settings", "design", "file"}
"""Options, and contents of a design or datasheet, with the names that they have there."""
WITH_RESULT = [name for name, place in commands().items() if result_type(place) is not None]

Key = tuple[str, str, dict[str, Any], Mapping[str, Any]]


def keys(schema: dict[str, Any], where: str) -> Iterator[Key]:
    """Yield the location, name, schema and siblings of every key of a schema."""
    for alternative in schema.get("anyOf", ()):
        yield from keys(alternative, where)
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
    """Whether the value of a key is a number that is not an integer, a list of these, or null."""
    kinds = [schema, *schema.get("anyOf", ())]
    kinds += [kind["items"] for kind in kinds if isinstance(kind.get("items"), dict)]
    return any("number" in (kind.get("type") or ()) for kind in kinds)


def without_prefix(name: str) -> str:
    """A name without its prefix for an uncertainty, interval or standard deviation."""
    prefix, _, rest = name.partition("_")
    return rest if prefix in PREFIXES and rest else name


def violations(command: str) -> list[str]:
    lines = []
    for where, name, schema, siblings in keys(result_schema(tuple(command.split())), command):
        faults = []
        if name in UNITS_IN_ROW:
            continue
        if is_number(schema) and not UNIT.search(without_prefix(name)) and without_prefix(name) not in DIMENSIONLESS:
            faults.append("number without a unit")
        if re.search(r".(interval95$|_interval95|_u$|(?<!_of)_u_)", name):
            faults.append("u and interval95 must be prefixes")
        quantity = without_prefix(name).rpartition("_")[2]
        if without_prefix(name) not in {name, *RELATIVE, *SHARED} and not any(
            without_prefix(other) == other and other.endswith(quantity) for other in siblings
        ):
            faults.append(f"there is no value of {quantity} in the same object")
        if name == "simulated" and schema.get("type") != "boolean":
            faults.append("not a boolean")
        lines += [f"{where}.{name}: {fault}" for fault in faults]
    return lines


@pytest.mark.parametrize("command", WITH_RESULT)
def test_every_key_has_a_description(command: str) -> None:
    """Objects and keys have descriptions, which do not only refer to another page."""
    schema = result_schema(tuple(command.split()))
    described = list(objects(schema))
    assert [where for where, inner in described if "description" not in inner and inner is not schema] == []
    texts = [(where, inner["description"]) for where, _, inner, _ in keys(schema, command) if "description" in inner]
    assert [(where, text) for where, text in texts if re.match(r"As in|See\b", text)] == []


def objects(schema: Any, where: str = "$") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the location and schema of objects with defined keys, at any depth."""
    if isinstance(schema, list):
        for index, part in enumerate(schema):
            yield from objects(part, f"{where}[{index}]")
    if isinstance(schema, dict):
        if "properties" in schema and not where.endswith(".if"):
            yield where, schema
        for name, part in schema.items():
            yield from objects(part, f"{where}.{name}")


@pytest.mark.parametrize("command", WITH_RESULT)
def test_keys_follow_convention(command: str) -> None:
    assert violations(command) == []
