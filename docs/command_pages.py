"""Complete the page of a command with its usage, its options and the keys of its result."""

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

FIGURE_OPTIONS = {f"--{name.replace('_', '-')}" for name in FigureOptions.model_fields} - {"--figure"}
FIGURE_ENTRY = "`--width-mm`, `--letters`, `--panels` …\n: Size, lettering and panels: see [figures](../figures.md).\n"
COMMAND = "|".join(sorted(commands(), reverse=True))  # longer names before those that they begin with
CODE = rf"\bsolen (?:{COMMAND})\b|--[\w-]+|\S+=[\w.:,+-]*\w|\[\w+\]|[\w-]*\.[a-z3]\w+|\w*_\w+"
MARKED = re.compile(rf"`+(?P<quoted>[^`]+)`+|{CODE}|[*<>$|\\{{}}\[\]]")
"""Parts of a help text to be set as code, and characters to be escaped in Markdown."""


class Help:
    """Formatter that stores the help of a command instead of printing it."""

    def __init__(self) -> None:
        self.usage = ""
        self.entries: list[HelpEntry] = []

    def __call__(self, _console: Any, _options: Any, panel: HelpPanel) -> None:
        """Store the entries of a panel."""
        self.entries += panel.entries

    def render_usage(self, _console: Any, _options: Any, usage: Any) -> None:
        """Store the usage line."""
        self.usage = str(usage).strip()


def reference(page: str) -> str:
    """Return usage, options and result keys of the command with a given page: ``bench-analyse``."""
    command = page.replace("-", " ", 1)
    help_ = Help()
    app.help_formatter = cast(HelpFormatter, help_)
    app.help_print(command.split(), console=Console(file=io.StringIO()))
    options = [option(entry) for entry in help_.entries if not FIGURE_OPTIONS & set(entry.names)]
    if len(options) < len(help_.entries):
        options.append(FIGURE_ENTRY)
    parts = [f"## Options\n\n```text\n{help_.usage}\n```\n", *options]
    if result_type(commands()[command]) is not None:
        parts.append(
            f"## Keys of `--json`\n\n`solen schema {command}` prints the [schema](schema.md), with all nested keys.\n"
        )
        parts += keys(result_schema(tuple(command.split())))
    return "\n" + "\n".join(parts)


def option(entry: HelpEntry) -> str:
    """Return an option or argument with its help, choices and default."""
    description = str(entry.description.primary_renderable)
    facts = [
        "required" if entry.required else "",
        f"choices: {', '.join(entry.choices)}" if entry.choices else "",
        f"default: {entry.default}" if entry.default not in {None, "None", ""} else "",
    ]
    details = "; ".join(filter(None, facts))
    text = f"{description} ({details})" if details else description
    return f"`{' '.join(entry.display_labels_with_metavar)}`\n: {as_markdown(text)}\n"


def keys(schema: dict[str, Any]) -> Iterable[str]:
    """Yield the top-level keys of a result; keys with the same description are listed together."""
    texts: dict[str, str] = {}
    for kind in schema.get("anyOf", [schema]):
        texts |= {key: value.get("description", "") for key, value in kind["properties"].items()}
    groups: dict[str, list[str]] = {}
    for key, text in texts.items():
        groups.setdefault(f"\n: {as_markdown(text)}" if text else "", []).append(f"`{key}`")
    return (f"{', '.join(names)}{text}\n" for text, names in groups.items())


def as_markdown(text: str) -> str:
    """Return a plain text as one line of Markdown, with code marked and special characters escaped."""

    def marked(part: re.Match[str]) -> str:
        return f"`{part['quoted'] or part[0]}`" if len(part[0]) > 1 else f"\\{part[0]}"

    return MARKED.sub(marked, " ".join(text.split()))
