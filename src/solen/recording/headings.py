"""Column headers: name, unit and quantity, in spellings of instruments and people (English and German).

``thickness_um``, ``Thickness (µm)``, ``Dicke [µm]`` and ``thickness / µm`` mean the same. Text in brackets or at the
end is a unit only if it can be one and fits the word before it: the ``(R)`` of ``Reflectance (R)`` is a symbol, and the
``_s`` of ``R_s`` a polarisation. The unit determines the meaning of an ambiguous word: ``T (°C)`` is a temperature, ``T
(%)`` a transmittance.

Public names: `heading`, `quantity_of` and `is_label`.
"""

import re
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

from solen.units import factor, is_unit

_UNIT_OF = {
    "wavelength": "nm",
    "transmittance": "1",
    "reflectance": "1",
    "absorbance": "1",
    "absorptance": "1",
    "index": "1",
    "thickness": "mm",
    "length": "mm",
    "width": "mm",
    "displacement": "mm",
    "crosshead": "mm",
    "time": "s",
    "force": "N",
    "stress": "MPa",
    "true stress": "MPa",
    "modulus": "MPa",
    "strain": "1",
    "true strain": "1",
    "stretch": "1",
    "exposure": "mJ/cm**2",
    "energy": "J",
    "irradiance": "mW/cm**2",
    "power": "mW",
    "voltage": "V",
    "current": "mA",
    "resistance": "ohm",
    "temperature": "K",
    "angle": "deg",
    "speed": "mm/s",
    "wavenumber": "1/cm",
}
"""The quantities that a header can denote, each with one of its units."""

