"""Faults that a scenario injects: `[[fault]]` tables, and the same in one word for the command line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, get_args

from pydantic import Field, model_validator

from config.errors import ConfigError, nearest
from config.table import Finite, NotNegative, Positive, Table
from stack.strategic.mission import Recovery

Kind = Literal[
    "frame-loss",
    "frame-delay",
    "frame-duplicate",
    "frame-reorder",
    "frame-corruption",
    "wire-error",
    "bus-off",
    "babbling-idiot",
    "sync-loss",
    "sync-jitter",
    "duplicate-node",
    "drive-reboot",
    "drive-stuck",
    "over-current",
    "encoder-jump",
    "encoder-frozen",
    "encoder-lost",
    "following-error",
    "planner-killed",
    "planner-slow",
    "strategic-killed",
    "force-stuck",
    "force-saturated",
    "force-nan",
    "wheel-blocked",
    "wheel-slip",
    "feedback-lost",
    "disk-full",
    "sigkill",
]
KINDS: tuple[str, ...] = get_args(Kind)
Probability = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
NodeId = Annotated[int, Field(ge=1, le=127)]
CanId = Annotated[int, Field(ge=0, le=0x7FF)]

WHEELS, JOINTS = (11, 12), tuple(range(21, 29))
DRIVES = WHEELS + JOINTS


@dataclass(frozen=True, slots=True)
class _Rule:
    """Parameters of a kind: which it takes beside `at`, with the value that counts where none is given; on which nodes it may act."""

    defaults: Mapping[str, Any]
    nodes: tuple[int, ...] = ()


_FRAMES: dict[str, Any] = {"for_s": None, "node": None, "can_id": None, "count": None}
_RULES: dict[str, _Rule] = {
    "frame-loss": _Rule({**_FRAMES, "probability": 0.1, "burst": 1}),
    "frame-delay": _Rule({**_FRAMES, "probability": 1.0, "delay_s": 0.005, "jitter_s": 0.0}),
    "frame-duplicate": _Rule({**_FRAMES, "probability": 0.1}),
    "frame-reorder": _Rule({**_FRAMES, "probability": 0.1, "delay_s": 0.003}),
    "frame-corruption": _Rule({**_FRAMES, "probability": 0.05, "checksum": "invalid"}),
    "wire-error": _Rule({**_FRAMES, "probability": 0.05}),
    "bus-off": _Rule({"for_s": None, "node": 23}),
    "babbling-idiot": _Rule({"for_s": 0.2, "can_id": 0x001}),
    "sync-loss": _Rule({"for_s": None, "count": None, "probability": 1.0}),
    "sync-jitter": _Rule({"for_s": None, "jitter_s": 0.002}),
    "duplicate-node": _Rule({"for_s": None, "node": 23}),
    "drive-reboot": _Rule({"for_s": 0.3, "node": 23}, DRIVES),
    "drive-stuck": _Rule({"for_s": None, "node": 23}, JOINTS),
    "over-current": _Rule({"node": 23}, DRIVES),
    "encoder-jump": _Rule({"for_s": None, "node": 23, "amount": 0.2}, DRIVES),
    "encoder-frozen": _Rule({"for_s": None, "node": 23}, DRIVES),
    "encoder-lost": _Rule({"for_s": None, "node": 23}, DRIVES),
    "following-error": _Rule({"for_s": None, "node": 23, "amount": 0.0}, JOINTS),
    "planner-killed": _Rule({"for_s": None}),
    "planner-slow": _Rule({"for_s": None, "delay_s": 0.012, "jitter_s": 0.0}),
    "strategic-killed": _Rule({"for_s": None}),
    "force-stuck": _Rule({"for_s": None}),
    "force-saturated": _Rule({"for_s": None, "amount": 500.0}),
    "force-nan": _Rule({"for_s": None}),
    "wheel-blocked": _Rule({"for_s": None, "node": 11}, WHEELS),
    "wheel-slip": _Rule({"for_s": None, "node": 11, "amount": 1.0}, WHEELS),
    "feedback-lost": _Rule({"for_s": None}),
    "disk-full": _Rule({"file": "bus.log"}),
    "sigkill": _Rule({}),
}
BUS_KINDS = frozenset(
    ("frame-loss", "frame-delay", "frame-duplicate", "frame-reorder", "frame-corruption", "wire-error", "sync-loss")
    + ("sync-jitter", "planner-slow")
)
"""Kinds that judge frames on the wire, from `at` on for `for_s` (to the end, if there is none)."""


class FaultTable(Table):
    """One fault. `at`: when it begins, s of the run; `for_s`: how long it lasts (default: to the end, or see docs/faults.md).

    `node`: whom it befalls; for faults of frames: only frames that this node sends. `can_id`: only this identifier.
    `count`: so many frames, then no more. `burst`: frames lost on end for each that is chosen. `amount`: rad (m) of an encoder's jump,
    share of its torque that a motor has left, share of its grip that a wheel has lost, N of a saturated sensor.
    """

    at: NotNegative
    kind: Kind
    for_s: Positive | None = None
    node: NodeId | None = None
    can_id: CanId | None = None
    count: Annotated[int, Field(ge=1)] | None = None
    probability: Probability | None = None
    burst: Annotated[int, Field(ge=1, le=1000)] | None = None
    delay_s: Positive | None = None
    jitter_s: NotNegative | None = None
    checksum: Literal["valid", "invalid"] | None = None
    amount: Finite | None = None
    file: Literal["bus.log", "events.log"] | None = None

    @model_validator(mode="after")
    def _fits_its_kind(self) -> FaultTable:
        rule = _RULES[self.kind]
        for name in _PARAMETERS:
            if getattr(self, name) is not None and name not in rule.defaults:
                takes = ", ".join(["at", *rule.defaults])
                raise ValueError(f"a fault of kind {self.kind!r} has no {name}; it takes {takes}")
        if rule.nodes and self.node is not None and self.node not in rule.nodes:
            raise ValueError(f"node = {self.node}: a fault of kind {self.kind!r} befalls one of {_list(rule.nodes)}")
        if self.kind in ("wheel-slip", "following-error") and not 0.0 <= self.value("amount") <= 1.0:
            raise ValueError(f"amount = {self.amount:g}: a share, of torque or grip, must be within 0 to 1")
        return self

    def value(self, name: str) -> Any:
        """The parameter as given, else the kind's default."""
        given = getattr(self, name)
        return _RULES[self.kind].defaults.get(name) if given is None else given

    @property
    def text(self) -> str:
        """Kind and parameters in one line, e.g. `drive-reboot node=23 for_s=0.3`."""
        values = {name: self.value(name) for name in _PARAMETERS}
        return " ".join(
            [self.kind, *(f"{name}={_shown(name, value)}" for name, value in values.items() if value is not None)]
        )


