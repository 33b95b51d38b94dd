"""PyBullet itself, without what it prints: the only file that imports it."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """Send what C code writes to standard output to nowhere (PyBullet announces its build and warns by printf)."""
    sys.stdout.flush()
    libc = ctypes.CDLL(None)
    libc.fflush(None)
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        libc.fflush(None)  # before descriptor 1 is the user's again, or the text would come out at exit
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


with quiet_stdout():
    import pybullet

__all__ = ["pybullet", "quiet_stdout"]
