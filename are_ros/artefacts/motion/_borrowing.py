"""Kernels that only borrow arrays: no references are counted in them.

To count takes atomic operations at each row of a path that is looked at: half of what planning
took. The compiler refuses to borrow where arrays are made; such kernels say that they are `owning`
if a borrowing one calls them, else they would inherit its way.
"""

from collections.abc import Callable
from typing import Any, TypeVar

from are_ros._compiled import compiled

_Function = TypeVar("_Function", bound=Callable[..., Any])


def borrowing(function: _Function) -> _Function:
    """Compile, as `compiled` does, a kernel that makes no arrays."""
    return compiled(function, _nrt=False)


def owning(function: _Function) -> _Function:
    """Compile, as `compiled` does, a kernel that makes arrays and that borrowing ones call."""
    return compiled(function, _nrt=True)
