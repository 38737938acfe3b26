"""Typical damage to files: changed, lost and surplus bytes, and lost, repeated, truncated and swapped lines.

Each kind of damage returns how many numbers it may have changed undetectably: one if a byte inside a number may have
become another digit, none if cells or lines moved.
"""

import random
from collections.abc import Callable

Damage = Callable[[random.Random, bytes], tuple[bytes, int]]

_INSIDE = b"0123456789.,-+eE"
_SEPARATORS = b",;\t \n\r"


def damaged(seed: int, data: bytes) -> tuple[bytes, int, list[str]]:
    """Return a file with one to three kinds of damage, the number of undetectable changes, and the kinds."""
    rng = random.Random(seed)  # noqa: S311
    undetectable, applied = 0, []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        if not data:
            break
        name = rng.choice(sorted(KINDS))
        data, changes = KINDS[name](rng, data)
        undetectable += changes
        applied.append(name)
    return data, undetectable, applied


def _byte(rng: random.Random, data: bytes) -> tuple[bytes, int]:
    """Replace a byte by another."""
    position = rng.randrange(len(data))
    return data[:position] + bytes([rng.randrange(256)]) + data[position + 1 :], 1


def _bit(rng: random.Random, data: bytes) -> tuple[bytes, int]:
    """Flip a bit."""
    position = rng.randrange(len(data))
    return data[:position] + bytes([data[position] ^ (1 << rng.randrange(8))]) + data[position + 1 :], 1


def _digit(rng: random.Random, data: bytes) -> tuple[bytes, int]:
    """Replace a byte by a character of numbers."""
    position = rng.randrange(len(data))
    return data[:position] + bytes([rng.choice(_INSIDE)]) + data[position + 1 :], 1


def _separator(rng: random.Random, data: bytes) -> tuple[bytes, int]:
    """Replace or remove a separator; a comma may be a decimal comma."""
    places = [n for n, byte in enumerate(data) if byte in _SEPARATORS]
    if not places:
        return data, 0
    position = rng.choice(places)
    other = bytes([rng.choice(_SEPARATORS)]) if rng.random() < 0.7 else b""
    return data[:position] + other + data[position + 1 :], int(data[position : position + 1] == b",")


def _lost(rng: random.Random, data: bytes) -> tuple[bytes, int]:
    """Remove a byte."""
    position = rng.randrange(len(data))
    return data[:position] + data[position + 1 :], 1


def _added(rng: random.Random, data: bytes) -> tuple[bytes, int]:
    """Insert a byte."""
    position = rng.randrange(len(data) + 1)
    byte = rng.choice(_INSIDE) if rng.random() < 0.5 else rng.randrange(256)
    return data[:position] + bytes([byte]) + data[position:], 1


def _part_lost(rng: random.Random, data: bytes) -> tuple[bytes, int]:
    """Remove up to sixty bytes: digits, cells, or the end of a line and the beginning of the next.

    In the last case, the remaining line may be complete, with numbers of both.
    """
    position, count = rng.randrange(len(data)), rng.randrange(2, 60)
    return data[:position] + data[position + count :], _columns(data[position : position + count])


def _part_doubled(rng: random.Random, data: bytes) -> tuple[bytes, int]:
    """Repeat up to sixty bytes; lines may be joined as by `_part_lost`."""
    position, count = rng.randrange(len(data)), rng.randrange(2, 60)
    return data[: position + count] + data[position:], _columns(data[position : position + count])


def _columns(part: bytes) -> int:
    return 1 if b"\n" not in part else 5


def _truncated(rng: random.Random, data: bytes) -> tuple[bytes, int]:
    """Truncate the file."""
    return data[: rng.randrange(len(data))], 0


def _of_lines(change: Callable[[random.Random, list[bytes]], None], undetectable: int = 0) -> Damage:
    def damage(rng: random.Random, data: bytes) -> tuple[bytes, int]:
        lines = data.splitlines(keepends=True)
        change(rng, lines)
        return b"".join(lines), undetectable

    return damage


def _line_lost(rng: random.Random, lines: list[bytes]) -> None:
    lines.pop(rng.randrange(len(lines)))


def _line_doubled(rng: random.Random, lines: list[bytes]) -> None:
    position = rng.randrange(len(lines))
    lines.insert(position, lines[position])


def _lines_swapped(rng: random.Random, lines: list[bytes]) -> None:
    first, second = (rng.randrange(len(lines)) for _ in range(2))
    lines[first], lines[second] = lines[second], lines[first]


def _line_cut(rng: random.Random, lines: list[bytes]) -> None:
    position = rng.randrange(len(lines))
    content = lines[position].rstrip(b"\r\n")
    lines[position] = content[: rng.randrange(len(content) + 1)] + lines[position][len(content) :]


def _line_emptied(rng: random.Random, lines: list[bytes]) -> None:
    position = rng.randrange(len(lines))
    lines[position] = lines[position][len(lines[position].rstrip(b"\r\n")) :]


KINDS: dict[str, Damage] = {
    "byte": _byte,
    "bit": _bit,
    "digit": _digit,
    "separator": _separator,
    "lost": _lost,
    "added": _added,
    "part lost": _part_lost,
    "part doubled": _part_doubled,
    "truncated": _truncated,
    "line lost": _of_lines(_line_lost),
    "line doubled": _of_lines(_line_doubled),
    "lines swapped": _of_lines(_lines_swapped),
    "line cut": _of_lines(_line_cut, 1),
    "line emptied": _of_lines(_line_emptied),
}
