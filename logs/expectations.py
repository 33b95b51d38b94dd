"""What a scenario promises of its metrics, and whether it was kept."""

from __future__ import annotations

import difflib
import operator
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

Operator = Literal["<=", ">=", "<", ">", "=="]
_COMPARE = {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt, "==": operator.eq}


@dataclass(frozen=True, slots=True)
class Expectation:
    """`metric` (dotted into metrics.json, e.g. `limit_violations.position`) `op` `bound`."""

    metric: str
    op: Operator
    bound: float

    def __post_init__(self) -> None:
        if self.op not in _COMPARE:
            raise ValueError(f"expectation of {self.metric}: op {self.op!r} must be one of {', '.join(_COMPARE)}")


@dataclass(frozen=True, slots=True)
class Verdict:
    """One expectation with the value that was measured; `value` None (nothing to measure) is never `ok`."""

    name: str
    value: float | None
    op: str
    bound: float
    ok: bool


def judge(metrics: Mapping[str, Any], expectations: Iterable[Expectation]) -> tuple[Verdict, ...]:
    """Every expectation against `metrics` (as in metrics.json).

    Raises ValueError for a metric that does not exist, with the nearest that does, or that is not a number.
    """
    numbers = dict(_flat(metrics))
    return tuple(_verdict(numbers, expectation) for expectation in expectations)


def _verdict(numbers: Mapping[str, Any], expectation: Expectation) -> Verdict:
    name = expectation.metric
    if name not in numbers:
        near = difflib.get_close_matches(name, numbers, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"there are {', '.join(sorted(numbers))}"
        raise ValueError(f"expectation of {name!r}: no such metric; {hint}")
    value = numbers[name]
    if value is not None and not isinstance(value, int | float):
        raise ValueError(f"expectation of {name!r}: its value {value!r} is not a number")
    ok = value is not None and bool(_COMPARE[expectation.op](value, expectation.bound))
    return Verdict(name, value, expectation.op, expectation.bound, ok)


def _flat(metrics: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in metrics.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        elif not isinstance(value, list | tuple):
            yield prefix + key, value
