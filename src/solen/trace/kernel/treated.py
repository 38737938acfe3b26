"""Surfaces that are not smooth, clean and bare: mirrors, ideal elements, films, tables, gratings, scatter.

`at_treated` replaces `solen.trace.kernel.surface.at_surface` at a treated interface. Random numbers depend on the ray
number, the number of previous hits and the index of the draw.
"""

import cmath
import math
from typing import NamedTuple

from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.rows import (
    BY_TABLE,
    GAUSSIAN,
    GRATING,
    HARVEY_SHACK,
    LENS,
    MIRROR,
    REFRACTING,
    SMOOTH,
    SPLITTER,
    TREATED,
    Precision,
    Treatment,
    treatment_row,
    typed,
)
from solen.trace.kernel.surface import BRANCHES, COUNT, Event, Incidence, SplitRay, at_surface, uniform_of
from solen.trace.tables import Tables

FREE_PATH, PHASE, ORDER, FACET, TRANSMITTED, REFLECTED = 1, 2, 3, 1 << 10, 1 << 11, 1 << 12
"""First draw index for each purpose."""
TRIES = 256
"""Maximum number of rejected draws before the smooth direction is used instead."""
REJECTION = 2 * TRIES + 1
"""Offset of the draws that decide on rejection, relative to the first draw index."""
OPAQUE = 300.0
"""Imaginary phase of a film above which no representable amplitude is transmitted."""


class Amplitudes(NamedTuple):
    """Reflected and transmitted power fractions in s and p, and complex factors for the correlation s p*."""

    back_s: float
    back_p: float
    back_cr: float
    back_ci: float
    on_s: float
    on_p: float
    on_cr: float
    on_ci: float


@compiled
def acting(tables: Tables, c: int, colour: int) -> int:
    """Behaviour of a treated interface at a wavelength; −1 outside its band, where it is bare and refracting."""
    t = treatment_row(tables.treatments, tables.treatment[c])
    nm = tables.wavelength[colour]
    in_band = t.band_low <= nm <= t.band_high
    acts = in_band == (t.band_within > 0.0) or t.band_low == -math.inf
    return int(tables.behaviour[c] - TREATED) if acts else -1


@called
def at_treated(  # noqa: C901  one case for each kind of surface
    k: Precision, tables: Tables, splitting: int, c: int, colour: int, event: Event, ray: Incidence
) -> SplitRay:
    """Return both parts of a ray at curve ``c``; the remaining power is absorbed."""
    x, z, dx, dz, nx, nz, n1, n2, s, p = ray
    t, behaviour = treatment_row(tables.treatments, tables.treatment[c]), acting(tables, c, colour)
    if behaviour < 0:
        return at_surface(k, REFRACTING, splitting, ray)
    from_right = dx * nx + dz * nz > 0.0
    if from_right:
        nx, nz = -nx, -nz
    if behaviour == GRATING:
        return at_grating(k, tables, t, splitting, colour, event, Incidence(x, z, dx, dz, nx, nz, n1, n2, s, p))
    fx, fz = nx, nz
    if t.tilt > 0.0 and t.across == 0.0:
        fx, fz = facet(event, t.tilt, dx, dz, nx, nz, n1, n2)
    as_mirror = MIRROR if behaviour == MIRROR else REFRACTING
    split = COUNT if splitting == COUNT or t.partial == 0.0 else BRANCHES
    fx, fz = typed(k.zero, fx), typed(k.zero, fz)
    tx, tz, bx, bz, on_s, on_p, back_s, back_p = at_surface(
        k, as_mirror, split, Incidence(x, z, dx, dz, fx, fz, n1, n2, s, p)
    )
    if behaviour == SPLITTER:
        tx, tz, on_s, on_p = dx, dz, t.transmitted * s, t.transmitted * p
        back_s, back_p = s - on_s, p - on_p
        if splitting == COUNT:
            on_s, on_p, back_s, back_p = s, p, k.zero, k.zero
    elif behaviour == MIRROR and splitting != COUNT:
        back_s, back_p = t.reflectance * s, t.reflectance * p
    if t.focal != 0.0:
        ex, ez = focused(tables.middle[c, 0], tables.middle[c, 1], t.focal, x, z, dx, dz, nx, nz)
        if behaviour == LENS:
            tx, tz, on_s, on_p, back_s, back_p = typed(k.zero, ex), typed(k.zero, ez), s, p, k.zero, k.zero
        else:
            cos = ex * nx + ez * nz
            bx, bz = typed(k.zero, ex - (cos + cos) * nx), typed(k.zero, ez - (cos + cos) * nz)
    if t.layers > 0.0 and splitting == COUNT and is_opaque(tables, t, colour, dx * fx + dz * fz, n1):
        on_s, on_p, back_s, back_p = k.zero, k.zero, s, p
    if (t.layers > 0.0 or t.rows > 0.0) and splitting != COUNT:
        cos_in, no_transmission = -(dx * fx + dz * fz), tx == k.zero and tz == k.zero
        fractions = (
            film(tables, t, colour, from_right, cos_in, n1, n2)
            if t.layers > 0.0
            else tabulated(tables, t, from_right, cos_in, no_transmission)
        )
        on_s, on_p = typed(k.zero, fractions.on_s * s), typed(k.zero, fractions.on_p * p)
        back_s, back_p = typed(k.zero, fractions.back_s * s), typed(k.zero, fractions.back_p * p)
    if t.scatter != SMOOTH:
        ex, ez = scattered(tables, t, event, TRANSMITTED, tx, tz, -nx, -nz)
        tx, tz = typed(k.zero, ex), typed(k.zero, ez)
        ex, ez = scattered(tables, t, event, REFLECTED, bx, bz, nx, nz)
        bx, bz = typed(k.zero, ex), typed(k.zero, ez)
    return SplitRay(tx, tz, bx, bz, on_s, on_p, back_s, back_p)


