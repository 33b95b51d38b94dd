"""What a run on a real wire is made of: which bus, which roles, whose time."""

from __future__ import annotations

import contextlib
import gc
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from config.errors import ConfigError
from drivers.catalogue import DRIVE_IDS

ROLES = ("sim", "planner", "strategic")
NS_PER_S = 1_000_000_000
SWITCH_INTERVAL_S = 2e-4
"""Threads of libraries, should there be any, give way to the loop after so long."""


@dataclass(frozen=True)
class Wire:
    """Where the run takes place and what of it. `roles` in this process; `absent`: drives that somebody else brings.

    `pace`: seconds of the run in a second of real time, the same in every process. Below 1 for machines that are too slow.
    """

    url: str
    roles: tuple[str, ...] = ROLES
    absent: frozenset[int] = frozenset()
    pace: float = 1.0


def external_parts(names: tuple[str, ...]) -> tuple[tuple[str, ...], frozenset[int]]:
    """`--external planner --external 21,22` -> (roles that stay, drives that are left out). Raises ConfigError."""
    roles, absent = list(ROLES), set()
    for name in (part.strip() for names_ in names for part in names_.split(",")):
        if name in ("planner", "strategic"):
            roles = [role for role in roles if role != name]
        elif name.isdecimal() and int(name) in DRIVE_IDS:
            absent.add(int(name))
        else:
            drives = ", ".join(map(str, DRIVE_IDS))
            raise ConfigError(f"--external {name!r}: must be planner, strategic, or a drive's node id ({drives})")
    return tuple(roles), frozenset(absent)


def run_time(pace: float) -> Callable[[], int]:
    """The monotonic clock, slowed down to `pace`, from a whole second on: processes on one machine have one grid of cycles."""
    if not 0.0 < pace <= 1.0:
        raise ConfigError(f"--pace {pace:g}: must be positive, and at most 1 on a real wire")
    if pace == 1.0:
        start_ns = time.monotonic_ns() // NS_PER_S * NS_PER_S
        return lambda: time.monotonic_ns() - start_ns
    slow_start_ns = round(time.monotonic_ns() * pace) // NS_PER_S * NS_PER_S
    return lambda: round(time.monotonic_ns() * pace) - slow_start_ns


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """What was loaded is never looked at by the collector again, and no other thread keeps the interpreter for long."""
    interval_s = sys.getswitchinterval()
    gc.freeze()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(interval_s)
        gc.unfreeze()