_WORDS = {
    "wavelength": "wavelength, wavelengths, wave, wellenlänge, wellenlaenge, wave length, lambda, λ, wl",
    "transmittance": "transmittance, transmission, trans., transmissionsgrad, t",
    "reflectance": "reflectance, reflection, refl., reflexion, reflexionsgrad, r",
    "absorbance": "absorbance, abs, abs., extinction, extinktion, optical density, od",
    "absorptance": "absorptance, absorptionsgrad",
    "index": "refractive index, index of refraction, brechzahl, brechungsindex",
    "thickness": "thickness, cure depth, cured depth, curing depth, depth, dicke, schichtdicke, aushärtetiefe, "
    "durchhärtetiefe, tiefe, cd, dc, h, d",
    "length": "length, guide length, waveguide length, länge, laenge, l",
    "width": "width, breite, b, w",
    "displacement": "displacement, extension, deflection, travel, weg, verformung, verschiebung, standardweg, "
    "standard travel, grip to grip separation, deformation, elongation, extension from preload, dl, δl, u",
    "crosshead": "crosshead, traverse, traverse abs., traverse abs, traversenweg, traversenweg absolut, "
    "crosshead absolute, crosshead travel, absolute crosshead travel, crosshead displacement, stroke, "
    "machine extension",
    "time": "time, test time, running time, exposure time, exposure, cure time, zeit, prüfzeit, pruefzeit, "
    "belichtungszeit, t",
    "force": "force, load, standard force, kraft, prüfkraft, standardkraft, last, f",
    "stress": "stress, engineering stress, nominal stress, eng stress, spannung, zugspannung, druckspannung, "
    "first piola-kirchhoff stress, σ, sigma",
    "true stress": "true stress, cauchy stress, wahre spannung",
    "modulus": "modulus, young's modulus, e-modul, e",
    "strain": "strain, engineering strain, nominal strain, eng strain, tensile strain, compressive strain, elongation, "
    "dehnung, stauchung, nominelle dehnung, ε, epsilon",
    "true strain": "true strain, logarithmic strain, hencky strain, wahre dehnung",
    "stretch": "stretch, stretch ratio, verstreckung, streckung, λ, lambda",
    "exposure": "exposure, exposure dose, dose, energy dose, energy, e, dosis, belichtung, energie, fluence",
    "energy": "energy, energie, work, arbeit, e",
    "irradiance": "irradiance, intensity, bestrahlungsstärke, intensität, i",
    "power": "power, received power, optical power, signal, leistung, p",
    "voltage": "voltage, signal, spannung, v, u",
    "current": "current, photocurrent, strom, i",
    "resistance": "resistance, widerstand, r",
    "temperature": "temperature, temperatur, t",
    "angle": "angle, winkel, theta, θ",
    "speed": "speed, geschwindigkeit, prüfgeschwindigkeit, test speed",
    "wavenumber": "wavenumber, wellenzahl",
}
_LABELS = (
    "replicate, repeat, nr, nr., no, no., wiederholung, sample, probe, specimen, prüfling, name, label, id, guide, "
    "piece, part, print, disc, disk, orientation, build orientation, ausrichtung, orientierung, bauorientierung, "
    "batch, charge, note, comment, kommentar, bemerkung, material, resin, harz, group, gruppe, position, operator, "
    "date, datum, file, datei, kind, type, mode"
)
_UNITS = (
    "nm um µm mm cm m km Å s sec sek ms us µs ns min h hr std N mN uN µN kN gf kgf lbf Pa kPa MPa GPa W mW uW µW nW kW "
    "J mJ uJ µJ kJ V mV uV µV A mA uA µA nA Ohm ohm Ω kΩ MΩ kOhm Hz kHz MHz deg degree degrees mdeg rad mrad "
    "arcmin arcsec K degC °C ° g mg kg dB dBm % %T %R percent pct prozent micron microns µ mol L l ml pF nF fF lux lx "
    "counts angstrom"
)
_UNIT_WORDS = frozenset(_UNITS.split())
_ANY_CASE = {"sek", "sec", "deg", "ohm", "ohms", "kohm"}
_PREFIXES = {"": "", "milli": "m", "micro": "µ", "nano": "n", "kilo": "k"}
_UNITS_IN_WORDS = (
    {
        f"{before}{word}{plural}": f"{sign}{symbol}"
        for word, symbol in {"volt": "V", "amp": "A", "ampere": "A", "ohm": "ohm", "second": "s", "newton": "N"}.items()
        for before, sign in _PREFIXES.items()
        for plural in ("", "s")
    }
    | dict.fromkeys(("degree", "degrees", "angle (deg)"), "deg")
    | dict.fromkeys(("radian", "radians"), "rad")
    | {"nm.": "nm"}
)
"""Units written in words by LabVIEW."""
_MAX_HEADER_LENGTH = 120  # maximum number of characters of a header; longer text is prose
_NO_UNIT = {"a.u.", "a. u.", "arb. units", "arb.", "arb. u.", "au"}
_DIMENSIONLESS = {"-", "–", "1", "–-", "frac", "fraction", "ratio"}

_EQUIVALENTS = str.maketrans({"μ": "µ", "²": "2", "³": "3", "¹": "1", "⁻": "-"})
_BRACKET = re.compile(r"(.+?)\s*(?:\(([^()]*(?:\([^()]*\))?[^()]*)\)|\[([^\[\]]*)\])")
_SLASH = re.compile(r"(.+?)\s*/\s*(.+)")
_IN = re.compile(r"(.+?)(?:\s+in|,)\s+(\S+)")
_LAST = re.compile(r"(.+?)\s+(\S+)")
_PERCENT = re.compile(r"(.*?)(?:%\s*([TRA])|\b([TRA])\s*%)(?![\w.])((?:\s.*)?)")
_CHANNEL = re.compile(r"(?:axial|ch(?:annel)?\.? ?\d+)\s+(.+)", re.IGNORECASE)  # channel names of MTS
_PERCENT_OF = re.compile(r"%\s*(\w{2,})")
_EXPOSURE = re.compile(r"(.*?)[\s_]+(\d+(?:[.,]\d+)?)[\s_]*(ms|s|sec|sek|min)\b((?:\s.*)?)")  # T_2s (%), T 2000 ms
_OPTICAL = {"transmittance", "reflectance", "absorbance", "absorptance"}
AXES = {"nm": "wavelength", "cm-1": "wavenumber", "1/cm": "wavenumber", "cm^-1": "wavenumber"}
"""Headers that consist only of the unit of a spectral axis."""
_PERCENTS = {"T": "transmittance", "R": "reflectance", "A": "absorptance"}


