"""Typed access to numba's compiler, with the options that every kernel here shares."""

from collections.abc import Callable
from typing import Any, Final, TypeVar, cast

import numba

_Function = TypeVar("_Function", bound=Callable[..., Any])


OPTIONS: Final = {"cache": True, "nogil": True, "error_model": "numpy"}
"""Of every kernel."""


def compiled(function: _Function) -> _Function:
    """Compile a kernel to machine code on its first call, and keep it on disk.

    The cache lies beside the module, in NUMBA_CACHE_DIR when that is set, or in the user's cache
    directory when the package is not writable. Floating point stays strict (IEEE).
    """
    return cast("_Function", numba.njit(**OPTIONS)(function))
