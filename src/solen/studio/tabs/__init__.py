"""Tabs of the page beside the design: a module each, which lists the commands that it offers.

A module states ``OFFERS``, and `suits`, the names of those that take a dropped file, the likeliest first.
"""

import importlib
from pathlib import Path
from types import ModuleType

from solen.errors import SpecError
from solen.studio.offers import Offer

TABS = ("resin", "print", "microscope", "bench")
"""Names of the tabs, and of their modules here."""


def tab(name: str) -> ModuleType:
    """Module of a tab; `SpecError` for any other name."""
    if name not in TABS:
        raise SpecError("tab", value=name, limit=f"is none of {', '.join(TABS)}")
    return importlib.import_module(f"{__name__}.{name}")


def offers_of(name: str) -> tuple[Offer, ...]:
    """Commands that a tab offers."""
    found: tuple[Offer, ...] = tab(name).OFFERS
    return found


def offer(name: str) -> Offer:
    """An offered command by its name; `SpecError` where there is none."""
    for each in TABS:
        for one in offers_of(each):
            if one.name == name:
                return one
    raise SpecError("command", value=name, limit="is offered by no tab")


def suitable(name: str, path: Path) -> tuple[str, ...]:
    """Names of a tab's commands that take a file, the likeliest first."""
    found: tuple[str, ...] = tab(name).suits(path)
    return found