@compiled
def at_grating(
    k: Precision, tables: Tables, t: Treatment, splitting: int, colour: int, event: Event, ray: Incidence
) -> SplitRay:
    """As `at_treated`, at a grating with its normal on the side of the ray: one random order carries all power.

    The probability of an order is proportional to its diffraction efficiency. Positive orders are deflected to the
    right.
    """
    _, _, dx, dz, nx, nz, n1, n2, s, p = ray
    exit_index = n1 if t.lines < 0.0 else n2
    sine, step = (dz * nx - dx * nz) * n1 / exit_index, abs(t.lines) * tables.wavelength[colour] / exit_index
    total = 0.0
    for i in range(int(t.rows)):
        row = tables.layers[int(t.first_row) + i]
        total += row[1] if abs(sine + row[0] * step) < 1.0 else 0.0
    remaining, chosen = uniform_of(event, ORDER) * total, 0.0
    for i in range(int(t.rows)):
        row = tables.layers[int(t.first_row) + i]
        if remaining >= 0.0 and row[1] > 0.0 and abs(sine + row[0] * step) < 1.0:
            remaining, chosen = remaining - row[1], sine + row[0] * step
    if splitting == COUNT and total > 0.0:
        total = 1.0
    cos = math.sqrt((1.0 - chosen) * (1.0 + chosen))
    ax, az = typed(k.zero, -chosen * nz), typed(k.zero, chosen * nx)
    outx, outz = typed(k.zero, cos * nx), typed(k.zero, cos * nz)
    s, p = typed(k.zero, total * s), typed(k.zero, total * p)
    if t.lines < 0.0:
        return SplitRay(k.zero, k.zero, ax + outx, az + outz, k.zero, k.zero, s, p)
    return SplitRay(ax - outx, az - outz, k.zero, k.zero, s, p, k.zero, k.zero)


@compiled
def focused(
    mx: float, mz: float, focal: float, x: float, z: float, dx: float, dz: float, nx: float, nz: float
) -> tuple[float, float]:
    """Direction behind an ideal thin lens at (mx, mz): the slope to the axis decreases by the height divided by f."""
    along, height = dx * -nz + dz * nx, (x - mx) * -nz + (z - mz) * nx
    onwards = -(dx * nx + dz * nz)
    slope = along / onwards - height / focal
    scale = 1.0 / math.sqrt(1.0 + slope * slope)
    return scale * (slope * -nz - nx), scale * (slope * nx - nz)


