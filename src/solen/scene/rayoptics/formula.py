r"""One-line formulas as ray-optics writes them: LaTeX, or plain text as in a spreadsheet. Formulas are never executed.

A formula is divided into tokens and parsed by recursive descent into nested functions of its variables. It can refer
only to the variables, the constants pi and e, and the functions listed here; it has no access to the program.

Supported are + − * / ^, ``\cdot``, ``\times``, ``\frac{a}{b}``, ``\sqrt{a}``, ``\sqrt[n]{a}``, brackets of every kind,
\|a\|, comparisons (1 or 0), ``and``, ``or``, ``not``, and products without a sign, such as 2x. Multiplication and
division are evaluated from left to right, so 1/2x means (1/2)x; a power binds more tightly than a preceding minus.
Angles are in radians. Where a function is undefined, such as the root of a negative number, the value is NaN.
"""

import functools
import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, NoReturn

from solen.errors import DataError

Values = Mapping[str, float]
Node = Callable[[Values], float]
Function = Callable[..., float]

MAX_TOKENS = 400
"""Maximum number of tokens in a formula."""
MAX_DEPTH = 60
"""Maximum nesting depth of brackets."""

CONSTANTS = {"pi": math.pi, "e": math.e}
FUNCTIONS: dict[str, Function] = {
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "sec": lambda x: 1.0 / math.cos(x),
    "csc": lambda x: 1.0 / math.sin(x),
    "cot": lambda x: 1.0 / math.tan(x),
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
    "sech": lambda x: 1.0 / math.cosh(x),
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "atan2": math.atan2,
    "asinh": math.asinh,
    "acosh": math.acosh,
    "atanh": math.atanh,
    "log": math.log,
    "exp": math.exp,
    "sqrt": math.sqrt,
    "abs": abs,
    "floor": math.floor,
    "ceil": math.ceil,
    "round": lambda x: math.floor(x + 0.5),
    "trunc": math.trunc,
    "sign": lambda x: math.copysign(1.0, x) if x else 0.0,
    "max": max,
    "min": min,
}
ALIASES = {
    **{f"arc{name}": f"a{name}" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "ln": "log",
    "sgn": "sign",
}
VARIADIC = ("max", "min")
TWO_ARGUMENTS = ("atan2",)
BINARY: tuple[dict[str, Function], ...] = (
    {"or": lambda a, b: bool(a) or bool(b)},
    {"and": lambda a, b: bool(a) and bool(b)},
    {
        "==": operator.eq,
        "!=": operator.ne,
        "<=": operator.le,
        ">=": operator.ge,
        "<": operator.lt,
        ">": operator.gt,
    },
    {"+": operator.add, "-": operator.sub},
)
"""Binary operators in order of increasing precedence, except products and powers."""
NEGATION = 2
"""Precedence of ``not``."""
LATEX_SIGNS = {"cdot": "*", "times": "*", "lt": "<", "gt": ">", "le": "<=", "ge": ">="}
CLOSING = {"(": ")", "{": "}", "[": "]", "|": "|"}
NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
TOKEN = re.compile(
    r"(?P<space>\s+|\\[ ,;:!]|\\left\b|\\right\b|\\left(?=[^a-zA-Z])|\\right(?=[^a-zA-Z]))"
    r"|(?P<number>(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)"
    r"|\\(operatorname|mathrm)\s*\{\s*(?P<operator>[A-Za-z]+)\s*\}"
    r"|\\(?P<command>[A-Za-z]+)"
    r"|(?P<name>[A-Za-z][A-Za-z0-9]*(_(\{[A-Za-z0-9]+\}|[A-Za-z0-9]+))*)"
    r"|(?P<sign>==|!=|<=|>=|[-+*/^(){}\[\]|,<>])"
)


class Token(NamedTuple):
    """A token: its kind (number, name, sign or end), its text without LaTeX, and its position."""

    kind: str
    text: str
    at: int


@dataclass(frozen=True)
class Formula:
    """A parsed formula; call it with the values of its variables."""

    text: str
    node: Node

    def __call__(self, **values: float) -> float:
        """Return the value of the formula, or NaN if it is undefined there."""
        return self.node(values)


def parse(text: str, variables: Sequence[str] = (), functions: Mapping[str, Function] | None = None) -> Formula:
    """Parse a formula in these variables; ``functions`` contains further functions, keyed by name.

    Raises
    ------
    DataError
        If the text is not a formula or contains an unknown name; the message gives the position.
    """
    reader = _Reader(text, set(variables), {**FUNCTIONS, **(functions or {})})
    return Formula(text, reader.formula())


def _tokens(text: str) -> list[Token]:
    tokens: list[Token] = []
    at = 0
    while at < len(text):
        match = TOKEN.match(text, at)
        if match is None:
            _refuse(text, at, text[at], "is not part of a formula")
        kind, value = next((name, value) for name, value in match.groupdict().items() if value is not None)
        if kind in ("command", "operator"):
            kind, value = ("sign", LATEX_SIGNS[value]) if value in LATEX_SIGNS else ("name", value)
        elif kind == "name":
            value = value.replace("{", "").replace("}", "")
        if kind != "space":
            tokens.append(Token(kind, value, at))
        at = match.end()
        if len(tokens) > MAX_TOKENS:
            _refuse(text, at, f"more than {MAX_TOKENS} tokens", "the formula is too long")
    return [*tokens, Token("end", "", len(text))]


def _refuse(text: str, at: int, token: str, limit: str) -> NoReturn:
    shown = text if len(text) <= 60 else f"{text[:57]}..."
    raise DataError(f"formula {shown!r} at character {at + 1}", value=token or "its end", limit=limit)


class _Reader:
    """Recursive-descent parser with one method for each precedence level."""

    def __init__(self, text: str, variables: set[str], functions: Mapping[str, Function]) -> None:
        self.text = text
        self.variables = variables
        self.functions = functions
        self.tokens = _tokens(text)
        self.next = 0
        self.depth = 0

    def formula(self) -> Node:
        node = self.binary()
        if self.token.kind != "end":
            self.refuse("is not allowed here")
        return node

    @property
    def token(self) -> Token:
        return self.tokens[self.next]

    def refuse(self, limit: str) -> NoReturn:
        _refuse(self.text, self.token.at, self.token.text, limit)

    def take(self, *texts: str) -> str | None:
        """If the next token is one of these signs or words, consume it and return its text."""
        if self.token.kind in ("sign", "name") and self.token.text in texts:
            self.next += 1
            return self.tokens[self.next - 1].text
        return None

    def expect(self, text: str) -> None:
        if self.take(text) is None:
            self.refuse(f"must be {text}")

    def binary(self, level: int = 0) -> Node:
        """Parse the left-associative binary operators of one precedence level, such as + and −."""
        if level == len(BINARY):
            return self.product()
        if level == NEGATION and self.take("not"):
            return _called(operator.not_, self.binary(level))
        node = self.binary(level + 1)
        while (sign := self.take(*BINARY[level])) is not None:
            node = _called(BINARY[level][sign], node, self.binary(level + 1))
        return node

    def product(self) -> Node:
        """Parse a product such as a * b / c d."""
        node = self.signed()
        while True:
            sign = self.take("*", "/")
            if sign is None and not self.begins_factor():
                return node
            node = _called(
                operator.truediv if sign == "/" else operator.mul, node, self.signed() if sign else self.power()
            )

    def begins_factor(self) -> bool:
        """Whether a factor follows without a preceding sign."""
        token = self.token
        if token.kind == "name":
            return token.text not in ("and", "or", "not")
        return token.kind == "number" or (token.kind == "sign" and token.text in "({[")

    def signed(self) -> Node:
        """Parse a factor with any number of signs before it."""
        negative = False
        while (sign := self.take("+", "-")) is not None:
            negative ^= sign == "-"
        node = self.power()
        return _called(operator.sub, _constant(0.0), node) if negative else node

    def power(self) -> Node:
        """Parse a power such as a ^ b, which is right-associative."""
        node = self.atom()
        if self.take("^"):
            return _called(math.pow, node, self.signed_power())
        return node

    def signed_power(self) -> Node:
        if self.take("-"):
            return _called(operator.sub, _constant(0.0), self.signed_power())
        return self.power()

    def atom(self) -> Node:
        """Parse a number, a name with its arguments, or an expression in brackets."""
        token = self.token
        if token.kind == "number":
            self.next += 1
            return _constant(float(token.text))
        if token.kind == "sign" and token.text in CLOSING:
            return self.bracket()
        if token.kind != "name":
            self.refuse("must be a number, a name or a bracket")
        self.next += 1
        return self.named(token)

    def bracket(self) -> Node:
        """Parse the content of the next bracket."""
        bracket_sign = self.take(*CLOSING)
        if bracket_sign is None:
            self.refuse("must be a bracket")
        self.depth += 1
        if self.depth > MAX_DEPTH:
            self.refuse(f"is nested in more than {MAX_DEPTH} brackets")
        node = self.binary()
        self.depth -= 1
        self.expect(CLOSING[bracket_sign])
        return _called(abs, node) if bracket_sign == "|" else node

    def named(self, token: Token) -> Node:
        """Parse a variable, a constant, or a function with its arguments."""
        name = ALIASES.get(token.text, token.text)
        if name in self.variables:
            return _variable(name)
        if name == "frac":
            return _called(operator.truediv, self.group(), self.group())
        if name == "sqrt" and self.token.text == "[":
            degree = self.bracket()
            return _called(math.pow, self.group(), _called(operator.truediv, _constant(1.0), degree))
        if name in self.functions:
            return self.call(name)
        if name in CONSTANTS:
            return _constant(CONSTANTS[name])
        if len(name) > 1 and all(letter in self.variables or letter in CONSTANTS for letter in name):
            return self.letters(name)
        known = ", ".join(sorted(self.variables)) or "no variables"
        _refuse(
            self.text, token.at, token.text, f"is unknown; the known names are {known}, pi, e and the usual functions"
        )

    def letters(self, name: str) -> Node:
        """Parse a product of variables written without signs."""
        nodes = [_variable(i) if i in self.variables else _constant(CONSTANTS[i]) for i in name]
        return functools.reduce(lambda a, b: _called(operator.mul, a, b), nodes)

    def group(self) -> Node:
        """Parse an expression in braces."""
        if self.token.text != "{":
            self.refuse("must be {")
        return self.bracket()

    def call(self, name: str) -> Node:
        """Parse a function and its arguments; a single argument needs no brackets. ``sin^2 x`` is the squared sine."""
        exponent = self.atom() if self.take("^") else None
        if self.take("("):
            arguments = [self.binary()]
            while self.take(","):
                arguments.append(self.binary())
            self.expect(")")
        else:
            arguments = [self.atom()]
        least = 2 if name in (*VARIADIC, *TWO_ARGUMENTS) else 1
        if name in FUNCTIONS and (len(arguments) < least or (len(arguments) > least and name not in VARIADIC)):
            takes = ("one argument", "two arguments")[least - 1] + " or more" * (name in VARIADIC)
            self.refuse(f"{name} takes {takes}, not {len(arguments)}")
        node = _called(self.functions[name], *arguments)
        return node if exponent is None else _called(math.pow, node, exponent)


def _constant(value: float) -> Node:
    return lambda _: value


def _variable(name: str) -> Node:
    return lambda values: values[name]


def _called(function: Function, *arguments: Node) -> Node:
    def value(values: Values) -> float:
        try:
            return float(function(*(argument(values) for argument in arguments)))
        except (ArithmeticError, ValueError):
            return math.nan

    return value


def number_in(value: Any) -> float | None:
    """Return a number, or the value of a string that ray-optics accepts as a number; None for any other value."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    if isinstance(value, str) and not NUMBER.fullmatch(value):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf
