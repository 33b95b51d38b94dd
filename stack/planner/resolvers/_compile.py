"""The one place where numba's untyped decorator meets the type checker: kernels are `Any` to the outside."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit  # type: ignore[import-untyped]


def kernel(function: Callable[..., Any]) -> Any:
    """Compile to machine code on the first call, kept on disk; IEEE arithmetic in the order written (no fastmath)."""
    return njit(cache=True, fastmath=False)(function)
