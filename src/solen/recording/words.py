"""Column headers: name, unit and quantity, in the spellings of instruments (English and German) and people.

``thickness_um``, ``Thickness (µm)``, ``Dicke [µm]`` and ``thickness / µm`` mean the same. Text in brackets or at the
end is interpreted as a unit only if it is a unit that fits the word before it: the ``(R)`` of ``Reflectance (R)`` is a
symbol and the ``_s`` of ``R_s`` a polarisation; neither is a unit. The unit determines the meaning of an ambiguous
word: ``T (°C)`` is a temperature, ``T (%)`` a transmittance.

Public names: `heading`, `quantity_of` and `is_label`.
"""

import re
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

from solen.units import factor, is_unit

_EXAMPLES = {
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
"""The quantities that a header can denote, each with an example of its unit."""

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
    "counts"
)
_TOKENS = frozenset(_UNITS.split())
_ANY_CASE = {"sek", "sec", "deg", "ohm", "ohms", "kohm"}
_PREFIXES = {"": "", "milli": "m", "micro": "µ", "nano": "n", "kilo": "k"}
_IN_WORDS = (
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
_MAX_HEADER_LENGTH = 120  # most letters of a header; longer text is prose
_NO_UNIT = {"a.u.", "a. u.", "arb. units", "arb.", "arb. u.", "au"}
_PURE = {"-", "–", "1", "–-", "frac", "fraction", "ratio"}

_LETTERS = str.maketrans({"μ": "µ", "²": "2", "³": "3", "¹": "1", "⁻": "-"})
_BRACKET = re.compile(r"(.+?)\s*(?:\(([^()]*(?:\([^()]*\))?[^()]*)\)|\[([^\[\]]*)\])")
_SLASH = re.compile(r"(.+?)\s*/\s*(.+)")
_IN = re.compile(r"(.+?)(?:\s+in|,)\s+(\S+)")
_LAST = re.compile(r"(.+?)\s+(\S+)")
_PERCENT = re.compile(r"(.*?)(?:%\s*([TRA])|\b([TRA])\s*%)(?![\w.])((?:\s.*)?)")
_CHANNEL = re.compile(r"(?:axial|ch(?:annel)?\.? ?\d+)\s+(.+)", re.IGNORECASE)  # MTS' names of channels
_PERCENT_OF = re.compile(r"%\s*(\w{2,})")
_DOSED = re.compile(r"(.*?)[\s_]+(\d+(?:[.,]\d+)?)[\s_]*(ms|s|sec|sek|min)\b((?:\s.*)?)")  # T_2s (%), T 2000 ms
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
    """Return the name, unit and quantity in a header text.

    Parameters
    ----------
    text
        The header cell.
    unit
        The cell in the unit row below, if there is one.
    optical
        Whether the axis is a wavelength, for which T, R and A have their optical meaning.
    """
    text = " ".join(text.split())
    if len(text) > _MAX_HEADER_LENGTH:
        return Heading(text, unit, "")
    if unit:
        return _made(text, _unit_text(unit), optical)
    if text in AXES:
        return Heading(AXES[text], text, AXES[text])
    before = _PERCENT_OF.fullmatch(text)
    if before and _meanings(before[1]):
        return _made(before[1], "%", optical)
    dosed = _DOSED.fullmatch(text)
    if optical and dosed and (meant := heading(dosed[1] + dosed[4], optical=True)).quantity in _OPTICAL:
        return Heading(f"{meant.name} {dosed[2]} {dosed[3]}", meant.unit, meant.quantity)
    percent = _PERCENT.fullmatch(text)
    if percent:
        letter = percent[2] or percent[3]
        alone = not (percent[1] + percent[4]).strip()
        return Heading(letter if alone else text, "%", _PERCENTS[letter])
    return _split(text, optical) or _made(text, "", optical)


def quantity_of(name: str, unit: str = "", *, optical: bool = False) -> str:
    """Return the quantity that a name denotes; empty if it denotes none or if its unit is of another kind."""
    meant = [quantity for quantity in _meanings(name) if not unit or _fits(quantity, unit)]
    if optical and not meant:
        meant = [meaning for meaning in _meanings(re.split(r"[\s_-]", name)[-1]) if not unit or _fits(meaning, unit)]
    seen = [one for one in meant if one in _OPTICAL]
    if optical and seen:
        return seen[0]
    return meant[0] if len(meant) == 1 or (meant and unit) else ""


def is_label(text: str) -> bool:
    """Whether a column labels its rows: replicate, sample, orientation."""
    return plain(text) in _label_words() or plain(heading(text).name) in _label_words()


def plain(name: str) -> str:
    """Return a name without spelling differences: case, underscores and spaces."""
    return " ".join(name.replace("_", " ").casefold().split())


def stated_unit(text: str) -> bool:
    """Whether a text is a unit used in measurements; pint alone would accept ``R`` and ``a.u.`` as units."""
    text = text.strip()
    if len(text) > _MAX_HEADER_LENGTH:
        return False
    if text == "nm.":  # PerkinElmer's abbreviation
        return True
    tokens = re.findall(r"[^\W\d_]+|[°%]\w*", text.translate(_LETTERS))
    known = bool(tokens) and all(token in _TOKENS or token.lower() in _ANY_CASE for token in tokens)
    return text in _PURE or (known and (is_unit(text) or "dB" in text or "°C" in text or text == "counts"))


def is_mode(text: str) -> bool:
    """Whether a text is a spectrophotometer mode such as ``%T``, which is both a unit and a name."""
    match = _PERCENT.fullmatch(text.strip())
    return match is not None and not match[4]


def _split(text: str, optical: bool) -> Heading | None:
    """Return the heading for a text that contains a unit; otherwise None."""
    bracket = _BRACKET.fullmatch(text)
    if bracket:
        name, inner = bracket[1], bracket[2] if bracket[2] is not None else bracket[3]
        if inner.strip().lower() in _NO_UNIT:
            return _made(name, "" if optical or _OPTICAL & {*_meanings(name)} else "a.u.", optical)
        if inner.strip() == "" or _is_unit_of(name, inner, bracketed=True):
            return _made(name, _unit_text(inner), optical)
        return _made(name, "", optical) if _meanings(name) else None
    for form in (_SLASH, _IN, _LAST):
        match = form.fullmatch(text)
        volts = form is _SLASH and match is not None and match[2] == "V"  # U_L/V is a quotient, sample/A a name
        if match and _is_unit_of(match[1], match[2].strip("()"), bracketed=volts):
            return _made(match[1], _unit_text(match[2].strip("()")), optical)
    return _suffixed(text, optical)


def _suffixed(text: str, optical: bool) -> Heading | None:
    """Return the heading for a name that ends in a unit, such as ``dose_mJ_per_cm2``."""
    parts = text.split("_")
    for start in range(1, len(parts)):
        name, unit = "_".join(parts[:start]), _unit_of_parts(parts[start:])
        if name and unit and _is_unit_of(name, unit):
            return _made(name, unit, optical)
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
    """Whether a text is a unit and, if the quantity is known, a suitable unit for it.

    Brackets after a single letter always contain its unit: the ``b`` of ``b (V)`` is not a width.
    """
    unit = unit.strip()
    if not stated_unit(unit):
        return False
    meant = _meanings(name)
    fits = any(_fits(one, _unit_text(unit)) for one in meant)
    if fits or (meant and (len(name) > 1 or not bracketed)):
        return fits
    letter = len(unit) == 1 and unit.isalpha()
    return unit not in _PURE and (not letter or (bracketed and unit != "A"))  # these are labels: sample A, film 1


def _fits(quantity: str, unit: str) -> bool:
    if "dB" in unit:
        return quantity == "power"
    if "°C" in unit:
        return quantity == "temperature"
    return factor(unit, _EXAMPLES[quantity]) is not None


def _unit_text(unit: str) -> str:
    unit = unit.strip().strip("[]()").strip()
    return "1" if unit in _PURE or unit == "" else _IN_WORDS.get(unit.casefold(), unit)


def _made(name: str, unit: str, optical: bool) -> Heading:
    quantity = quantity_of(name, unit, optical=optical)
    return Heading(name, unit, quantity or (_PERCENTS.get(unit[1:], "") if unit.startswith("%") else ""))


@cache
def _by_word() -> dict[str, list[str]]:
    rows: dict[str, list[str]] = {}
    for quantity, words in _WORDS.items():
        for word in words.split(", "):
            rows.setdefault(plain(word), []).append(quantity)
    return rows


@cache
def _label_words() -> frozenset[str]:
    return frozenset(plain(word) for word in _LABELS.split(", "))


def _meanings(name: str) -> list[str]:
    """Return the quantities that a name can denote; the case of a single letter matters, as T and t differ."""
    if name in {"T", "R", "A"}:
        return {"T": ["transmittance", "temperature"], "R": ["reflectance", "resistance"], "A": []}[name]
    if name == "t":
        return ["time", "thickness"]
    channel = _CHANNEL.fullmatch(name)
    return _by_word().get(plain(channel[1] if channel else name), [])
