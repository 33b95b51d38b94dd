"""One way to compile a kernel: numba, cached on disk, IEEE arithmetic."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])

_ROOT = Path(__file__).resolve().parents[1]
_CHOSEN_BY_USER: str = numba.config.CACHE_DIR
"""NUMBA_CACHE_DIR, if set."""


@functools.cache
def _cache_directory(package: str) -> str:
    """A cache of its own for every state of a package's sources, e.g. of `stack/planner`.

    Numba looks only at the file of a kernel itself: after a change in a kernel that others call, it would go on running the old one.
    """
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted((_ROOT / package).rglob("*.py")):
        text = source.read_bytes()
        if b"@compiled" in text:
            digest.update(text)
    return str(_ROOT / ".cache" / "numba" / f"{package.replace('/', '-')}-{digest.hexdigest()[:16]}")


def compiled(function: F) -> F:
    """`function` compiled on first use and cached on disk; no reordering of floating-point operations.

    A kernel may call kernels of its own package only (`stack.planner`, `stack.servo`, …): the cache follows changes within it.
    The plain Python function stays reachable as `.py_func`.
    """
    if not _CHOSEN_BY_USER:
        numba.config.CACHE_DIR = _cache_directory("/".join(function.__module__.split(".")[:2]))
    return cast(F, numba.njit(cache=True, fastmath=False, error_model="numpy")(function))
