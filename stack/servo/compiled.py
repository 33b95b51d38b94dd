"""See `stack.compiled`."""

from stack.compiled import compiled

__all__ = ["compiled"]
