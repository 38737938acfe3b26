"""Ranks of warnings, and how many of one kind become one line.

The idea: a warning is a sentence, often with a name before it (``cube 1.csv: ...``). What must not be used begins with
`DO_NOT_USE`, what need not be acted on with `NOTE`; every other sentence is worth a look. The words are in the text,
so files of results hold them too. One sentence of several things, such as of each specimen, is shown once with their
count; warnings that differ in numbers alone are one line that lists the numbers, in one order.

The interface: `do_not_use`, `look_at` and `note` make a `Caution` of a sentence, `of` puts a name before it; `ranked`
sorts and groups warnings for a reader. A result that holds ``tuple[Caution, ...]`` takes no sentence without a rank:
the type checker refuses it.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NewType

DO_NOT_USE, LOOK_AT, NOTE = "do not use", "warning", "note"
RANKS = (DO_NOT_USE, LOOK_AT, NOTE)
"""The most serious first; the middle one is that of a sentence that states none."""
_STATED = re.compile(rf"(?:(?<=: )|^)({DO_NOT_USE}|{NOTE}): ")
_NUMBER = re.compile(r"[-+−]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?", re.IGNORECASE)
_NAMES = 3  # parts before a sentence that may be names


@dataclass(frozen=True)
class _Warning:
    rank: str
    text: str

    def tails(self) -> list[tuple[str, str]]:
        """Possible names, and the sentence behind them, the fewest names first."""
        parts = self.text.split(": ")
        return [(": ".join(parts[:n]), ": ".join(parts[n:])) for n in range(min(_NAMES, len(parts) - 1) + 1)]


Caution = NewType("Caution", str)
"""A warning whose rank somebody chose."""


def do_not_use(text: str) -> Caution:
    """Warning of a number that must not be used."""
    return Caution(f"{DO_NOT_USE}: {text}")


def look_at(text: str) -> Caution:
    """Warning of a number that is to be looked at before it is used."""
    return Caution(text)


def note(text: str) -> Caution:
    """Remark that asks for nothing."""
    return Caution(f"{NOTE}: {text}")


def of(name: str, caution: Caution) -> Caution:
    """A warning with the name of what it is about before it; with no name, as it is."""
    return Caution(f"{name}: {caution}") if name else caution


def rank_of(text: str) -> str:
    """Rank that a warning states, at its beginning or behind the names that it begins with."""
    found = _STATED.search(text)
    return found[1] if found else LOOK_AT


def unranked(text: str) -> str:
    """A warning without its rank."""
    return _STATED.sub("", text, count=1)


def ranked(warnings: Iterable[str]) -> list[str]:
    """Lines for a reader, each with its rank: the most serious first, one sentence once."""
    every = [_Warning(rank_of(text), unranked(text)) for text in dict.fromkeys(warnings)]
    lines: list[str] = []
    for rank in RANKS:
        group = list(dict.fromkeys(one for one in every if one.rank == rank))
        while group:
            alike, line = _merged(group)
            lines.append(f"{rank}: {line}")
            group = [one for one in group if one not in alike]
    return lines


def _merged(group: Sequence[_Warning]) -> tuple[list[_Warning], str]:
    """Warnings that say the same as the first, of something else or in other numbers, and their line."""
    named = (_of_sentence(group, sentence) for _, sentence in group[0].tails())
    return max((*named, _of_numbers(group)), key=lambda found: len(found[0]))


def _of_sentence(group: Sequence[_Warning], sentence: str) -> tuple[list[_Warning], str]:
    """Warnings of one sentence behind their names."""
    found = {one: name for one in group for name, tail in one.tails() if tail == sentence}
    if len(found) == 1:
        return list(found), group[0].text
    return list(found), f"{len(found)} times ({', '.join(filter(None, found.values()))}): {sentence}"


def _of_numbers(group: Sequence[_Warning]) -> tuple[list[_Warning], str]:
    """Warnings whose whole text is that of the first but for numbers; all that differ are listed in its place."""
    words = _NUMBER.split(group[0].text)
    alike = [one for one in group if _NUMBER.split(one.text) == words]
    if len(alike) == 1:
        return alike, group[0].text
    columns = zip(*(_NUMBER.findall(one.text) for one in alike), strict=True)
    shown = [numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers) for numbers in columns]
    text = "".join(word + number for word, number in zip(words, (*shown, ""), strict=True))
    return alike, f"{len(alike)} times: {text}"
