"""A platform that is bound to a path brakes, too, where too little way is left to stop in."""

from dataclasses import replace

import numpy as np
import pytest

from stack.kinematics.proximity import BodyDistances, Box
from stack.planner.clearance import Clearance, Standing, nearest_pairs
from stack.planner.parameters import Method
from stack.planner.path_following import PathCoordinator
from tests.unit.planner.plant import ROBOT, parameters

ARM, LIMITS = ROBOT.arm, ROBOT.limits
BASE = np.array([0.15, 0.0, 0.35])
LENIENT = Clearance(influence=0.2, safety=0.001, approach=20.0)
"""Dampers that let everything pass: what stops the platform is the last resort alone."""


def speed(method: Method, ahead_m: float) -> float:
    """ṡ of a robot whose TCP shall go on at 0.2 m/s, with a wall `ahead_m` before its foremost part."""
    model = ARM.state(ARM.home)
    standing = Standing(np.eye(4), np.zeros(2))
    bodies = BodyDistances(ARM)
    wall = Box(3.0, 0.0, 1.0, 0.1, 4.0, 4.0)
    far = replace(LENIENT, influence=5.0)
    least = min(
        pair.distance
        for pair in nearest_pairs(bodies, ARM.state(ARM.home), far, [wall], standing)
        if pair.platform.any()
    )
    near = Box(3.0 - least + ahead_m, *wall[1:])
    told = replace(parameters(), method=method, collision_avoidance=True, clearance=LENIENT, obstacles=(near,))
    forward = np.concatenate((model.rotation.T @ np.array([0.2, 0.0, 0.0]), np.zeros(3)))
    coordinator = PathCoordinator(ARM, LIMITS, BASE)
    return float(coordinator.on_path(model, forward, forward, 0.0, (-0.4, 0.4), 0.0, told, standing).dq[-1])


@pytest.mark.parametrize("method", [Method.PNS, Method.QP])
def test_it_stops_before_a_wall_and_goes_on_where_there_is_way_left(method: Method) -> None:
    assert speed(method, 0.15) > 0.01
    assert speed(method, 0.01) == 0.0
