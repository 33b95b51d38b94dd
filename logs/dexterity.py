"""How freely arm and whole robot can move along a run: singular values, manipulability, velocity ellipsoids, from the true q."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from logs.signals import Decimation, Signal
from stack.kinematics import ArmModel
from stack.kinematics.platform import extended, extended_wrist_jacobian
from stack.messages import Matrix

MANIPULABILITY = ("arm", "robot", "arm, wrist centre", "robot, wrist centre")


class Dexterity:
    """Computes at a fixed rate of run time, over any number of blocks. `arm` must not be used by another thread."""

    def __init__(self, arm: ArmModel, rate_hz: float = 20.0) -> None:
        self._arm = arm
        self._decimation = Decimation(rate_hz)
        self._has_wrist = arm.description.wrist_link is not None and "D" in arm.description.points
        self._has_platform = arm.description.platform is not None

    def add(self, q: Signal, pose_WE: Signal) -> dict[str, Signal]:
        """Signals at the samples of `truth/q` (n, joints) and `truth/pose_WE` (n, 4, 4) that are due.

        `manipulability` (m, 4): see `MANIPULABILITY`, NaN for what the robot does not have. `singular_values/arm` and `/robot`
        (m, 6). `ellipsoid/arm` and `/robot` (m, 10): centre, half sizes, quaternion xyzw of the TCP's velocity ellipsoid in
        the world, for joint velocities (rad/s, m/s) of norm 1.
        """
        rows = self._decimation.due(q.t_ns)
        if not len(rows):
            return {}
        t_ns = q.t_ns[rows]
        arms, robots, wrists = [], [], []
        for configuration in q.values[rows]:
            state = self._arm.state(configuration)
            arms.append(state.end_point_jacobian)
            robots.append(extended(self._arm, state) if self._has_platform else state.end_point_jacobian)
            wrists.append(self._wrist(configuration))
        pose = pose_WE.values[rows]
        sigma_arm, sigma_robot = (
            np.linalg.svd(np.array(arms), compute_uv=False),
            np.linalg.svd(np.array(robots), compute_uv=False),
        )
        columns = np.column_stack([sigma_arm.prod(axis=1), sigma_robot.prod(axis=1), np.array(wrists)])
        return {
            "manipulability": Signal(t_ns, columns),
            "singular_values/arm": Signal(t_ns, sigma_arm),
            "singular_values/robot": Signal(t_ns, sigma_robot),
            "ellipsoid/arm": Signal(t_ns, _ellipsoids(np.array(arms)[:, :3], pose)),
            "ellipsoid/robot": Signal(t_ns, _ellipsoids(np.array(robots)[:, :3], pose)),
        }

    def _wrist(self, q: np.ndarray) -> tuple[float, float]:
        if not self._has_wrist:
            return (float("nan"), float("nan"))
        arm = np.linalg.svd(self._arm.wrist_jacobian(q), compute_uv=False).prod()
        if not self._has_platform:
            return (float(arm), float("nan"))
        return (float(arm), float(np.linalg.svd(extended_wrist_jacobian(self._arm, q), compute_uv=False).prod()))


def _ellipsoids(blocks: np.ndarray, pose: np.ndarray) -> Matrix:
    """(m, 10) for translation blocks (m, 3, n) in the end-point frame and TCP poses (m, 4, 4)."""
    axes, sizes, _ = np.linalg.svd(blocks, full_matrices=False)
    axes = pose[:, :3, :3] @ axes
    axes[:, :, 2] *= np.sign(np.linalg.det(axes))[:, None]
    return np.hstack([pose[:, :3, 3], sizes, Rotation.from_matrix(axes).as_quat()])
