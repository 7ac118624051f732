"""Lines of plugins in errors, also of their kernels in compiled code."""

import contextlib
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from mercator_design import jit
from mercator_design.errors import MercatorError, MissionError, described
from mercator_design.plugins.registries import defined, functions, is_ours

Kernel = Callable[..., Any]

_PACKAGE = Path(__file__).parents[1]


def first_line(function: Kernel) -> str:
    """The first line of a function of a plugin, as "my.py:7: "; empty for one of this package."""
    code = function.__code__
    return "" if is_ours(function) else f"{code.co_filename}:{code.co_firstlineno}: "


def line_of(error: BaseException) -> str:
    """The line of a plugin where an error occurred, as "my.py:7: "; empty if it occurred elsewhere."""
    frames = [(frame.filename, frame.lineno or 0) for frame in traceback.extract_tb(error.__traceback__)]
    return last_line(frames)


def last_line(places: Iterable[tuple[str, int]]) -> str:
    """The last place, file and line, that is in a plugin, as "my.py:7: "; empty if there is none."""
    known = {*functions(), *jit.marked()}
    files = {Path(each.__code__.co_filename).resolve() for each in known if not is_ours(each)}
    by_name = {file.name: file for file in files}
    reached = [(Path(file).resolve(), line) for file, line in places]
    found = [(file, line) for file, line in reached if file in files]
    # Compiled code from the cache names the file that it was compiled from, which may be a copy of the plugin.
    found = found or [
        (by_name[file.name], line)
        for file, line in reached
        if file.name in by_name and not file.is_relative_to(_PACKAGE) and "site-packages" not in file.parts
    ]
    return f"{found[-1][0]}:{found[-1][1]}: " if found else ""


@contextlib.contextmanager
def reporting_kernels(kernels: Mapping[Kernel, str], error: type[MercatorError] = MissionError) -> Iterator[None]:
    """Turn errors of kernels, if they are of plugins, into errors of a class that name the line.

    Args:
        kernels: The kernels that may run, each with what it is: "floor dynamic".
        error: The class.
    """
    try:
        yield
    except jit.CompilationError as failure:
        found = next((failure.others[kernel] for kernel in kernels if kernel in failure.others), failure)
        place = last_line(found.places) or _first_lines([each for each in kernels if each in failure.others])
        if not place:  # then it is our fault
            raise
        raise error(f"{place}a kernel that cannot be compiled: {found}") from None
    except MercatorError:
        raise
    except Exception as failure:
        place = line_of(failure)
        if not place and _is_compiled(failure):
            place = _first_lines(kernels)
        if not place:  # of no plugin's kernel
            raise
        raise error(f"{place}{_what(failure, kernels)}: {described(failure)}") from failure


def _what(failure: Exception, kernels: Mapping[Kernel, str]) -> str:
    """The kinds of the kernels of plugins of which one has failed."""
    codes = {frame.f_code for frame, _ in traceback.walk_tb(failure.__traceback__)}
    reached = {what: None for kernel, what in kernels.items() if defined(kernel).__code__ in codes}
    foreign = {what: None for kernel, what in kernels.items() if not is_ours(defined(kernel))}
    return " or ".join(reached or foreign)


def _is_compiled(failure: Exception) -> bool:
    """Whether an error is of compiled code, which tells no line of an index or a division."""
    is_compiled = traceback.extract_tb(failure.__traceback__)[-1].filename == jit.__file__
    return is_compiled and isinstance(failure, (IndexError, ZeroDivisionError))


def _first_lines(kernels: Collection[Kernel]) -> str:
    """The lines where kernels of plugins begin."""
    lines = [*dict.fromkeys(first_line(defined(kernel)) for kernel in kernels if not is_ours(defined(kernel)))]
    if len(lines) < 2:
        return "".join(lines)
    return f"one of {', '.join(line.removesuffix(': ') for line in lines)}: "