@dataclass(frozen=True)
class Heading:
    """Content of a header; unit and quantity are empty if the header gives none."""

    name: str
    unit: str
    quantity: str


def heading(text: str, unit: str = "", *, optical: bool = False) -> Heading:
    """Return the name, unit and quantity in a header.

    Parameters
    ----------
    text
        The header cell.
    unit
        The cell in the unit row below, if there is one.
    optical
        Whether the axis is a wavelength, so that T, R and A have their optical meaning.
    """
    text = " ".join(text.split())
    if len(text) > _MAX_HEADER_LENGTH:
        return Heading(text, unit, "")
    if unit:
        return _heading_of(text, _unit_text(unit), optical)
    if text in AXES:
        return Heading(AXES[text], text, AXES[text])
    before = _PERCENT_OF.fullmatch(text)
    if before and _meanings(before[1]):
        return _heading_of(before[1], "%", optical)
    exposure = _EXPOSURE.fullmatch(text)
    if optical and exposure and (inner := heading(exposure[1] + exposure[4], optical=True)).quantity in _OPTICAL:
        return Heading(f"{inner.name} {exposure[2]} {exposure[3]}", inner.unit, inner.quantity)
    percent = _PERCENT.fullmatch(text)
    if percent:
        letter = percent[2] or percent[3]
        only_letter = not (percent[1] + percent[4]).strip()
        return Heading(letter if only_letter else text, "%", _PERCENTS[letter])
    return _split(text, optical) or _heading_of(text, "", optical)


def quantity_of(name: str, unit: str = "", *, optical: bool = False) -> str:
    """Return the quantity that a name denotes; empty if it denotes none, or none with this unit."""
    quantities = [quantity for quantity in _meanings(name) if not unit or _fits(quantity, unit)]
    if optical and not quantities:
        quantities = [
            meaning for meaning in _meanings(re.split(r"[\s_-]", name)[-1]) if not unit or _fits(meaning, unit)
        ]
    optical_ones = [quantity for quantity in quantities if quantity in _OPTICAL]
    if optical and optical_ones:
        return optical_ones[0]
    return quantities[0] if len(quantities) == 1 or (quantities and unit) else ""


def is_label(text: str) -> bool:
    """Return whether a column labels its rows: replicate, sample, orientation."""
    return plain(text) in _label_words() or plain(heading(text).name) in _label_words()


def plain(name: str) -> str:
    """Return a name in lower case, with single spaces in place of underscores and spaces."""
    return " ".join(name.replace("_", " ").casefold().split())


def is_measurement_unit(text: str) -> bool:
    """Return whether a string is a unit used in measurements; pint alone would accept ``R`` and ``a.u.`` as units."""
    text = text.strip()
    if len(text) > _MAX_HEADER_LENGTH:
        return False
    if text == "nm.":  # PerkinElmer's abbreviation
        return True
    tokens = re.findall(r"[^\W\d_]+|[°%]\w*", text.translate(_EQUIVALENTS))
    known = bool(tokens) and all(token in _UNIT_WORDS or token.lower() in _ANY_CASE for token in tokens)
    return text in _DIMENSIONLESS or (known and (is_unit(text) or "dB" in text or "°C" in text or text == "counts"))


def is_mode(text: str) -> bool:
    """Return whether a string is a spectrophotometer mode such as ``%T``, which is both a unit and a name."""
    match = _PERCENT.fullmatch(text.strip())
    return match is not None and not match[4]


