"""The sources of compiled code, and their digests.

numba itself does not notice an edited callee (numba issue 1833) and would run the old code. Kernels of this package are
told from those of plugins, tests and benchmarks: these are *foreign*.
"""

import contextlib
import enum
import hashlib
import json
import os
import types
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Any

Kernel = Callable[..., Any]

_PACKAGE = Path(__file__).parents[1]
_FOLDERS = ("compiling", "fsm", "missions", "modules", "network", "sim", "software", "tree")


def package_files() -> list[Path]:
    """The source files of this package from which the compiled code of experiments is made."""
    files = [file for folder in _FOLDERS for file in sorted((_PACKAGE / folder).rglob("*.py"))]
    return [*files, *(_PACKAGE / f"{name}.py" for name in ("seeds", "jit"))]


def is_foreign(kernel: Kernel) -> bool:
    """Whether a kernel is not of this package."""
    return not kernel.__code__.co_filename.startswith(f"{_PACKAGE}{os.sep}")


def _has_own_digest(kernel: Kernel) -> bool:
    """Whether a kernel is foreign or of the mapper, whose kernels no experiment runs: races do not depend on them."""
    return is_foreign(kernel) or kernel.__code__.co_filename.startswith(f"{_PACKAGE / 'mapping'}{os.sep}")


def sources(kernels: Iterable[Kernel]) -> dict[Path, bytes]:
    """The source files of kernels by path, with their contents when they were loaded, if these are known."""
    found: dict[Path, bytes] = {}
    for kernel in kernels:
        name = kernel.__code__.co_filename
        with contextlib.suppress(OSError):
            get_data = getattr(kernel.__globals__.get("__loader__"), "get_data", None)
            found[Path(name)] = get_data(name) if get_data else Path(name).read_bytes()
    return dict(sorted(found.items()))


def digest(files: Iterable[Path], foreign: Collection[Kernel]) -> str:
    """A digest of source files and of foreign kernels, as hexadecimal text."""
    found = {**{file: file.read_bytes() for file in files}, **sources(foreign)}
    digest = hashlib.sha256()
    for name, source in sorted((file.name, source) for file, source in found.items()):  # wherever the files are
        digest.update(name.encode() + b"\0" + source + b"\0")
    for text in sorted(map(_frozen, foreign)):
        digest.update(text.encode() + b"\0")
    return digest.hexdigest()


def foreign_part(entry: Kernel, marked: Collection[Kernel]) -> str:
    """A digest of the kernels of plugins or the mapper in the compiled form of an entry function; empty without them.

    `marked` are all functions that compiled code may call.
    """
    if not (_has_own_digest(entry) or any(map(_has_own_digest, marked))):
        return ""
    apart = [kernel for kernel in reached(entry, marked) if _has_own_digest(kernel)]
    return digest((), apart)[:16] if apart else ""


def renamed(kernel: Kernel, part: str) -> Kernel:
    """The kernel, named also by its digest: numba links the code of functions of one name as if it were the same."""
    copy = types.FunctionType(
        kernel.__code__, kernel.__globals__, kernel.__name__, kernel.__defaults__, kernel.__closure__
    )
    copy.__kwdefaults__, copy.__module__ = kernel.__kwdefaults__, kernel.__module__
    copy.__qualname__ = name_of(kernel, part)
    return copy


def name_of(kernel: Kernel, part: str) -> str:
    """What compiled code calls a kernel; arguments are those of `renamed`."""
    return f"{kernel.__qualname__}_{part}" if part else kernel.__qualname__


def reached(entry: Kernel, marked: Collection[Kernel]) -> list[Kernel]:
    """The functions in the compiled form of an entry function; arguments are those of `foreign_part`."""
    found = {entry: None}
    for kernel in (waiting := [entry]):
        new = [called for called in _named(kernel) if called in marked and called not in found]
        found.update(dict.fromkeys(new))
        waiting += new
    return list(found)


def origins(entry: Kernel, marked: Collection[Kernel]) -> set[str]:
    """The packages, such as math, whose modules and callables an entry function uses, also by functions that it calls.

    Arguments are those of `foreign_part`.
    """
    return {_origin(value) for kernel in reached(entry, marked) for value in _read(kernel).values()}


def _origin(value: object) -> str:
    owner = getattr(value, "__self__", value)
    name = owner.__name__ if isinstance(owner, types.ModuleType) else type(owner).__module__ if callable(value) else ""
    return name.partition(".")[0]


def _named(kernel: Kernel) -> list[Kernel]:
    """The functions that become a part of a kernel: those that it names, also in tables; of a dispatcher its links."""
    links = getattr(kernel, "links", None)
    values = list(_read(kernel).values() if links is None else links)
    values += [one for value in values if isinstance(value, (tuple, list)) for one in value]
    return [value for value in values if isinstance(value, types.FunctionType)]


def _read(kernel: Kernel) -> dict[str, Any]:
    """The globals and the variables of enclosing functions that a kernel reads, and what it reads of modules."""
    names = {name for code in _codes(kernel.__code__) for name in code.co_names}
    found = {name: kernel.__globals__[name] for name in names if name in kernel.__globals__}
    for name, cell in zip(kernel.__code__.co_freevars, kernel.__closure__ or (), strict=True):
        with contextlib.suppress(ValueError):  # it has no value yet
            found[name] = cell.cell_contents
    waiting = list(found.items())
    for path, value in waiting:
        if isinstance(value, types.ModuleType):
            new = {f"{path}.{name}": getattr(value, name) for name in names if hasattr(value, name)}
            waiting += [(one, new[one]) for one in new if one not in found and new[one] is not value]
            found |= new
    return found


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """A function's code, and that of the functions and comprehensions in it."""
    yield code
    for one in code.co_consts:
        if isinstance(one, types.CodeType):
            yield from _codes(one)


def _frozen(kernel: Kernel) -> str:
    """What is compiled of a kernel: its code, and the values that it reads."""
    values = sorted((name, value) for name, value in _read(kernel).items() if not isinstance(value, dict))
    codes = [(code.co_code.hex(), code.co_names, code.co_consts) for code in _codes(kernel.__code__)]
    defaults = [kernel.__defaults__, kernel.__kwdefaults__]
    return json.dumps([kernel.__qualname__, codes, defaults, values], default=_plain, skipkeys=True)


def _plain(value: Any) -> Any:
    """What JSON can say of a value that compiled code may have; None for anything else, such as a function."""
    if hasattr(value, "tolist") and hasattr(value, "dtype"):
        return value.tolist()
    if isinstance(value, (bytes, complex)):
        return repr(value)
    if isinstance(value, enum.Enum):
        return [value.name, value.value]
    return list(value) if isinstance(value, enum.EnumMeta) else None