@compiled
def facet(
    event: Event, tilt: float, dx: float, dz: float, nx: float, nz: float, n1: float, n2: float
) -> tuple[float, float]:
    """Normal of the ripple facet that a ray meets, on the side of the ray.

    Facets are sampled in proportion to their projected size. Facets that would direct light through the surface again,
    or that the ray cannot reach, are rejected.
    """
    cos_in, sine = -(dx * nx + dz * nz), dx * -nz + dz * nx
    steepest = 1.0 + tilt * abs(sine) / cos_in
    for i in range(TRIES):
        slope = tilt * math.cos(2.0 * math.pi * uniform_of(event, FACET + 2 * i))
        projected = 1.0 - slope * sine / cos_in
        if uniform_of(event, FACET + 2 * i + 1) * steepest > projected:
            continue
        scale = 1.0 / math.sqrt(1.0 + slope * slope)
        fx, fz = scale * (nx + slope * -nz), scale * (nz + slope * nx)
        cos = -(dx * fx + dz * fz)
        if not cos > 0.0:
            continue
        back = -cos_in + 2.0 * cos * (fx * nx + fz * nz)
        cos2 = n2 * n2 - n1 * n1 * (1.0 - cos * cos)
        onwards = -1.0
        if cos2 > 0.0:
            bend = n1 * cos - math.sqrt(cos2)
            onwards = -n1 * cos_in + bend * (fx * nx + fz * nz)
        if back > 0.0 and onwards < 0.0:
            return fx, fz
    return nx, nz


@compiled
def scattered(
    tables: Tables, t: Treatment, event: Event, purpose: int, dx: float, dz: float, nx: float, nz: float
) -> tuple[float, float]:
    """Direction of a part, on the side of the normal: unchanged, or sampled from the profile around it."""
    if not uniform_of(event, purpose) < t.scatter_fraction:
        return dx, dz
    smooth = dx * -nz + dz * nx
    for i in range(TRIES):
        random_1, random_2 = uniform_of(event, purpose + 2 * i + 1), uniform_of(event, purpose + 2 * i + 2)
        sine = 2.0 * random_1 - 1.0
        if t.scatter == GAUSSIAN:
            sine = smooth + t.width * math.sqrt(-2.0 * math.log(1.0 - random_1)) * math.cos(2.0 * math.pi * random_2)
        elif t.scatter == HARVEY_SHACK:
            shift = math.tan(math.pi * (random_1 - 0.5))
            sine = smooth + t.width * shift
            if not harvey_shack_acceptance(t.width, t.wing, shift) > random_2:
                continue
        elif t.scatter == BY_TABLE:
            shift, acceptance = tabulated_offset(tables, t, random_1, False)
            if not acceptance > uniform_of(event, purpose + REJECTION + i):
                continue
            sine = smooth + (shift if random_2 < 0.5 else -shift)
        if abs(sine) < 1.0:
            cos = math.sqrt((1.0 - sine) * (1.0 + sine))
            return cos * nx - sine * nz, cos * nz + sine * nx
    return dx, dz


@compiled
def tabulated_offset(tables: Tables, t: Treatment, fraction: float, in_space: bool) -> tuple[float, float]:
    """Offset at a cumulative fraction of a profile's envelope, and the acceptance probability there."""
    column, power = (3, 2.0) if in_space else (2, 1.0)
    low, high = int(t.first_offset), int(t.first_offset + t.offset_count) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if tables.layers[middle, column] <= fraction:
            low = middle
        else:
            high = middle
    a, b = tables.layers[low], tables.layers[high]
    position = min(max((fraction - a[column]) / max(b[column] - a[column], 1e-300), 0.0), 1.0)
    offset = (a[0] ** power + position * (b[0] ** power - a[0] ** power)) ** (1.0 / power)
    density = a[1] + (b[1] - a[1]) * (offset - a[0]) / (b[0] - a[0])
    return offset, density / max(a[1], b[1], 1e-300)


@compiled
def tabulated(tables: Tables, t: Treatment, from_right: bool, cos: float, no_transmission: bool) -> Amplitudes:
    """Power fractions at an angle of incidence, linearly interpolated; without transmission all light is reflected.

    A table contains no phases: reflected fields get the phases of a perfect mirror, transmitted fields get no phase.
    """
    low = int(t.first_row + t.rows) if from_right and t.rows_right > 0.0 else int(t.first_row)
    high = low + int(t.rows_right if from_right and t.rows_right > 0.0 else t.rows) - 1
    angle = math.acos(min(max(cos, 0.0), 1.0))
    while high - low > 1:
        middle = (low + high) // 2
        if tables.layers[middle, 0] <= angle:
            low = middle
        else:
            high = middle
    a, b = tables.layers[low], tables.layers[high]
    position = min(max((angle - a[0]) / (b[0] - a[0]), 0.0), 1.0)
    back_s, back_p = a[1] + position * (b[1] - a[1]), a[2] + position * (b[2] - a[2])
    on_s, on_p = a[3] + position * (b[3] - a[3]), a[4] + position * (b[4] - a[4])
    if no_transmission:
        back_s, back_p, on_s, on_p = back_s + on_s, back_p + on_p, 0.0 * on_s, 0.0 * on_p
    return Amplitudes(back_s, back_p, -math.sqrt(back_s * back_p), 0.0, on_s, on_p, math.sqrt(on_s * on_p), 0.0)