def _split(text: str, optical: bool) -> Heading | None:
    """Return the heading of a header that contains a unit; otherwise None."""
    bracket = _BRACKET.fullmatch(text)
    if bracket:
        name, inner = bracket[1], bracket[2] if bracket[2] is not None else bracket[3]
        if inner.strip().lower() in _NO_UNIT:
            return _heading_of(name, "" if optical or _OPTICAL & {*_meanings(name)} else "a.u.", optical)
        if inner.strip() == "" or _is_unit_of(name, inner, bracketed=True):
            return _heading_of(name, _unit_text(inner), optical)
        return _heading_of(name, "", optical) if _meanings(name) else None
    for form in (_SLASH, _IN, _LAST):
        match = form.fullmatch(text)
        in_volts = form is _SLASH and match is not None and match[2] == "V"  # U_L/V is a quotient, sample/A a name
        if match and _is_unit_of(match[1], match[2].strip("()"), bracketed=in_volts):
            return _heading_of(match[1], _unit_text(match[2].strip("()")), optical)
    return _suffixed(text, optical)


def _suffixed(text: str, optical: bool) -> Heading | None:
    """Return the heading of a name that ends in a unit, such as ``dose_mJ_per_cm2``; otherwise None."""
    parts = text.split("_")
    for start in range(1, len(parts)):
        name, unit = "_".join(parts[:start]), _unit_of_parts(parts[start:])
        if name and unit and _is_unit_of(name, unit):
            return _heading_of(name, unit, optical)
    return None


def _unit_of_parts(parts: list[str]) -> str:
    """Return the unit spelled by parts of a name: ``mJ per cm2``, ``per mm``, or the common ``mJ cm2``."""
    words = ["/" if part == "per" else part for part in parts]
    if words[0] == "/":
        words.insert(0, "1")
    if len(words) == 2 and words[1] in {"cm2", "mm2", "m2"}:
        words.insert(1, "/")
    return "".join(words) if all("/" in pair for pair in pairwise(words)) else ""


def _is_unit_of(name: str, unit: str, *, bracketed: bool = False) -> bool:
    """Return whether a string is a unit and, if the quantity is known, fits it.

    Brackets after a single letter always contain its unit: the ``b`` of ``b (V)`` is not a width.
    """
    unit = unit.strip()
    if not is_measurement_unit(unit):
        return False
    quantities = _meanings(name)
    fits = any(_fits(quantity, _unit_text(unit)) for quantity in quantities)
    if fits or (quantities and (len(name) > 1 or not bracketed)):
        return fits
    letter = len(unit) == 1 and unit.isalpha()
    return unit not in _DIMENSIONLESS and (not letter or (bracketed and unit != "A"))  # sample A and film 1 are labels


def _fits(quantity: str, unit: str) -> bool:
    if "dB" in unit:
        return quantity == "power"
    if "°C" in unit:
        return quantity == "temperature"
    return factor(unit, _UNIT_OF[quantity]) is not None


def _unit_text(unit: str) -> str:
    unit = unit.strip().strip("[]()").strip()
    return "1" if unit in _DIMENSIONLESS or unit == "" else _UNITS_IN_WORDS.get(unit.casefold(), unit)


def _heading_of(name: str, unit: str, optical: bool) -> Heading:
    quantity = quantity_of(name, unit, optical=optical)
    return Heading(name, unit, quantity or (_PERCENTS.get(unit[1:], "") if unit.startswith("%") else ""))


@cache
def _quantities_of_words() -> dict[str, list[str]]:
    rows: dict[str, list[str]] = {}
    for quantity, words in _WORDS.items():
        for word in words.split(", "):
            rows.setdefault(plain(word), []).append(quantity)
    return rows


@cache
def _label_words() -> frozenset[str]:
    return frozenset(plain(word) for word in _LABELS.split(", "))


def _meanings(name: str) -> list[str]:
    """Return the quantities that a name can denote; single letters are case-sensitive, because T and t differ."""
    if name in {"T", "R", "A"}:
        return {"T": ["transmittance", "temperature"], "R": ["reflectance", "resistance"], "A": []}[name]
    if name == "t":
        return ["time", "thickness"]
    channel = _CHANNEL.fullmatch(name)
    return _quantities_of_words().get(plain(channel[1] if channel else name), [])
