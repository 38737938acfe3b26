"""Damage as files meet it: bytes that flip, vanish or double, lines that are lost, doubled, cut or change places.

Each kind of damage knows how many numbers it can change without anybody being able to tell: one, where a single byte
inside a number became another digit; none, where cells or lines moved.
"""

import random
from collections.abc import Callable

Damage = Callable[[random.Random, bytes], tuple[bytes, int]]

_INSIDE = b"0123456789.,-+eE"
_SEPARATORS = b",;\t \n\r"


def damaged(seed: int, data: bytes) -> tuple[bytes, int, list[str]]:
    """A file with one to three kinds of damage, how many numbers may have changed unseen, and what was done."""
    dice = random.Random(seed)  # noqa: S311
    unseen, done = 0, []
    for _ in range(dice.choice((1, 1, 1, 2, 3))):
        if not data:
            break
        name = dice.choice(sorted(KINDS))
        data, more = KINDS[name](dice, data)
        unseen += more
        done.append(name)
    return data, unseen, done


def _byte(dice: random.Random, data: bytes) -> tuple[bytes, int]:
    """One byte becomes another."""
    place = dice.randrange(len(data))
    return data[:place] + bytes([dice.randrange(256)]) + data[place + 1 :], 1


def _bit(dice: random.Random, data: bytes) -> tuple[bytes, int]:
    """One bit flips."""
    place = dice.randrange(len(data))
    return data[:place] + bytes([data[place] ^ (1 << dice.randrange(8))]) + data[place + 1 :], 1


def _digit(dice: random.Random, data: bytes) -> tuple[bytes, int]:
    """A byte becomes one that numbers are written with."""
    place = dice.randrange(len(data))
    return data[:place] + bytes([dice.choice(_INSIDE)]) + data[place + 1 :], 1


def _separator(dice: random.Random, data: bytes) -> tuple[bytes, int]:
    """A separator becomes another one, or is lost; a comma may have been one of decimals."""
    places = [n for n, byte in enumerate(data) if byte in _SEPARATORS]
    if not places:
        return data, 0
    place = dice.choice(places)
    other = bytes([dice.choice(_SEPARATORS)]) if dice.random() < 0.7 else b""
    return data[:place] + other + data[place + 1 :], int(data[place : place + 1] == b",")


def _lost(dice: random.Random, data: bytes) -> tuple[bytes, int]:
    """One byte is lost."""
    place = dice.randrange(len(data))
    return data[:place] + data[place + 1 :], 1


def _added(dice: random.Random, data: bytes) -> tuple[bytes, int]:
    """A byte too many."""
    place = dice.randrange(len(data) + 1)
    byte = dice.choice(_INSIDE) if dice.random() < 0.5 else dice.randrange(256)
    return data[:place] + bytes([byte]) + data[place:], 1


def _part_lost(dice: random.Random, data: bytes) -> tuple[bytes, int]:
    """Up to sixty bytes are lost: within a number its digits, else cells, or the end of a line and the next one's
    beginning. The line that is left may then be whole, its first numbers of the one, its last of the other.
    """
    place, count = dice.randrange(len(data)), dice.randrange(2, 60)
    return data[:place] + data[place + count :], _columns(data[place : place + count])


def _part_doubled(dice: random.Random, data: bytes) -> tuple[bytes, int]:
    """Up to sixty bytes stand there twice; of lines the same may come as where a part is lost."""
    place, count = dice.randrange(len(data)), dice.randrange(2, 60)
    return data[: place + count] + data[place:], _columns(data[place : place + count])


def _columns(part: bytes) -> int:
    return 1 if b"\n" not in part else 5


def _truncated(dice: random.Random, data: bytes) -> tuple[bytes, int]:
    """The end of the file is lost."""
    return data[: dice.randrange(len(data))], 0


def _of_lines(change: Callable[[random.Random, list[bytes]], None], unseen: int = 0) -> Damage:
    def damage(dice: random.Random, data: bytes) -> tuple[bytes, int]:
        lines = data.splitlines(keepends=True)
        change(dice, lines)
        return b"".join(lines), unseen

    return damage


def _line_lost(dice: random.Random, lines: list[bytes]) -> None:
    lines.pop(dice.randrange(len(lines)))


def _line_doubled(dice: random.Random, lines: list[bytes]) -> None:
    place = dice.randrange(len(lines))
    lines.insert(place, lines[place])


def _lines_swapped(dice: random.Random, lines: list[bytes]) -> None:
    one, two = (dice.randrange(len(lines)) for _ in range(2))
    lines[one], lines[two] = lines[two], lines[one]


def _line_cut(dice: random.Random, lines: list[bytes]) -> None:
    place = dice.randrange(len(lines))
    whole = lines[place].rstrip(b"\r\n")
    lines[place] = whole[: dice.randrange(len(whole) + 1)] + lines[place][len(whole) :]


def _line_emptied(dice: random.Random, lines: list[bytes]) -> None:
    place = dice.randrange(len(lines))
    lines[place] = lines[place][len(lines[place].rstrip(b"\r\n")) :]


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
