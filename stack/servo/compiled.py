"""One way to compile a kernel: numba, cached on disk, IEEE arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """`function` compiled on first use and cached beside its file; no reordering of floating-point operations.

    The plain Python function stays reachable as `.py_func`. Numba watches only the file of the kernel itself: after a
    change in a kernel that others call, remove `stack/**/__pycache__/*.nb?`.
    """
    return cast(F, numba.njit(cache=True, fastmath=False, error_model="numpy")(function))
