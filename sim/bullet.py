"""PyBullet itself, without what it prints: the only file that imports it."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def quiet() -> Iterator[None]:
    """Send what C code writes to standard output and standard error to nowhere (build line, warnings of the loader).

    Python's exceptions are not affected.
    """
    libc = ctypes.CDLL(None)
    sys.stdout.flush()
    sys.stderr.flush()
    libc.fflush(None)
    kept, nowhere = (os.dup(1), os.dup(2)), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        libc.fflush(None)  # before the descriptors are the user's again, or the text would come out at exit
        for descriptor, saved in zip((1, 2), kept, strict=True):
            os.dup2(saved, descriptor)
            os.close(saved)
        os.close(nowhere)


with quiet():
    import pybullet

__all__ = ["pybullet", "quiet"]
