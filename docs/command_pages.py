"""Adds to the page of a command what the command itself declares: usage, options, and the keys of its result."""

import io
import re
from collections.abc import Iterable
from typing import Any, cast

from cyclopts.help import HelpEntry, HelpPanel
from cyclopts.help.protocols import HelpFormatter
from rich.console import Console

from solen.cli.app import app
from solen.cli.design.schema import commands, result_schema, result_type
from solen.report.options import FigureOptions

LOOK = {f"--{name.replace('_', '-')}" for name in FigureOptions.model_fields} - {"--figure"}
SAME = "`--width-mm`, `--letters`, `--panels` …\n: Size, lettering and panels: [figures](../figures.md).\n"
COMMAND = "|".join(sorted(commands(), reverse=True))  # the longer of two that begin alike first
TYPED = rf"\bsolen (?:{COMMAND})\b|--[\w-]+|\S+=[\w.:,+-]*\w|\[\w+\]|[\w-]*\.[a-z3]\w+|\w*_\w+"
MARKED = re.compile(rf"`+(?P<quoted>[^`]+)`+|{TYPED}|[*<>$|\\{{}}\[\]]")
"""Words of a help text that are typed, and characters that Markdown would read as its own."""


class Help:
    """Keeps what the help of a command would print."""

    def __init__(self) -> None:
        self.usage = ""
        self.entries: list[HelpEntry] = []

    def __call__(self, _console: Any, _options: Any, panel: HelpPanel) -> None:
        """Keep the entries of a panel."""
        self.entries += panel.entries

    def render_usage(self, _console: Any, _options: Any, usage: Any) -> None:
        """Keep the line of usage."""
        self.usage = str(usage).strip()


def reference(page: str) -> str:
    """Usage, options and keys of the command that a page is called after: ``bench-analyse``."""
    command = page.replace("-", " ", 1)
    shown = Help()
    app.help_formatter = cast(HelpFormatter, shown)
    app.help_print(command.split(), console=Console(file=io.StringIO()))
    options = [option(entry) for entry in shown.entries if not LOOK & set(entry.names)]
    if len(options) < len(shown.entries):
        options.append(SAME)
    parts = [f"## Options\n\n```text\n{shown.usage}\n```\n", *options]
    if result_type(commands()[command]) is not None:
        parts.append(
            f"## Keys of `--json`\n\n`solen schema {command}` prints the [schema](schema.md), with all inner keys.\n"
        )
        parts += keys(result_schema(tuple(command.split())))
    return "\n" + "\n".join(parts)


def option(entry: HelpEntry) -> str:
    """An option or argument with its help, choices and default."""
    words = str(entry.description.primary_renderable)
    facts = [
        "required" if entry.required else "",
        f"choices: {', '.join(entry.choices)}" if entry.choices else "",
        f"default: {entry.default}" if entry.default not in {None, "None", ""} else "",
    ]
    stated = "; ".join(filter(None, facts))
    return (
        f"`{' '.join(entry.display_labels_with_metavar)}`\n: {readable(f'{words} ({stated})' if stated else words)}\n"
    )


def keys(schema: dict[str, Any]) -> Iterable[str]:
    """Keys of a result at its top level; those of one description stand together."""
    texts: dict[str, str] = {}
    for kind in schema.get("anyOf", [schema]):
        texts |= {key: value.get("description", "") for key, value in kind["properties"].items()}
    groups: dict[str, list[str]] = {}
    for key, text in texts.items():
        groups.setdefault(f"\n: {readable(text)}" if text else "", []).append(f"`{key}`")
    return (f"{', '.join(names)}{text}\n" for text, names in groups.items())


def readable(text: str) -> str:
    """A plain text in one line of Markdown: what is typed as code, other characters as they are."""

    def marked(part: re.Match[str]) -> str:
        return f"`{part['quoted'] or part[0]}`" if len(part[0]) > 1 else f"\\{part[0]}"

    return MARKED.sub(marked, " ".join(text.split()))
