"""A soft fence for a guided hand: who pulls it towards a singularity, or where the arm cannot follow, feels a spring that pulls back.

The planner keeps joint limits and passes singularities damped, but it does not tell the person. The fence does: it holds the last place
from which it only got worse, and pulls there. Whoever turns back is free at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stack.messages import PlannerState, Restriction, Vector


@dataclass(frozen=True, slots=True)
class Fence:
    """`margin`: kinematic singularity margin (see `stack.planner.monitor`) at which the fence begins, 0 for no fence; `stiffness` N/m;
    `force` N at most."""

    margin: float = 0.35
    stiffness: float = 2000.0
    force: float = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class FencePost:
    """The place (3,), reference frame, that the spring pulls to, and how free it was there: 1 free, 0 at the end."""

    place: Vector
    freedom: float


def freedom(fence: Fence, singularity_margin: float | None, planner: PlannerState) -> float:
    """How free the hand is, 0 to 1: the lesser of its distance from singularities and of what the planner lets through of the path.

    A path that is slowed because joints are at their greatest speed is a free one.
    """
    free = 1.0
    if singularity_margin is not None and fence.margin > 0.0:
        free = min(free, singularity_margin / fence.margin)
    if not planner.restrictions & Restriction.VELOCITY:
        free = min(free, planner.path_scale)
    return free


def moved_post(post: FencePost | None, place: Vector, free: float) -> FencePost | None:
    """The post for a hand at `place` (3,): none where it is free, where it was freest since it last was elsewhere."""
    if free >= 1.0:
        return None
    if post is None or free >= post.freedom:
        return FencePost(place.copy(), free)
    return post


def pull_back(fence: Fence, post: FencePost | None, place: Vector) -> Vector:
    """The spring's force (3,) in the reference frame on a hand at `place` (3,)."""
    if post is None:
        return np.zeros(3)
    force: Vector = fence.stiffness * (post.place - place)
    size = float(np.linalg.norm(force))
    return force if size <= fence.force else force * (fence.force / size)