class RecoveryTable(Table):
    """What the strategic layer does about a fault of the planner: after `after_s` of rest it acknowledges it and begins the step again,
    at most `most` times; without this table a fault ends the mission."""

    after_s: Positive = 1.0
    most: Annotated[int, Field(ge=1, le=1000)] = 1

    def build(self) -> Recovery:
        """As the mission wants it."""
        return Recovery(round(1e9 * self.after_s), self.most)


_PARAMETERS = tuple(name for name in FaultTable.model_fields if name not in ("at", "kind"))


def parse_fault(text: str) -> dict[str, Any]:
    """`KIND@SECONDS[:KEY=VALUE[,KEY=VALUE…]]` as a `[[fault]]` table. Raises ConfigError that says what would be right."""
    head, _, tail = text.partition(":")
    kind, at, seconds = head.partition("@")
    if not at:
        raise ConfigError(f"--fault {text!r}: must be KIND@SECONDS[:KEY=VALUE,...], e.g. drive-reboot@3.2:node=23")
    if kind not in KINDS:
        raise ConfigError(f"--fault {text!r}: unknown kind {kind!r}, {nearest(kind, KINDS)}")
    table: dict[str, Any] = {"kind": kind, "at": _number(text, "the time", seconds)}
    for part in filter(None, tail.split(",")):
        key, equals, value = part.partition("=")
        if not equals or key not in _PARAMETERS:
            raise ConfigError(f"--fault {text!r}: {part!r} must be KEY=VALUE, {nearest(key, _PARAMETERS)}")
        table[key] = value if key in ("checksum", "file") else _number(text, key, value)
    return table


def _number(text: str, what: str, value: str) -> int | float:
    for convert in (lambda s: int(s, 0), float):
        try:
            return convert(value)
        except ValueError:
            continue
    raise ConfigError(f"--fault {text!r}: {what} is {value!r}, must be a number")


def _list(nodes: tuple[int, ...]) -> str:
    return ", ".join(map(str, nodes))


def _shown(name: str, value: Any) -> str:
    if name == "can_id":
        return f"{value:03X}h"
    return f"{value:g}" if isinstance(value, float) else str(value)
