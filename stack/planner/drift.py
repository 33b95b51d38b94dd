"""Slip that the wheels cannot see: the TCP's own sensor against what odometry and the arm's encoders believe.

`T_RO` carries the odometry frame O into the reference frame R. A measurement is compared with the belief at *its* time, however late it
comes: the estimate of the last measurement's time is kept, taken from there to the new one's along what odometry said in between,
corrected, and taken on to now. Nothing that is known of the meantime is lost, and latency costs no more than it must.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from stack.kinematics.se3 import rotation_exp, rotation_log
from stack.messages import Matrix, TrackedPose, Vector
from stack.planner.observer import Estimate, SlipModel, Verdict
from stack.planner.observer_kernels import arc_between
from stack.planner.odometry import PlatformPose, advance
from stack.planner.tracking import body_twist, moved

_HISTORY = 64
_RIVALS = 10
"""So many measurements in a row that agree with each other, and not with the estimate, overrule it."""


class Belief(NamedTuple):
    """What odometry and encoders said at `t_ns`: the platform's pose and `T_OE` (4, 4), the TCP's, both in O."""

    t_ns: int
    pose: PlatformPose
    T_OE: Matrix


@dataclass(frozen=True, slots=True)
class DriftLaw:
    """How measurements are used: by the slip observer with `model`, on wheels `track` m apart, or, where that is None,
    by moving `T_RO` by the share `gain` of each difference."""

    track: float
    model: SlipModel | None = None
    gain: float = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class _Anchor:
    """The observer at the time of the last measurement. `rival`: what `rivals` measurements in a row say that it rejects."""

    t_ns: int
    pose: PlatformPose
    estimate: Estimate
    rival: Estimate | None = None
    rivals: int = 0

    def carried(self, t_ns: int, pose: PlatformPose, law: DriftLaw, model: SlipModel) -> _Anchor:
        """Along one arc, to a later time."""
        dt = (t_ns - self.t_ns) * 1e-9
        estimate = self.estimate.moved(self.pose, pose, dt, law.track, model)
        rival = None if self.rival is None else self.rival.moved(self.pose, pose, dt, law.track, model)
        return _Anchor(t_ns, pose, estimate, rival, self.rivals)

    def judging(self, T_OE: Matrix, seen: TrackedPose, model: SlipModel) -> tuple[_Anchor, Verdict]:
        """With a measurement of this instant."""
        estimate, verdict = self.estimate.measured(T_OE, self.pose, seen.position, seen.rotation_vector, model)
        if verdict is Verdict.TAKEN:
            return replace(self, estimate=estimate, rival=None, rivals=0), verdict
        rival, agrees = self.rival, Verdict.REJECTED
        if rival is not None:
            rival, agrees = rival.measured(T_OE, self.pose, seen.position, seen.rotation_vector, model)
        if rival is None or agrees is Verdict.REJECTED:
            rival = Estimate.placed(T_OE, self.pose, seen.position, seen.rotation_vector, model)
            return replace(self, rival=rival, rivals=1), verdict
        return replace(self, rival=rival, rivals=self.rivals + 1), verdict


@dataclass(frozen=True, slots=True, eq=False)
class DriftEstimate:
    """`T_RO` (4, 4) and `slip` (2,; ratios, left and right) at the newest belief: identity and zero until the first measurement,
    which is then taken over whole.

    `count`, `rejected`: measurements that were taken in, and outliers. `placements`: how often R was placed anew, which is at the
    first measurement and where a tracker has jumped for good. `beliefs`: those of the last cycles.
    """

    T_RO: Matrix = field(default_factory=lambda: np.eye(4))
    slip: Vector = field(default_factory=lambda: np.zeros(2))
    count: int = 0
    rejected: int = 0
    placements: int = 0
    beliefs: tuple[Belief, ...] = ()
    anchor: _Anchor | None = None
    now: Estimate | None = None

    def believing(self, belief: Belief, law: DriftLaw) -> DriftEstimate:
        """One cycle on. While nothing is measured the slip dies away, and `T_RO` moves with what is left of it."""
        beliefs = (*self.beliefs[1 - _HISTORY :], belief)
        if law.model is None or self.now is None or self.anchor is None or not self.beliefs:
            return replace(self, beliefs=beliefs, slip=np.zeros(2), now=None, anchor=None)
        before = self.beliefs[-1]
        dt = (belief.t_ns - before.t_ns) * 1e-9
        now = self.now.moved(before.pose, belief.pose, dt, law.track, law.model)
        anchor, oldest = self.anchor, beliefs[0]
        if anchor.t_ns < oldest.t_ns:  # nothing can be measured that far back
            anchor = replace(anchor.carried(oldest.t_ns, oldest.pose, law, law.model), rival=None, rivals=0)
        return replace(self, T_RO=now.T_RO, slip=now.slip, beliefs=beliefs, anchor=anchor, now=now)

    def measured_by(self, tracked: TrackedPose, t_ns: int, law: DriftLaw) -> DriftEstimate:
        """With a measurement that was `age_ns` old at `t_ns`. One from before memory, or before the last one, changes nothing."""
        seen_ns = t_ns - tracked.age_ns
        belief = self._belief_at(seen_ns)
        if belief is None or (self.anchor is not None and seen_ns < self.anchor.t_ns):
            return self
        if not _is_a_pose(tracked):
            return replace(self, rejected=self.rejected + 1)
        if law.model is None:
            return self._moved_by_share(tracked, belief.T_OE, law.gain)
        if self.anchor is None:
            first = Estimate.placed(belief.T_OE, belief.pose, tracked.position, tracked.rotation_vector, law.model)
            placements = self.placements + (self.count == 0)
            return replace(self, placements=placements)._with(_Anchor(seen_ns, belief.pose, first), Verdict.TAKEN, law)
        anchor = self.anchor
        for later in self.beliefs:
            if anchor.t_ns < later.t_ns < seen_ns:
                anchor = anchor.carried(later.t_ns, later.pose, law, law.model)
        anchor = anchor.carried(seen_ns, belief.pose, law, law.model)
        anchor, verdict = anchor.judging(belief.T_OE, tracked, law.model)
        if anchor.rivals < _RIVALS or anchor.rival is None:
            return self._with(anchor, verdict, law)
        overruled = replace(self, placements=self.placements + 1)
        return overruled._with(_Anchor(seen_ns, belief.pose, anchor.rival), Verdict.TAKEN, law)

    def _with(self, anchor: _Anchor, verdict: Verdict, law: DriftLaw) -> DriftEstimate:
        """Taken on from `anchor` to the newest belief."""
        assert law.model is not None
        there = anchor
        for later in self.beliefs:
            if later.t_ns > there.t_ns:
                there = there.carried(later.t_ns, later.pose, law, law.model)
        taken = verdict is Verdict.TAKEN
        return replace(
            self,
            T_RO=there.estimate.T_RO,
            slip=there.estimate.slip,
            count=self.count + taken,
            rejected=self.rejected + (not taken),
            anchor=anchor,
            now=there.estimate,
        )

    def _moved_by_share(self, tracked: TrackedPose, T_OE: Matrix, gain: float) -> DriftEstimate:
        """The first ones are averaged, until their number gives each the weight `gain`."""
        predicted = self.T_RO @ T_OE
        weight = max(gain, 1.0 / (self.count + 1))
        turn = rotation_exp(weight * rotation_log(rotation_exp(tracked.rotation_vector) @ predicted[:3, :3].T))
        # The correction turns about the TCP: orientation noise then does not throw the position about.
        position = predicted[:3, 3] + weight * (tracked.position - predicted[:3, 3])
        corrected = np.eye(4)
        corrected[:3, :3] = turn @ self.T_RO[:3, :3]
        corrected[:3, 3] = position - corrected[:3, :3] @ T_OE[:3, 3]
        return replace(self, T_RO=corrected, count=self.count + 1, placements=self.placements + (self.count == 0))

    def _belief_at(self, t_ns: int) -> Belief | None:
        """What was believed of `t_ns`, between two cycles on the way from one to the other; None outside of memory."""
        later: Belief | None = None
        for entry in reversed(self.beliefs):
            if entry.t_ns > t_ns:
                later = entry
                continue
            if later is None or entry.t_ns == t_ns:
                return entry if entry.t_ns == t_ns else None
            u = (t_ns - entry.t_ns) / (later.t_ns - entry.t_ns)
            way, turn = arc_between(*entry.pose, *later.pose)
            pose = advance(entry.pose, u * way, u * turn)
            return Belief(t_ns, pose, moved(entry.T_OE, body_twist(entry.T_OE, later.T_OE), u))
        return None


def _is_a_pose(seen: TrackedPose) -> bool:
    """Finite, and of a size that can be squared."""
    return float(np.abs(seen.position).max()) < _FAR_M and float(np.abs(seen.rotation_vector).max()) < _FAR_RAD


_FAR_M, _FAR_RAD = 1e5, 100.0
