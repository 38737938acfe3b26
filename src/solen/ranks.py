"""Ranks of warnings, and the merging of similar ones into one line.

A warning is a sentence, often preceded by a name (``cube 1.csv: ...``). The most serious warnings begin with
`DO_NOT_USE`, notes with `NOTE`; all others mean that a value must be checked. The rank is part of the text, so that
result files contain it, too. A sentence about several subjects, such as specimens, is shown once with their count;
warnings that differ only in numbers become one line that lists the numbers in order.

Public names: `do_not_use`, `warning`, `note`, `Caution`, `prefixed` and `ranked`. A result with a field
``tuple[Caution, ...]`` cannot contain a sentence without a rank: the type checker rejects it.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NewType

DO_NOT_USE, WARNING, NOTE = "do not use", "warning", "note"
RANKS = (DO_NOT_USE, WARNING, NOTE)
"""The ranks, the most serious first; a sentence without an explicit rank has the middle one."""
_STATED = re.compile(rf"(?:(?<=: )|^)({DO_NOT_USE}|{NOTE}): ")
_NUMBER = re.compile(r"[-+−]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?", re.IGNORECASE)
_NAMES = 3  # maximum number of names before a sentence


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
    """Return a warning that a value must not be used."""
    return Caution(f"{DO_NOT_USE}: {text}")


def warning(text: str) -> Caution:
    """Return a warning that a value must be checked before use."""
    return Caution(text)


def note(text: str) -> Caution:
    """Return a note, which requires no action."""
    return Caution(f"{NOTE}: {text}")


def prefixed(name: str, caution: Caution) -> Caution:
    """Return a warning preceded by the name of its subject, or unchanged if the name is empty."""
    return Caution(f"{name}: {caution}") if name else caution


def rank_of(text: str) -> str:
    """Return the rank of a warning, which is at its beginning or after its names."""
    match = _STATED.search(text)
    return match[1] if match else WARNING


def unranked(text: str) -> str:
    """Return a warning without its rank."""
    return _STATED.sub("", text, count=1)


def ranked(warnings: Iterable[str]) -> list[str]:
    """Return the lines to display, with their ranks: the most serious first, and each sentence once."""
    every = [_Warning(rank_of(text), unranked(text)) for text in dict.fromkeys(warnings)]
    lines: list[str] = []
    for rank in RANKS:
        group = list(dict.fromkeys(item for item in every if item.rank == rank))
        while group:
            alike, line = _merged(group)
            lines.append(f"{rank}: {line}")
            group = [item for item in group if item not in alike]
    return lines


def _merged(group: Sequence[_Warning]) -> tuple[list[_Warning], str]:
    """Return the warnings that can be shown as one line with the first, including it, and that line.

    They have the same sentence about other subjects, or differ only in numbers, whichever replaces more warnings.
    """
    named = (_of_sentence(group, sentence) for _, sentence in group[0].tails())
    return max((*named, _of_numbers(group)), key=lambda candidate: len(candidate[0]))


def _of_sentence(group: Sequence[_Warning], sentence: str) -> tuple[list[_Warning], str]:
    """Return the warnings that contain a sentence, alone or after names, and the one line that replaces them."""
    candidate = {item: name for item in group for name, tail in item.tails() if tail == sentence}
    if len(candidate) == 1:
        return list(candidate), group[0].text
    return list(candidate), f"{len(candidate)} times ({', '.join(filter(None, candidate.values()))}): {sentence}"


def _of_numbers(group: Sequence[_Warning]) -> tuple[list[_Warning], str]:
    """Return the warnings that differ from the first only in numbers, and a line that lists the values that differ."""
    words = _NUMBER.split(group[0].text)
    alike = [item for item in group if _NUMBER.split(item.text) == words]
    if len(alike) == 1:
        return alike, group[0].text
    columns = zip(*(_NUMBER.findall(item.text) for item in alike), strict=True)
    shown = [numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers) for numbers in columns]
    text = "".join(word + number for word, number in zip(words, (*shown, ""), strict=True))
    return alike, f"{len(alike)} times: {text}"