@compiled
def harvey_shack_acceptance(width: float, wing: float, offset: float) -> float:
    """Acceptance probability of a Cauchy sample for the profile (1 + offset²)^(−wing/2), truncated at 2 / width."""
    widest = 2.0 / width
    power = 1.0 - 0.5 * wing
    largest = (1.0 + widest * widest) ** power if power > 0.0 else 1.0
    return (1.0 + offset * offset) ** power / largest if abs(offset) <= widest else 0.0


@compiled
def is_opaque(tables: Tables, t: Treatment, colour: int, cos: float, n1: float) -> bool:
    """Whether counting mode assumes total reflection, as light is evanescent in a film thicker than its wavelength."""
    sine2 = n1 * n1 * (1.0 - cos * cos)
    opaque = False
    for i in range(int(t.layers)):
        row = tables.layers[int(t.first_layer) + i]
        opaque = opaque or (row[2] > tables.wavelength[colour] and row[0] * row[0] < sine2)
    return opaque


@compiled
def film(
    tables: Tables, t: Treatment, colour: int, from_right: bool, cos_in: float, n1: float, n2: float
) -> Amplitudes:
    """Effect of a film stack on power and fields, from characteristic matrices.

    (Macleod, Thin-Film Optical Filters, chapter 2.) A film in which waves decay below the smallest representable number
    is treated as infinitely thick.
    """
    q2 = n1 * n1 * (1.0 - cos_in * cos_in)
    out = root(complex(n2 * n2 - q2, 0.0))
    b_s, c_s, b_p, c_p = 1.0 + 0.0j, out, 1.0 + 0.0j, n2 * n2 / out
    first, count = int(t.first_layer), int(t.layers)
    last_s, last_p = c_s.real, c_p.real
    for i in range(count):
        row = tables.layers[first + (i if from_right else count - 1 - i)]
        n = complex(row[0], -row[1])
        axial = root(n * n - q2)
        phase = 2.0 * math.pi / tables.wavelength[colour] * row[2] * axial
        if phase.imag < -OPAQUE:
            b_s, c_s, b_p, c_p = 1.0 + 0.0j, axial, 1.0 + 0.0j, n * n / axial
            last_s, last_p = 0.0, 0.0
            continue
        cos, sin = cmath.cos(phase), 1j * cmath.sin(phase)
        eta_p = n * n / axial
        b_s, c_s = cos * b_s + sin / axial * c_s, axial * sin * b_s + cos * c_s
        b_p, c_p = cos * b_p + sin / eta_p * c_p, eta_p * sin * b_p + cos * c_p
    in_s, in_p = n1 * cos_in, n1 / cos_in
    denominator_s, denominator_p = in_s * b_s + c_s, in_p * b_p + c_p
    r_s, r_p = (in_s * b_s - c_s) / denominator_s, (in_p * b_p - c_p) / denominator_p
    on_s = max(4.0 * in_s * last_s / abs(denominator_s) ** 2, 0.0)
    on_p = max(4.0 * in_p * last_p / abs(denominator_p) ** 2, 0.0)
    phase_factor = denominator_p * denominator_s.conjugate()  # phase difference of the transmitted fields
    on_product = math.sqrt(on_s * on_p) * phase_factor / abs(phase_factor)
    back = -r_s * r_p.conjugate()  # for fields along the surface, p has the opposite sign
    return Amplitudes(abs(r_s) ** 2, abs(r_p) ** 2, back.real, back.imag, on_s, on_p, on_product.real, on_product.imag)


@compiled
def root(square: complex) -> complex:
    """Square root of a squared wave number along the normal, for a decaying wave (time dependence exp(+iωt))."""
    axial = cmath.sqrt(square)
    return -axial if axial.imag > 0.0 else axial
