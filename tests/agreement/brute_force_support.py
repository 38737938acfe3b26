"""The paper's sensor with a face in space, by brute force: own shapes, own search, own optics; nothing of solen's.

Many rays at a time march through the lens in short steps, layer by layer, and everything else is met by solving for
straight lines. Light is a complex field, at first linearly polarised at random; at every surface Fresnel's amplitudes
act on it, and one of the two parts is drawn by its power. Sixteen scrambled Sobol' nets of launches give the errors.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.integrate import solve_ivp
from scipy.stats import qmc

S, F, HALF, TOP = 1.0, 20.0, 2.0, 2.0
"""From the emitter to the vertex, from there to the focus, half the aperture, half the thickness, mm."""
CURVE, STEM, ARM, WIDE = 0.004, 16.2, 22.2, 3.0
NEAREST, STEP, EPS, MAX_HITS = -0.1, 0.05, 1e-7, 300
NETS, CHUNK = 16, 2**14
RECEIVERS, TOP_OR_BOTTOM, STEM_SIDE, LENS_SIDE, FACE, NOTHING = (3, 7), 10, 11, 12, 13, -1
"""Numbers of surfaces; those below 8 are straight walls."""
Array = np.ndarray


class Shape(Protocol):
    """A face: borders between its layers, and a function of a layer and places that is above 0 before the face."""

    edges: Array

    def level(self, layer: Array, p: Array) -> Array: ...

    def gradient(self, layer: Array, p: Array) -> Array: ...


class LineFocus:
    """|P − E| + n·D = const, D the distance from a circle about the focal line."""

    edges = np.array([-TOP, TOP])

    def __init__(self, y_focus: float, n: float = 1.44) -> None:
        self.ring, self.n = F + y_focus, n
        self.const = S - n * y_focus

    def level(self, layer: Array, p: Array) -> Array:  # noqa: ARG002  there is but one
        x, y, z = p.T
        along = self.ring - np.sqrt(x * x + (F - z) ** 2)
        return np.asarray(np.sqrt(x * x + y * y + (z + S) ** 2) - self.n * np.sqrt(along * along + y * y) - self.const)

    def gradient(self, layer: Array, p: Array) -> Array:
        near, step = np.zeros_like(p), 1e-5
        for i in range(3):
            shift = step * np.eye(3)[i]
            near[:, i] = (self.level(layer, p + shift) - self.level(layer, p - shift)) / (2.0 * step)
        return near


class Layers:
    """A profile for each layer, by Snell's law in projection for the emitter's ray that meets it at its middle."""

    def __init__(self, layer: float, n: float = 1.44, places: int = 4001) -> None:
        count = round(2.0 * TOP / layer)
        self.edges, self.step = np.linspace(-TOP, TOP, count + 1), HALF / (places - 1)
        y = 0.5 * (self.edges[1:] + self.edges[:-1])

        def slope(x: float, z: Array) -> Array:
            out = np.stack([np.full_like(z, x), y, z + S])  # the emitter's ray in space
            beta = out[1] / np.linalg.norm(out, axis=0)
            to_focus = np.stack([np.full_like(z, -x), F - z]) / np.hypot(x, F - z)
            before = np.sqrt(1.0 - beta**2) * out[[0, 2]] / np.hypot(out[0], out[2])
            kick = np.sqrt(n * n - beta**2) * to_focus - before  # along the normal, by Snell's law
            return np.asarray(-kick[0] / kick[1])

        x = np.linspace(0.0, HALF, places)
        solved = solve_ivp(slope, (0.0, HALF), np.zeros(count), "DOP853", t_eval=x, rtol=1e-11, atol=1e-12)
        self.z = solved.y
        self.slope = np.stack([slope(one, z) for one, z in zip(x, self.z.T, strict=True)], axis=1)

    def _at(self, table: Array, layer: Array, x: Array) -> Array:
        place = np.minimum(np.abs(x) / self.step, table.shape[1] - 1.000001)
        low = place.astype(int)
        return np.asarray(table[layer, low] + (place - low) * (table[layer, low + 1] - table[layer, low]))

    def level(self, layer: Array, p: Array) -> Array:
        return np.asarray(self._at(self.z, layer, p[:, 0]) - p[:, 2])

    def gradient(self, layer: Array, p: Array) -> Array:
        slope = np.sign(p[:, 0]) * self._at(self.slope, layer, p[:, 0])
        return np.column_stack([slope, np.zeros_like(slope), np.full_like(slope, -1.0)])


@dataclass(frozen=True)
class Found:
    """Shares of the emitted power of every net, (NETS,) each."""

    right: Array
    left: Array
    leaked: Array
    lost: Array

    @staticmethod
    def mean(values: Array) -> tuple[float, float]:
        return float(values.mean()), float(values.std(ddof=1) / math.sqrt(len(values)))

    @property
    def contrast(self) -> tuple[float, float]:
        return self.mean((self.right - self.left) / (self.right + self.left))

    @property
    def light(self) -> tuple[float, float]:
        return self.mean(self.right + self.left)


class Sensor:
    """The sensor turned by an angle about the stem's base; its emitter off by ``at`` (x, y, z) in its own frame."""

    def __init__(
        self, shape: Shape, angle_deg: float, index: float = 1.44, at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> None:
        self.shape, self.n, self.at = shape, index, np.array(at)
        self.base = float(_oval_depth(HALF))
        turn = math.radians(angle_deg)
        self.turn = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        corners = [self._scene(np.array([[side * HALF, 0.0, self.base]]))[0, ::2] for side in (1.0, -1.0)]
        self.rises, self.segments = [], []
        for side, edge in zip((1.0, -1.0), corners, strict=True):
            rise = max(0.0, edge[1] - self.base)
            self.rises.append(rise)
            arm = math.atan(2.0 * CURVE * STEM)
            out, inwards = (
                np.array([side * math.sin(arm), math.cos(arm)]),
                np.array([-side * math.cos(arm), math.sin(arm)]),
            )
            fork = np.array([side * (HALF + CURVE * STEM**2), self.base + STEM])
            tip = fork + ARM * out
            inner = tip + WIDE * inwards
            crotch = np.array([0.0, inner[1] - abs(inner[0]) / math.tan(arm)])
            start = np.array([side * (HALF + CURVE * rise**2), self.base + rise])
            self.segments += [(edge, start), (fork, tip), (inner, crotch), (tip, inner)]  # the last is the receiver

    def _scene(self, p: Array, *, shift: bool = True) -> Array:
        return self._turned(p, self.turn, shift=shift)

    def _own(self, p: Array, *, shift: bool = True) -> Array:
        return self._turned(p, self.turn.T, shift=shift)

    def _turned(self, p: Array, turn: Array, *, shift: bool) -> Array:
        base = np.array([0.0, self.base if shift else 0.0])
        flat = (p[:, ::2] - base) @ turn.T + base
        return np.column_stack([flat[:, 0], p[:, 1], flat[:, 1]])

    def traced(self, rays: int, seed: int = 1) -> Found:
        """So many rays of a chip of 0.2 × 0.2 mm, Lambertian within 120°."""
        each, rows = rays // NETS, []
        for net in range(NETS):
            u = qmc.Sobol(6, rng=np.random.default_rng([seed, net])).random(each)
            draw = np.random.default_rng([seed, net, 1])
            rows.append(sum(self._fates(part, draw) for part in np.array_split(u, max(1, each // CHUNK))) / each)
        return Found(*np.array(rows).T)

    def _fates(self, u: Array, draw: np.random.Generator) -> Array:
        """Numbers of rays that end right and left, that leak through top and bottom, and that get lost."""
        sin, angle = math.sin(math.radians(60.0)) * np.sqrt(u[:, 2]), 2.0 * math.pi * u[:, 3]
        own = np.column_stack([sin * np.cos(angle), sin * np.sin(angle), np.sqrt(1.0 - sin**2)])
        place = np.column_stack([0.2 * (u[:, 0] - 0.5), 0.2 * (u[:, 1] - 0.5), np.full(len(u), -S)]) + self.at
        p, d = self._scene(place), self._scene(own, shift=False)
        across = _unit(np.cross(d, [1.0, 0.0, 0.0]))
        turned = math.pi * u[:, 4:5]
        field = (np.cos(turned) * across + np.sin(turned) * np.cross(d, across)).astype(complex)
        inside, fates, chance = np.zeros(len(u), dtype=bool), np.zeros(4), u[:, 5]
        for _ in range(MAX_HITS):
            way, wall, normal = self._nearest(p, d, inside)
            met = wall != NOTHING
            right, left = (inside & (wall == number) for number in RECEIVERS)
            fates += [np.sum(right), np.sum(left), 0, np.sum(inside & ~met)]
            going = met & ~np.isin(wall, RECEIVERS)
            p, d, field, inside, wall, normal = (one[going] for one in (p, d, field, inside, wall, normal))
            if not len(p):
                return fates
            p = p + way[going, None] * d
            field, d, through = self._surface(d, field, normal, inside, chance[going])
            leaks = through & (wall == TOP_OR_BOTTOM)
            fates[2] += np.sum(leaks)
            inside = inside ^ through
            p, d, field, inside = (one[~leaks] for one in (p, d, field, inside))
            chance = draw.random(len(p))
        return np.asarray(fates + np.array([0.0, 0.0, 0.0, len(p)]))

    def _surface(
        self, d: Array, field: Array, normal: Array, inside: Array, chance: Array
    ) -> tuple[Array, Array, Array]:
        """Field and direction behind a surface or before it, by chance, and whether the light went through."""
        normal = np.where(np.sum(d * normal, axis=1)[:, None] > 0.0, -normal, normal)
        n1, n2 = np.where(inside, self.n, 1.0), np.where(inside, 1.0, self.n)
        cos = -np.sum(d * normal, axis=1)
        s = _unit(np.where(cos[:, None] < 1.0 - 1e-14, np.cross(normal, d), np.cross(d, [0.6, 0.0, 0.8])))
        beyond = np.sqrt((1.0 - (n1 / n2) ** 2 * (1.0 - cos**2)).astype(complex))
        of_s, of_p = np.sum(field * s, axis=1), np.sum(field * np.cross(d, s), axis=1)
        back_s = (n1 * cos - n2 * beyond) / (n1 * cos + n2 * beyond) * of_s
        back_p = (n2 * cos - n1 * beyond) / (n2 * cos + n1 * beyond) * of_p
        on_s = 2.0 * n1 * cos / (n1 * cos + n2 * beyond) * of_s
        on_p = 2.0 * n1 * cos / (n2 * cos + n1 * beyond) * of_p
        through = chance > np.abs(back_s) ** 2 + np.abs(back_p) ** 2
        through &= np.abs(beyond.imag) == 0.0
        on = (n1 / n2)[:, None] * d + (n1 / n2 * cos - beyond.real)[:, None] * normal
        d = _unit(np.where(through[:, None], on, d + 2.0 * cos[:, None] * normal))
        by_s, by_p = np.where(through, on_s, back_s), np.where(through, on_p, back_p)
        field = by_s[:, None] * s + by_p[:, None] * np.cross(d, s)
        return _unit(field), d, through

    def _nearest(self, p: Array, d: Array, inside: Array) -> tuple[Array, Array, Array]:
        """The nearest surface: its way, number and normal; number −1 where light leaves for good."""
        way, wall = np.full(len(p), np.inf), np.full(len(p), NOTHING)
        normal = np.zeros_like(p)

        def take(ways: Array, number: int, normals: Array) -> None:
            nearer = ways < way
            way[nearer], wall[nearer], normal[nearer] = ways[nearer], number, normals[nearer]

        with np.errstate(divide="ignore", invalid="ignore"):
            for number, (a, b) in enumerate(self.segments):
                take(*self._on_segment(p, d, a, b, number))
            for side, rise in zip((1.0, -1.0), self.rises, strict=True):
                for ways, normals in self._on_stem(p, d, side, rise):
                    take(ways, STEM_SIDE, normals)
            own, along = self._own(p), self._own(d, shift=False)
            for side in (1.0, -1.0):
                take(self._on_side(own, along, side), LENS_SIDE, self._scene(_row([side, 0.0, 0.0], p), shift=False))
            level = np.where(d[:, 1] != 0.0, (np.sign(d[:, 1]) * TOP - p[:, 1]) / d[:, 1], np.inf)
        ways, normals = self._on_face(own, along, np.minimum(way, level))
        take(ways, FACE, self._scene(normals, shift=False))
        take(np.maximum(level, 0.0), TOP_OR_BOTTOM, _row([0.0, 1.0, 0.0], p))
        wall[~inside & (wall == TOP_OR_BOTTOM)] = NOTHING
        return way, wall, normal

    def _on_segment(self, p: Array, d: Array, a: Array, b: Array, number: int) -> tuple[Array, int, Array]:
        e, x, z = b - a, a[0] - p[:, 0], a[1] - p[:, 2]
        cross = d[:, 0] * e[1] - d[:, 2] * e[0]
        way, share = (x * e[1] - z * e[0]) / cross, (x * d[:, 2] - z * d[:, 0]) / cross
        met = (way > EPS) & (share >= 0.0) & (share <= 1.0)
        return np.where(met, way, np.inf), number, _row(_unit(np.array([[e[1], 0.0, -e[0]]]))[0], p)

    def _on_stem(self, p: Array, d: Array, side: float, rise: float) -> list[tuple[Array, Array]]:
        z = p[:, 2] - self.base
        a, b = CURVE * d[:, 2] ** 2, 2.0 * CURVE * z * d[:, 2] - side * d[:, 0]
        c = CURVE * z * z + HALF - side * p[:, 0]
        root = np.sqrt(b * b - 4.0 * a * c)
        q, found = -0.5 * (b + np.where(b >= 0.0, root, -root)), []
        for way in (q / a, c / q):
            at = z + way * d[:, 2]
            met = (way > EPS) & (at >= rise) & (at <= STEM)
            normal = _unit(np.column_stack([np.full(len(p), side), np.zeros(len(p)), -2.0 * CURVE * at]))
            found.append((np.where(met, way, np.inf), np.where(met[:, None], normal, 0.0)))
        return found

    def _on_side(self, p: Array, d: Array, side: float) -> Array:
        """The upright side of the lens between its face and the stem's base."""
        way = (side * HALF - p[:, 0]) / d[:, 0]
        at = p + np.where(np.isfinite(way), way, 0.0)[:, None] * d
        met = (way > EPS) & (at[:, 2] < self.base) & (np.abs(at[:, 1]) < TOP)
        met &= self.shape.level(self._layer(at[:, 1], d[:, 1]), at) < 0.0
        return np.where(met, way, np.inf)

    def _layer(self, y: Array, rises: Array) -> Array:
        edges = self.shape.edges
        return np.clip(np.searchsorted(edges, y + EPS * rises, side="right") - 1, 0, len(edges) - 2)

    def _on_face(self, p: Array, d: Array, most: Array) -> tuple[Array, Array]:
        """March through the lens, in its own frame, until the side of the face changes."""
        ways, normals = np.full(len(p), np.inf), np.zeros_like(p)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.array([
                [(bound - p[:, axis]) / d[:, axis] for bound in bounds]
                for axis, bounds in ((0, (-HALF, HALF)), (2, (NEAREST, self.base)))
            ])  # fmt: skip
        low = np.maximum(ends.min(axis=1).max(axis=0), EPS)
        high = np.minimum(ends.max(axis=1).min(axis=0), most)
        i = np.flatnonzero(low < high)
        w, p, d, high = low[i], p[i], d[i], high[i]
        layer = self._layer(p[:, 1] + w * d[:, 1], d[:, 1])
        up = np.sign(d[:, 1]).astype(int)
        side = self._before(layer, p, d, w)
        while len(i):
            with np.errstate(divide="ignore", invalid="ignore"):
                border = np.where(up == 0, np.inf, (self.shape.edges[layer + (up > 0)] - p[:, 1]) / d[:, 1])
            stop = np.minimum(np.minimum(w + STEP, border), high)
            crossed = self._before(layer, p, d, stop) != side
            k = np.flatnonzero(crossed)
            a, b = w[k], stop[k]
            for _ in range(45 if len(k) else 0):
                middle = 0.5 * (a + b)
                same = self._before(layer[k], p[k], d[k], middle) == side[k]
                a, b = np.where(same, middle, a), np.where(same, b, middle)
            ways[i[k]] = b
            normals[i[k]] = _unit(self.shape.gradient(layer[k], p[k] + b[:, None] * d[k]))
            over = ~crossed & (stop == border) & (stop < high)
            other = np.clip(np.where(over, layer + up, layer), 0, len(self.shape.edges) - 2)
            ledge = over & (self._before(other, p, d, stop) != side)
            ways[i[ledge]], normals[i[ledge]] = stop[ledge], [0.0, 1.0, 0.0]
            on = ~crossed & ~ledge & (stop < high)
            w, i, p, d, high, layer, up, side = (one[on] for one in (stop, i, p, d, high, other, up, side))
        return ways, normals

    def _before(self, layer: Array, p: Array, d: Array, way: Array) -> Array:
        return self.shape.level(layer, p + way[:, None] * d) > 0.0


def _oval_depth(x: float, n: float = 1.44) -> float:
    """Depth of the Cartesian oval, by halving."""
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


def _row(v: Array | list[float], like: Array) -> Array:
    return np.broadcast_to(np.asarray(v, dtype=float), like.shape)
