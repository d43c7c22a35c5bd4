"""Kernels that only borrow arrays: no references are counted in them.

To count takes atomic operations at each row of a path that is looked at: half of what planning
took. The compiler refuses to borrow where arrays are made; such kernels say that they are `owning`
if a borrowing one calls them, else they would inherit its way.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from are_ros._compiled import OPTIONS

_Function = TypeVar("_Function", bound=Callable[..., Any])


def borrowing(function: _Function) -> _Function:
    """Compile, as `compiled` does, a kernel that makes no arrays."""
    return _compiled_with(function, counts=False)


def owning(function: _Function) -> _Function:
    """Compile, as `compiled` does, a kernel that makes arrays and that borrowing ones call."""
    return _compiled_with(function, counts=True)


def _compiled_with(function: _Function, *, counts: bool) -> _Function:
    return cast("_Function", numba.njit(**OPTIONS, _nrt=counts)(function))
