"""Ranks of warnings, and how many of one kind become one line.

The idea: a warning is a sentence, often with a name before it (``cube 1.csv: ...``). What must not be used begins with
`DO_NOT_USE`, what need not be acted on with `NOTE`; every other sentence is worth a look. The words are in the text,
so files of results hold them too. One sentence of several things, such as of each specimen, is shown once with their
count; sentences that differ in numbers alone are the same one, shown with the first's.

The interface: `do_not_use` and `note` state a rank, `ranked` sorts and groups warnings for a reader.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

DO_NOT_USE, LOOK_AT, NOTE = "do not use", "warning", "note"
RANKS = (DO_NOT_USE, LOOK_AT, NOTE)
"""The most serious first; the middle one is that of a sentence that states none."""
_STATED = re.compile(rf"(?:(?<=: )|^)({DO_NOT_USE}|{NOTE}): ")
_NUMBER = re.compile(r"[-+−]?\d+(?:[.,]\d+)*(?:e[-+]?\d+)?", re.IGNORECASE)
_NAMES = 3  # parts before a sentence that may be names
_SHOWN = 4  # names in one line


@dataclass(frozen=True)
class _Warning:
    rank: str
    text: str

    def tails(self) -> list[tuple[str, str]]:
        """What may be names, and the sentence behind them, the fewest names first."""
        parts = self.text.split(": ")
        return [(": ".join(parts[:n]), ": ".join(parts[n:])) for n in range(min(_NAMES, len(parts) - 1) + 1)]


def do_not_use(text: str) -> str:
    """Warning of a number that must not be used."""
    return f"{DO_NOT_USE}: {text}"


def note(text: str) -> str:
    """Remark that asks for nothing."""
    return f"{NOTE}: {text}"


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
        group = [one for one in every if one.rank == rank]
        while group:
            alike = _alike(group)
            lines.append(f"{rank}: {_line(alike)}")
            group = [one for one in group if all(one is not each for each, _, _ in alike)]
    return lines


def _alike(group: Sequence[_Warning]) -> list[tuple[_Warning, str, str]]:
    """The first warning and those that say the same of something else, each with its name and sentence."""
    return max((_of_kind(group, name, sentence) for name, sentence in group[0].tails()), key=len)


def _of_kind(group: Sequence[_Warning], name: str, sentence: str) -> list[tuple[_Warning, str, str]]:
    """Warnings whose sentence behind their names is that of the first but for numbers."""
    kind, found = _NUMBER.sub("#", sentence), [(group[0], name, sentence)]
    for one in group[1:]:
        found += [(one, other, tail) for other, tail in one.tails() if _NUMBER.sub("#", tail) == kind][:1]
    return found


def _line(alike: Sequence[tuple[_Warning, str, str]]) -> str:
    _, first, sentence = alike[0]
    if len(alike) == 1:
        return alike[0][0].text
    names = [name for _, name, _ in alike if name]
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    whose = ", ".join(names[:_SHOWN]) + more
    differs = any(tail != sentence for _, _, tail in alike)
    numbers = f"numbers of {first or 'the first'}" if differs else ""
    return f"{len(alike)} times ({'; '.join(filter(None, (whose, numbers)))}): {sentence}"
