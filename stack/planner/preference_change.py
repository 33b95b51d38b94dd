"""New preferences come in gradually, so that a change in mid-motion makes no jump in the velocity that the robot would like to have."""

from __future__ import annotations

from dataclasses import dataclass

from stack.planner.parameters import Preferences
from stack.planner.preferences import window


@dataclass(frozen=True, slots=True, eq=False)
class PreferenceChange:
    """From `before` to `target`, since `began_ns`; both None before anything was preferred."""

    before: Preferences | None = None
    target: Preferences | None = None
    began_ns: int = 0

    def towards(self, target: Preferences, t_ns: int, duration_s: float) -> PreferenceChange:
        """Itself while `target` stays the same object; otherwise a new change from what is in force now. The first is so at once."""
        if self.target is target:
            return self
        if self.target is None:
            return PreferenceChange(target, target, t_ns)
        return PreferenceChange(self.in_force(t_ns, duration_s), target, t_ns)

    def in_force(self, t_ns: int, duration_s: float) -> Preferences:
        """Preferences at `t_ns`: all numbers on straight lines between the two, at the pace of the window function."""
        assert self.before is not None and self.target is not None
        share = window((t_ns - self.began_ns) * 1e-9, duration_s)
        if share >= 1.0 or self.before is self.target:
            return self.target
        return mixed(self.before, self.target, share)


def mixed(a: Preferences, b: Preferences, share: float) -> Preferences:
    """(1 − share) a + share b, number by number."""
    return Preferences(**{name: (1.0 - share) * getattr(a, name) + share * getattr(b, name) for name in _NUMBERS})


_NUMBERS = tuple(name for name, field in Preferences.__dataclass_fields__.items() if field.init)
