"""One convention for the keys of results, over the JSON of every command: docs/conventions.md states it."""

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
_ONE = "|".join(UNITS)
UNIT = re.compile(rf"(?:^|_)(?:(?:{_ONE})_)?per_(?:{_ONE})$|(?:^|_)(?:{_ONE})$")
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
"""Names of numbers without a unit: indices, shares from 0 to 1, contrasts, probabilities, factors."""
OF_ALL = {"power", "slope_mrad"}
"""Values that several names beside an uncertainty hold: powers at all receivers, slopes all along a profile."""
RELATIVE = {"ln_Ec", "length", "area"}
"""Values whose uncertainty is stated relative to them, or of their logarithm."""
OF_ROWS = {
    *("value", "tolerance", "u", "u_before", "u_value", "design_value", "u_prior"),
    *("paper_value", "u_paper_value", "solen_value", "u_solen_value"),
    *("mean", "sd", "u_reading", "mean_ambient", "sd_ambient", "sd_slot"),
}
"""Numbers of tables over parameters or channels of any unit, whose row says which."""
ECHOED = {"options", "settings", "design", "file"}
"""What was asked for and the design or datasheet of a file, by the names that options and files have."""
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
def test_every_key_is_described_where_it_is_read(command: str) -> None:
    """By itself or by the object that holds it, and without sending the reader to another page."""
    schema = result_schema(tuple(command.split()))
    described = list(objects(schema))
    assert [where for where, inner in described if "description" not in inner and inner is not schema] == []
    words = [(where, inner["description"]) for where, _, inner, _ in keys(schema, command) if "description" in inner]
    assert [(where, text) for where, text in words if re.match(r"As in|See\b", text)] == []


def objects(schema: Any, where: str = "$") -> Iterator[tuple[str, dict[str, Any]]]:
    """Schemas of objects with stated keys, at any depth."""
    if isinstance(schema, list):
        for place, part in enumerate(schema):
            yield from objects(part, f"{where}[{place}]")
    if isinstance(schema, dict):
        if "properties" in schema and not where.endswith(".if"):
            yield where, schema
        for name, part in schema.items():
            yield from objects(part, f"{where}.{name}")


@pytest.mark.parametrize("command", CONVERTED)
def test_keys_follow_the_convention(command: str) -> None:
    assert violations(command) == []
