"""Checks that libraries have enough address space, if there is a limit (`ulimit -v`).

If memory is short, Python raises MemoryError; but OpenBLAS and LLVM, which numpy, scipy and numba use, end the process.
So their needs were measured, and are checked first.
"""

import os
import resource
from pathlib import Path

TO_IMPORT = 512 << 20
"""Bytes of address space for all imports of a verb: 430 MiB were measured."""
TO_LOAD = 64 << 20
"""Additional bytes to load machine code from the cache, with the start of LLVM: 35 MiB were measured."""
TO_COMPILE = 320 << 20
"""Additional bytes to compile the whole simulator: 210 MiB were measured."""


def prepare_for_libraries() -> None:
    """If there is a limit, check that libraries can be imported; call this before importing numpy.

    Raises:
        MemoryError: There is too little address space.
    """
    if (limit := _limit()) is None:
        return
    if limit < TO_IMPORT:
        raise MemoryError(
            f"expected a limit of address space of {TO_IMPORT >> 20} MiB at least, found {limit >> 20} MiB (ulimit -v)"
        )
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # it reserves memory for each thread


def require(needed: int, purpose: str) -> None:
    """Check that a number of bytes of address space are left.

    Raises:
        MemoryError: There is too little address space.
    """
    if (limit := _limit()) is None:
        return
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except OSError:  # not on Linux
        return
    if (left := limit - pages * os.sysconf("SC_PAGE_SIZE")) < needed:
        raise MemoryError(
            f"expected {needed >> 20} MiB of address space {purpose}, found {max(left, 0) >> 20} MiB below the "
            f"limit of {limit >> 20} MiB (ulimit -v)"
        )


def _limit() -> int | None:
    """The limit of address space in bytes; None if there is none."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    return None if limit == resource.RLIM_INFINITY else limit
