"""What to write instead of what cannot be compiled: numba's messages in the words of this program."""

import re

_SUBSET = "kernels have floats, tuples, rows of numbers, `if`, `for`, `while`, and functions of math"
_ADVICE = (
    (
        r"Unknown attribute '(\w+)' of type Module\(<module '(\w+)'",
        r"\2.\1 cannot be compiled; use functions such as math.sqrt, atan2, sin, cos, exp, log, floor, min, max, abs",
    ),
    (
        r"Unknown attribute '(\w+)' of type (Readings|ReferenceModel|Actions)\b",
        r"\2 has no field \1; its fields are {fields}",
    ),
    (
        r"Unknown attribute '(?:left|right|led_colour|signal)'",
        "a behaviour returns Actions, as drive(left, right) makes them",
    ),
    (r"Unknown attribute '(\w+)'", r"nothing here has the name \1; " + _SUBSET),
    (
        r"Untyped global name '(\w+)'.*(?:<class 'function'>|<class 'builtin_function_or_method'>)",
        r"\1 is a function that cannot be called from compiled code: mark it with @jittable (mercator_design.jit)",
    ),
    (r"Untyped global name '(\w+)'", r"a kernel can read global numbers and tuples of numbers, and not \1"),
    (r"NameError: name '(\w+)' is not defined|global name '(\w+)' is not defined", r"\1 is not defined"),
    (r"[Uu]ndefined variable '?(\w+)", r"give the variable a value on every way to this line"),
    (
        r"Can't unify return type",
        "return the same kind of value on every way: a behaviour Actions, a condition a float",
    ),
    (r"Cannot unify", "give the variable one type on every way: 1.0 is a float, 1 an integer, a tuple has one length"),
    (
        r"must not make arrays, lists or texts",
        "keep numbers in the rows that it is given, such as `memory`, and use tuples of numbers",
    ),
    (r"setitem>?\) found|setitem\(array", "rows hold floats; a condition returns one number, its probability"),
    (
        r"unsupported opcode|context-manager|exception_match|\byield\b|generator",
        "kernels have no import, class, try, with, yield or async; " + _SUBSET,
    ),
    (
        r"\b[Dd]ict|\blist\b|\bset\b|unicode|reflected|returning of array",
        "kernels have no lists, dictionaries, sets or texts; " + _SUBSET,
    ),
    (r"it returns", "end without a value"),
)


def reason_of(text: str) -> str:
    """The reason in a message of numba, without the lines of code, which the place of the error names."""
    innermost = re.split(r"\(step: [^)]*\)", text)[-1]  # of the kernels, each called by the one before
    reason = re.split(
        r" During: | File \"| \(/| Raised from | There are \d+ candidate|This is not usually a problem",
        " ".join(innermost.split()),
    )[0]
    reason = re.sub(r"(of type Module\(<module '\w+').*", r"\1>)", reason)
    reason = re.sub(r"(of type (?:Readings|ReferenceModel|Actions))\(.*", r"\1", reason)
    if "NRT required" in text:
        return "a kernel must not make arrays, lists or texts, or raise an error with a value"
    return reason[:300].rstrip(" :-*")


def advised(reason: str) -> str:
    """A reason with what to write instead."""
    for pattern, advice in _ADVICE:
        if found := re.search(pattern, reason):
            words = found.expand(advice)
            return f"{reason}: {words.format(fields=_fields(words))}" if "{fields}" in words else f"{reason}: {words}"
    return f"{reason}: {_SUBSET}"


def _fields(words: str) -> str:
    """The fields of what numba knows by the name of its class."""
    import importlib

    kind = getattr(importlib.import_module("mercator_design.modules.reference"), words.partition(" ")[0])
    return ", ".join(kind._fields)
