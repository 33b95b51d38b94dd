"""The velocity damper: nothing comes nearer than its safety distance, whatever the task asks, and nothing changes far away."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stack.kinematics.proximity import BodyDistances, Box
from stack.kinematics.se3 import pose_inverse
from stack.messages import Mode, Restriction
from stack.planner.clearance import Clearance, Standing, dampers, nearest_pairs
from stack.planner.coordination import Coordinator
from stack.planner.parameters import Method
from stack.planner.tracking import arm_in_odometry
from tests.unit.planner.plant import ROBOT, Loop, parameters

pytestmark = pytest.mark.slow

ARM, LIMITS, PARAMETERS = ROBOT.arm, ROBOT.limits, parameters()
BASE = np.array([0.15, 0.0, 0.35])
BODIES = BodyDistances(ARM)
DIRECTIONS = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
    lambda d: sum(x * x for x in d) > 0.1
)


def driven(direction, told, boxes=(), mode=Mode.ARM_ONLY, cycles: int = 400):
    """The planner in its loop, the TCP commanded at 0.3 m/s; the least distance on the way and what restricted it."""
    loop = Loop(replace(told, obstacles=tuple(boxes)))
    velocity = 0.3 * np.array(direction) / np.linalg.norm(direction)
    least, restricted = np.inf, Restriction.NONE
    for _ in range(cycles):
        twist = np.concatenate((loop.tcp()[:3, :3].T @ velocity, np.zeros(3)))
        outputs, _ = loop.step(mode, twist)
        restricted |= outputs.restrictions
        T_RA = arm_in_odometry(*loop.base, BASE, np.eye(4))
        least = min([least, *(pair.distance for pair in BODIES.near(loop.q, 0.3, boxes, pose_inverse(T_RA)))])
    return least, restricted


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(DIRECTIONS, st.sampled_from(list(Method)), st.sampled_from((Mode.ARM_ONLY, Mode.COORDINATED)))
def test_no_link_touches_anything_whatever_the_task_asks(direction, method, mode) -> None:
    table = Box(1.1, 0.0, 0.7, 0.6, 1.2, 0.06)
    careful = replace(PARAMETERS, collision_avoidance=True, method=method)
    least, _ = driven(direction, careful, [table], mode)
    assert least > 0.0


def test_without_it_the_same_motion_collides_and_with_it_says_that_it_restricts() -> None:
    down, table = (0.2, 0.0, -1.0), Box(1.1, 0.0, 0.7, 0.6, 1.2, 0.06)
    blind, _ = driven(down, PARAMETERS, [table])
    least, restricted = driven(down, replace(PARAMETERS, collision_avoidance=True), [table])
    assert blind < 0.0 < least
    assert Restriction.COLLISION in restricted


def test_far_from_everything_nothing_changes() -> None:
    coordinator, model = Coordinator(ARM, LIMITS, BASE), ARM.state(ARM.home)
    twist = np.array([0.1, 0.05, 0.0, 0.0, 0.1, 0.0])
    with_it = replace(PARAMETERS, collision_avoidance=True)
    plain, damped = (coordinator.arm_cycle(model, twist, np.zeros(8), 1.0, p) for p in (PARAMETERS, with_it))
    np.testing.assert_allclose(damped.dq, plain.dq, atol=1e-12)
    assert damped.restrictions == plain.restrictions


def test_the_arm_makes_way_for_an_obstacle_that_the_platform_brings_nearer() -> None:
    """The zone's floor counts the platform's own approach in."""
    wall = Box(ARM.pose(ARM.home)[0, 3] + 0.15, 0.0, 1.0, 0.1, 4.0, 4.0)
    here = nearest_pairs(
        BODIES, ARM.state(ARM.home), Clearance(influence=0.2), [wall], Standing(np.eye(4), np.zeros(2))
    )
    near = dampers(here, 8, Clearance(influence=0.2))
    assert near.names
    ahead = near.with_platform_at(np.array([0.2, 0.0]))
    assert (ahead.floor > near.floor + 0.15).any()


@pytest.mark.parametrize(
    ("field", "value"), [("safety", 0.2), ("safety", -0.1), ("approach", 0.0), ("influence", np.inf)]
)
def test_sizes_that_mean_nothing_are_refused(field: str, value: float) -> None:
    with pytest.raises(ValueError, match="clearance"):
        replace(Clearance(), **{field: value})
