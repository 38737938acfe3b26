"""A brute-force model of the paper's sensor with a lens for skew rays, which shares no code with solen.

Many rays at a time advance through the lens in short steps, layer by layer; intersections with other surfaces are
computed in closed form. Light is a complex field, initially linearly polarised in a random direction. Fresnel's
amplitude coefficients are applied at every surface, and one of the two parts is drawn with probability proportional to
its power. The standard errors come from sixteen scrambled Sobol' nets.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.integrate import solve_ivp
from scipy.stats import qmc

S, F, HALF, TOP = 1.0, 20.0, 2.0, 2.0
"""Distances in mm from the emitter to the vertex and from there to the focus, half the aperture, half the thickness."""
FLARE_PER_MM, STEM, ARM, ARM_WIDTH = 0.004, 16.2, 22.2, 3.0
MIN_Z, STEP, EPS, MAX_HITS = -0.1, 0.05, 1e-7, 300
NETS, CHUNK = 16, 2**14
RECEIVERS, TOP_OR_BOTTOM, STEM_SIDE, LENS_SIDE, FACE, NO_SURFACE = (3, 7), 10, 11, 12, 13, -1
"""Numbers of surfaces; those below 8 are straight walls."""
Array = np.ndarray


class Shape(Protocol):
    """A face: the edges of its layers, and a function of layer and position that is positive in front of the face."""

    edges: Array

    def level(self, layer: Array, p: Array) -> Array: ...

    def gradient(self, layer: Array, p: Array) -> Array: ...


class LineFocus:
    """The face |P − E| + n·D = const, where D is the distance from a circle about the focal line."""

    edges = np.array([-TOP, TOP])

    def __init__(self, y_focus: float, n: float = 1.44) -> None:
        self.ring, self.n = F + y_focus, n
        self.const = S - n * y_focus

    def level(self, layer: Array, p: Array) -> Array:  # noqa: ARG002  this face has one layer
        x, y, z = p.T
        along = self.ring - np.sqrt(x * x + (F - z) ** 2)
        return np.asarray(np.sqrt(x * x + y * y + (z + S) ** 2) - self.n * np.sqrt(along * along + y * y) - self.const)

    def gradient(self, layer: Array, p: Array) -> Array:
        gradient, step = np.zeros_like(p), 1e-5
        for i in range(3):
            shift = step * np.eye(3)[i]
            gradient[:, i] = (self.level(layer, p + shift) - self.level(layer, p - shift)) / (2.0 * step)
        return gradient


class Layers:
    """A profile for each layer, by Snell's law in projection for the emitter's rays that meet it at mid-height."""

    def __init__(self, layer: float, n: float = 1.44, points: int = 4001) -> None:
        count = round(2.0 * TOP / layer)
        self.edges, self.step = np.linspace(-TOP, TOP, count + 1), HALF / (points - 1)
        y = 0.5 * (self.edges[1:] + self.edges[:-1])

        def slope(x: float, z: Array) -> Array:
            incident = np.stack([np.full_like(z, x), y, z + S])  # the emitter's ray in space
            beta = incident[1] / np.linalg.norm(incident, axis=0)
            to_focus = np.stack([np.full_like(z, -x), F - z]) / np.hypot(x, F - z)
            before = np.sqrt(1.0 - beta**2) * incident[[0, 2]] / np.hypot(incident[0], incident[2])
            change = np.sqrt(n * n - beta**2) * to_focus - before  # along the normal, by Snell's law
            return np.asarray(-change[0] / change[1])

        x = np.linspace(0.0, HALF, points)
        solution = solve_ivp(slope, (0.0, HALF), np.zeros(count), "DOP853", t_eval=x, rtol=1e-11, atol=1e-12)
        self.z = solution.y
        self.slope = np.stack([slope(xi, z) for xi, z in zip(x, self.z.T, strict=True)], axis=1)

    def _at(self, table: Array, layer: Array, x: Array) -> Array:
        position = np.minimum(np.abs(x) / self.step, table.shape[1] - 1.000001)
        low = position.astype(int)
        return np.asarray(table[layer, low] + (position - low) * (table[layer, low + 1] - table[layer, low]))

    def level(self, layer: Array, p: Array) -> Array:
        return np.asarray(self._at(self.z, layer, p[:, 0]) - p[:, 2])

    def gradient(self, layer: Array, p: Array) -> Array:
        slope = np.sign(p[:, 0]) * self._at(self.slope, layer, p[:, 0])
        return np.column_stack([slope, np.zeros_like(slope), np.full_like(slope, -1.0)])


@dataclass(frozen=True)
class Powers:
    """Fractions of the emitted power by net, (NETS,) each."""

    right: Array
    left: Array
    leaked: Array
    lost: Array

    @staticmethod
    def mean(values: Array) -> tuple[float, float]:
        """Return the mean over the nets and its standard error."""
        return float(values.mean()), float(values.std(ddof=1) / math.sqrt(len(values)))

    @property
    def contrast(self) -> tuple[float, float]:
        return self.mean((self.right - self.left) / (self.right + self.left))

    @property
    def light(self) -> tuple[float, float]:
        return self.mean(self.right + self.left)


class Sensor:
    """The sensor rotated by an angle about the base of the stem; ``at`` displaces the emitter in the lens frame."""

    def __init__(
        self, shape: Shape, angle_deg: float, index: float = 1.44, at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> None:
        self.shape, self.n, self.at = shape, index, np.array(at)
        self.base = float(_oval_depth(HALF))
        angle = math.radians(angle_deg)
        self.rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        corners = [self._to_scene(np.array([[side * HALF, 0.0, self.base]]))[0, ::2] for side in (1.0, -1.0)]
        self.rises, self.segments = [], []
        for side, edge in zip((1.0, -1.0), corners, strict=True):
            rise = max(0.0, edge[1] - self.base)
            self.rises.append(rise)
            arm_angle = math.atan(2.0 * FLARE_PER_MM * STEM)
            outwards = np.array([side * math.sin(arm_angle), math.cos(arm_angle)])
            inwards = np.array([-side * math.cos(arm_angle), math.sin(arm_angle)])
            fork = np.array([side * (HALF + FLARE_PER_MM * STEM**2), self.base + STEM])
            tip = fork + ARM * outwards
            inner = tip + ARM_WIDTH * inwards
            crotch = np.array([0.0, inner[1] - abs(inner[0]) / math.tan(arm_angle)])
            start = np.array([side * (HALF + FLARE_PER_MM * rise**2), self.base + rise])
            self.segments += [(edge, start), (fork, tip), (inner, crotch), (tip, inner)]  # the last is the receiver

    def _to_scene(self, p: Array, *, shift: bool = True) -> Array:
        return self._rotated(p, self.rotation, shift=shift)

    def _to_lens(self, p: Array, *, shift: bool = True) -> Array:
        return self._rotated(p, self.rotation.T, shift=shift)

    def _rotated(self, p: Array, rotation: Array, *, shift: bool) -> Array:
        base = np.array([0.0, self.base if shift else 0.0])
        in_plane = (p[:, ::2] - base) @ rotation.T + base
        return np.column_stack([in_plane[:, 0], p[:, 1], in_plane[:, 1]])

    def powers(self, rays: int, seed: int = 1) -> Powers:
        """Trace rays of a Lambertian chip of 0.2 × 0.2 mm that emits within 120°."""
        per_net, rows = rays // NETS, []
        for net in range(NETS):
            u = qmc.Sobol(6, rng=np.random.default_rng([seed, net])).random(per_net)
            draw = np.random.default_rng([seed, net, 1])
            chunks = np.array_split(u, max(1, per_net // CHUNK))
            rows.append(sum(self._counts(chunk, draw) for chunk in chunks) / per_net)
        return Powers(*np.array(rows).T)

    def _counts(self, u: Array, draw: np.random.Generator) -> Array:
        """Return the number of rays detected right and left, leaked through top and bottom, and lost."""
        sin, azimuth = math.sin(math.radians(60.0)) * np.sqrt(u[:, 2]), 2.0 * math.pi * u[:, 3]
        direction = np.column_stack([sin * np.cos(azimuth), sin * np.sin(azimuth), np.sqrt(1.0 - sin**2)])
        position = np.column_stack([0.2 * (u[:, 0] - 0.5), 0.2 * (u[:, 1] - 0.5), np.full(len(u), -S)]) + self.at
        p, d = self._to_scene(position), self._to_scene(direction, shift=False)
        across = _unit(np.cross(d, [1.0, 0.0, 0.0]))
        polarisation = math.pi * u[:, 4:5]
        field = (np.cos(polarisation) * across + np.sin(polarisation) * np.cross(d, across)).astype(complex)
        inside, counts, uniform = np.zeros(len(u), dtype=bool), np.zeros(4), u[:, 5]
        for _ in range(MAX_HITS):
            distance, surface, normal = self._nearest(p, d, inside)
            is_hit = surface != NO_SURFACE
            right, left = (inside & (surface == number) for number in RECEIVERS)
            counts += [np.sum(right), np.sum(left), 0, np.sum(inside & ~is_hit)]
            continues = is_hit & ~np.isin(surface, RECEIVERS)
            p, d, field, inside, surface, normal = (a[continues] for a in (p, d, field, inside, surface, normal))
            if not len(p):
                return counts
            p = p + distance[continues, None] * d
            field, d, is_transmitted = self._at_surface(d, field, normal, inside, uniform[continues])
            leaks = is_transmitted & (surface == TOP_OR_BOTTOM)
            counts[2] += np.sum(leaks)
            inside = inside ^ is_transmitted
            p, d, field, inside = (a[~leaks] for a in (p, d, field, inside))
            uniform = draw.random(len(p))
        return np.asarray(counts + np.array([0.0, 0.0, 0.0, len(p)]))

    def _at_surface(
        self, d: Array, field: Array, normal: Array, inside: Array, uniform: Array
    ) -> tuple[Array, Array, Array]:
        """Return field and direction of the part drawn at a surface, and whether it is the transmitted part."""
        normal = np.where(np.sum(d * normal, axis=1)[:, None] > 0.0, -normal, normal)
        n1, n2 = np.where(inside, self.n, 1.0), np.where(inside, 1.0, self.n)
        cos = -np.sum(d * normal, axis=1)
        s = _unit(np.where(cos[:, None] < 1.0 - 1e-14, np.cross(normal, d), np.cross(d, [0.6, 0.0, 0.8])))
        cos2 = np.sqrt((1.0 - (n1 / n2) ** 2 * (1.0 - cos**2)).astype(complex))
        in_s, in_p = np.sum(field * s, axis=1), np.sum(field * np.cross(d, s), axis=1)
        reflected_s = (n1 * cos - n2 * cos2) / (n1 * cos + n2 * cos2) * in_s
        reflected_p = (n2 * cos - n1 * cos2) / (n2 * cos + n1 * cos2) * in_p
        transmitted_s = 2.0 * n1 * cos / (n1 * cos + n2 * cos2) * in_s
        transmitted_p = 2.0 * n1 * cos / (n2 * cos + n1 * cos2) * in_p
        is_transmitted = uniform > np.abs(reflected_s) ** 2 + np.abs(reflected_p) ** 2
        is_transmitted &= np.abs(cos2.imag) == 0.0
        refracted = (n1 / n2)[:, None] * d + (n1 / n2 * cos - cos2.real)[:, None] * normal
        d = _unit(np.where(is_transmitted[:, None], refracted, d + 2.0 * cos[:, None] * normal))
        out_s = np.where(is_transmitted, transmitted_s, reflected_s)
        out_p = np.where(is_transmitted, transmitted_p, reflected_p)
        field = out_s[:, None] * s + out_p[:, None] * np.cross(d, s)
        return _unit(field), d, is_transmitted

    def _nearest(self, p: Array, d: Array, inside: Array) -> tuple[Array, Array, Array]:
        """Return the distance to the nearest surface, its number and its normal; `NO_SURFACE` if light escapes."""
        distance, surface = np.full(len(p), np.inf), np.full(len(p), NO_SURFACE)
        normal = np.zeros_like(p)

        def add(distances: Array, number: int, normals: Array) -> None:
            nearer = distances < distance
            distance[nearer], surface[nearer], normal[nearer] = distances[nearer], number, normals[nearer]

        with np.errstate(divide="ignore", invalid="ignore"):
            for number, (a, b) in enumerate(self.segments):
                add(*self._on_segment(p, d, a, b, number))
            for side, rise in zip((1.0, -1.0), self.rises, strict=True):
                for distances, normals in self._on_stem(p, d, side, rise):
                    add(distances, STEM_SIDE, normals)
            lens_p, lens_d = self._to_lens(p), self._to_lens(d, shift=False)
            for side in (1.0, -1.0):
                side_normal = self._to_scene(_rows([side, 0.0, 0.0], p), shift=False)
                add(self._on_side(lens_p, lens_d, side), LENS_SIDE, side_normal)
            to_top = np.where(d[:, 1] != 0.0, (np.sign(d[:, 1]) * TOP - p[:, 1]) / d[:, 1], np.inf)
        distances, normals = self._on_face(lens_p, lens_d, np.minimum(distance, to_top))
        add(distances, FACE, self._to_scene(normals, shift=False))
        add(np.maximum(to_top, 0.0), TOP_OR_BOTTOM, _rows([0.0, 1.0, 0.0], p))
        surface[~inside & (surface == TOP_OR_BOTTOM)] = NO_SURFACE
        return distance, surface, normal

    def _on_segment(self, p: Array, d: Array, a: Array, b: Array, number: int) -> tuple[Array, int, Array]:
        e, x, z = b - a, a[0] - p[:, 0], a[1] - p[:, 2]
        cross = d[:, 0] * e[1] - d[:, 2] * e[0]
        distance, t = (x * e[1] - z * e[0]) / cross, (x * d[:, 2] - z * d[:, 0]) / cross
        is_hit = (distance > EPS) & (t >= 0.0) & (t <= 1.0)
        return np.where(is_hit, distance, np.inf), number, _rows(_unit(np.array([[e[1], 0.0, -e[0]]]))[0], p)

    def _on_stem(self, p: Array, d: Array, side: float, rise: float) -> list[tuple[Array, Array]]:
        z = p[:, 2] - self.base
        a, b = FLARE_PER_MM * d[:, 2] ** 2, 2.0 * FLARE_PER_MM * z * d[:, 2] - side * d[:, 0]
        c = FLARE_PER_MM * z * z + HALF - side * p[:, 0]
        root = np.sqrt(b * b - 4.0 * a * c)
        q, hits = -0.5 * (b + np.where(b >= 0.0, root, -root)), []
        for distance in (q / a, c / q):
            at = z + distance * d[:, 2]
            is_hit = (distance > EPS) & (at >= rise) & (at <= STEM)
            normal = _unit(np.column_stack([np.full(len(p), side), np.zeros(len(p)), -2.0 * FLARE_PER_MM * at]))
            hits.append((np.where(is_hit, distance, np.inf), np.where(is_hit[:, None], normal, 0.0)))
        return hits

    def _on_side(self, p: Array, d: Array, side: float) -> Array:
        """Return the distances to a side of the lens, between its face and the base of the stem."""
        distance = (side * HALF - p[:, 0]) / d[:, 0]
        at = p + np.where(np.isfinite(distance), distance, 0.0)[:, None] * d
        is_hit = (distance > EPS) & (at[:, 2] < self.base) & (np.abs(at[:, 1]) < TOP)
        is_hit &= self.shape.level(self._layer(at[:, 1], d[:, 1]), at) < 0.0
        return np.where(is_hit, distance, np.inf)

    def _layer(self, y: Array, dy: Array) -> Array:
        edges = self.shape.edges
        return np.clip(np.searchsorted(edges, y + EPS * dy, side="right") - 1, 0, len(edges) - 2)

    def _on_face(self, p: Array, d: Array, max_distance: Array) -> tuple[Array, Array]:
        """Advance through the lens in steps, in the lens frame, until the side of the face changes."""
        distances, normals = np.full(len(p), np.inf), np.zeros_like(p)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.array([
                [(bound - p[:, axis]) / d[:, axis] for bound in bounds]
                for axis, bounds in ((0, (-HALF, HALF)), (2, (MIN_Z, self.base)))
            ])  # fmt: skip
        low = np.maximum(ends.min(axis=1).max(axis=0), EPS)
        high = np.minimum(ends.max(axis=1).min(axis=0), max_distance)
        i = np.flatnonzero(low < high)
        t, p, d, high = low[i], p[i], d[i], high[i]
        layer = self._layer(p[:, 1] + t * d[:, 1], d[:, 1])
        up = np.sign(d[:, 1]).astype(int)
        in_front = self._is_in_front(layer, p, d, t)
        while len(i):
            with np.errstate(divide="ignore", invalid="ignore"):
                edge = np.where(up == 0, np.inf, (self.shape.edges[layer + (up > 0)] - p[:, 1]) / d[:, 1])
            stop = np.minimum(np.minimum(t + STEP, edge), high)
            is_crossed = self._is_in_front(layer, p, d, stop) != in_front
            k = np.flatnonzero(is_crossed)
            a, b = t[k], stop[k]
            for _ in range(45 if len(k) else 0):
                middle = 0.5 * (a + b)
                same = self._is_in_front(layer[k], p[k], d[k], middle) == in_front[k]
                a, b = np.where(same, middle, a), np.where(same, b, middle)
            distances[i[k]] = b
            normals[i[k]] = _unit(self.shape.gradient(layer[k], p[k] + b[:, None] * d[k]))
            at_edge = ~is_crossed & (stop == edge) & (stop < high)
            next_layer = np.clip(np.where(at_edge, layer + up, layer), 0, len(self.shape.edges) - 2)
            ledge = at_edge & (self._is_in_front(next_layer, p, d, stop) != in_front)
            distances[i[ledge]], normals[i[ledge]] = stop[ledge], [0.0, 1.0, 0.0]
            continues = ~is_crossed & ~ledge & (stop < high)
            t, i, p, d, high, layer, up, in_front = (
                values[continues] for values in (stop, i, p, d, high, next_layer, up, in_front)
            )
        return distances, normals

    def _is_in_front(self, layer: Array, p: Array, d: Array, distance: Array) -> Array:
        return self.shape.level(layer, p + distance[:, None] * d) > 0.0


def _oval_depth(x: float, n: float = 1.44) -> float:
    """Return the depth of the Cartesian oval, by bisection."""
    low, high = 0.0, 3.0
    for _ in range(60):
        z = 0.5 * (low + high)
        if math.hypot(z + S, x) + n * math.hypot(x, F - z) > S + n * F:
            low = z
        else:
            high = z
    return low


def _unit(v: Array) -> Array:
    return np.asarray(v / np.sqrt(np.sum(np.abs(v) ** 2, axis=-1, keepdims=True)))


def _rows(v: Array | list[float], like: Array) -> Array:
    return np.broadcast_to(np.asarray(v, dtype=float), like.shape)
