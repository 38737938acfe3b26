"""Ranks of warnings, and the merging of similar ones into one line.

A warning is a sentence, often preceded by a name (``cube 1.csv: ...``). The most serious begin with `DO_NOT_USE`,
remarks with `NOTE`; all others mean that a number needs checking. The rank is part of the text, so result files contain
it too. A sentence about several things, such as specimens, is shown once with their count; warnings that differ only in
numbers become one line that lists the numbers in order.

Public names: `do_not_use`, `warning`, `note`, `Caution`, `prefixed` and `ranked`. A result with a field
``tuple[Caution, ...]`` cannot contain a sentence without a rank: the type checker rejects it.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NewType

DO_NOT_USE, WARNING, NOTE = "do not use", "warning", "note"
RANKS = (DO_NOT_USE, WARNING, NOTE)
"""The ranks, the most serious first; a sentence without a stated rank has the middle one."""
_STATED = re.compile(rf"(?:(?<=: )|^)({DO_NOT_USE}|{NOTE}): ")
_NUMBER = re.compile(r"[-+−]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?", re.IGNORECASE)
_NAMES = 3  # parts before a sentence that may be names


@dataclass(frozen=True)
class _Warning:
    rank: str
    text: str

    def tails(self) -> list[tuple[str, str]]:
        """Return the possible names before a sentence, each with the remaining sentence, the fewest names first."""
        parts = self.text.split(": ")
        return [(": ".join(parts[:n]), ": ".join(parts[n:])) for n in range(min(_NAMES, len(parts) - 1) + 1)]


Caution = NewType("Caution", str)
"""A warning with an explicit rank."""


def do_not_use(text: str) -> Caution:
    """Make a warning that a number must not be used."""
    return Caution(f"{DO_NOT_USE}: {text}")


def warning(text: str) -> Caution:
    """Make a warning that a number needs checking before use."""
    return Caution(text)


def note(text: str) -> Caution:
    """Make a remark that requires no action."""
    return Caution(f"{NOTE}: {text}")


def prefixed(name: str, caution: Caution) -> Caution:
    """Prefix a warning with the name of its subject; it is unchanged if the name is empty."""
    return Caution(f"{name}: {caution}") if name else caution


def rank_of(text: str) -> str:
    """Return the rank stated in a warning, at its beginning or after its names."""
    match = _STATED.search(text)
    return match[1] if match else WARNING


def unranked(text: str) -> str:
    """Return a warning without its rank."""
    return _STATED.sub("", text, count=1)


def ranked(warnings: Iterable[str]) -> list[str]:
    """Return the lines to display with their ranks: the most serious first, each sentence once."""
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
    """Return the warnings that repeat the first for other subjects or with other numbers, and their common line."""
    named = (_of_sentence(group, sentence) for _, sentence in group[0].tails())
    return max((*named, _of_numbers(group)), key=lambda found: len(found[0]))


def _of_sentence(group: Sequence[_Warning], sentence: str) -> tuple[list[_Warning], str]:
    """Return the warnings with the same sentence after their names, and their common line."""
    found = {one: name for one in group for name, tail in one.tails() if tail == sentence}
    if len(found) == 1:
        return list(found), group[0].text
    return list(found), f"{len(found)} times ({', '.join(filter(None, found.values()))}): {sentence}"


def _of_numbers(group: Sequence[_Warning]) -> tuple[list[_Warning], str]:
    """Return the warnings that differ from the first only in numbers, and a line that lists the values that differ."""
    words = _NUMBER.split(group[0].text)
    alike = [one for one in group if _NUMBER.split(one.text) == words]
    if len(alike) == 1:
        return alike, group[0].text
    columns = zip(*(_NUMBER.findall(one.text) for one in alike), strict=True)
    shown = [numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers) for numbers in columns]
    text = "".join(word + number for word, number in zip(words, (*shown, ""), strict=True))
    return alike, f"{len(alike)} times: {text}"
