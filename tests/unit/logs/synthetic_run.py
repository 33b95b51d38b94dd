"""A run that no planner made: the robot drives along a line, its frames and truth are computed, kinematics exact.

The TCP goes along x at 0.12 m/s while the arm waves within its null space as the resolved motion has it, the platform drives with it and
sways; the frames are those that planner, drives, sensors and strategic node would send. `error_m` offsets the commanded path from the
true one, sideways and growing with the path, so that the right answer of every statistic is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from drivers.catalogue import JOINT_IDS, WHEEL_IDS, devices
from drivers.codec import (
    MISSION,
    PLANNER_STATE,
    REFERENCE,
    SINGULARITY,
    SLIP,
    TRACKED_POSE,
    TWIST,
    WRENCH,
    ReferencePose,
)
from drivers.drive_codec import DriveCodec
from drivers.frame import Frame
from stack.kinematics import ArmModel, extended_jacobian
from stack.kinematics.platform import integrate_unicycle, wheel_speeds
from stack.messages import (
    DriveFeedback,
    MissionCommand,
    Mode,
    PlannerPhase,
    PlannerState,
    Restriction,
    SingularityKind,
    SingularityReport,
    SlipReport,
    TrackedPose,
    Truth,
    TwistCommand,
    Wrench,
)

PERIOD_NS = 10_000_000
DEVICES = devices()
RATED = {node: float(DEVICES[node].object(0x6076).default) * 1e-3 for node in (*WHEEL_IDS, *JOINT_IDS)}
MOTION_STARTS = 100  # cycles


@dataclass
class Motion:
    """Truth at every SYNC, and the error that the commanded path shall have there: (n, 3) in the world."""

    truths: list[Truth]
    error: np.ndarray


def motion(cycles: int, error_m: float = 0.0) -> Motion:
    """Integrates the whole robot's resolved motion along a straight line, 10 ms a step."""
    arm = ArmModel.load("moma8")
    platform = arm.description.platform
    assert platform is not None
    q, posture, dt = arm.home.copy(), np.array([0.0, 0.0, 0.3]), PERIOD_NS * 1e-9
    truths, error = [], np.zeros((cycles, 3))
    for k in range(cycles):
        t_s = k * dt
        ramp = float(np.clip((k - MOTION_STARTS) / 100, 0.0, 1.0))
        pose_WB = np.eye(4)
        pose_WB[:2, 3] = posture[:2]
        pose_WB[:3, :3] = Rotation.from_euler("z", posture[2]).as_matrix()
        base = np.eye(4)
        base[:3, 3] = platform.arm_base
        pose_WE = pose_WB @ base @ arm.pose(q)
        twist_W = np.array([0.12 * ramp, 0.03 * ramp * np.sin(0.6 * t_s), 0.0, 0.0, 0.0, 0.0])
        twist = np.concatenate([pose_WE[:3, :3].T @ twist_W[:3], np.zeros(3)])
        jacobian = extended_jacobian(arm, q)
        wanted = np.append(0.4 * (arm.preferred - q), [0.12 * ramp, -0.4 * ramp * posture[2]])
        inverse = np.linalg.pinv(jacobian)
        motion = inverse @ (twist - jacobian @ wanted) + wanted
        motion = motion * max(ramp, 1e-9)
        v, omega = float(motion[8]), float(motion[9])
        slip = 0.01 * np.array([np.sin(1.3 * t_s), np.cos(0.9 * t_s)])
        force = 4.0 * ramp * np.array([np.sin(0.8 * t_s), 0.3 * np.cos(2.0 * t_s), 0.0, 0.0, 0.0, 0.05])
        truths.append(
            Truth(
                t_ns=k * PERIOD_NS,
                pose_WB=pose_WB,
                pose_WE=pose_WE,
                q=q.copy(),
                dq=motion[:8].copy(),
                effort=arm.gravity(q),
                wheel_velocity=np.array(wheel_speeds(platform, v, omega)),
                wheel_slip=slip,
                base_twist=np.array([v, omega]),
                contact_wrench=force,
            )
        )
        error[k] = [0.0, 0.0, error_m * max(0, k - MOTION_STARTS) / max(1, cycles)]
        q = q + motion[:8] * dt
        posture = integrate_unicycle(posture, v, omega, dt)
    return Motion(truths, error)


class Wire:
    """Frames of the cycles of a motion, each with the time at which it would have been received."""

    def __init__(self, run: Motion) -> None:
        self._run = run
        self._drives = {node: DriveCodec(DEVICES[node]) for node in (*WHEEL_IDS, *JOINT_IDS)}
        self._wheel_angle = np.zeros(2)
        first = run.truths[min(MOTION_STARTS + 2, len(run.truths) - 1)]
        self._world_to_R = np.linalg.inv(first.pose_WE)

    def cycle(self, k: int) -> list[Frame]:
        """All frames between SYNC k and the next."""
        start_ns = k * PERIOD_NS
        sent = [(0x080, b""), *self._feedback(k), *self._sensors(k), *self._planner(k), *self._strategic(k)]
        sent += [(0x700 + node, b"\x05" if k else b"\x00") for node in DEVICES if k % 10 == 0]
        return [Frame(can_id, data, start_ns + 52_000 + 130_000 * i) for i, (can_id, data) in enumerate(sent)]

    def _feedback(self, k: int) -> Iterator[tuple[int, bytes]]:
        truth = self._run.truths[k]
        word = 0x1237 if k > 60 else (0x1233 if k > 55 else (0x1231 if k > 50 else 0x1250))
        self._wheel_angle = self._wheel_angle + truth.wheel_velocity * PERIOD_NS * 1e-9
        for node, position in zip(WHEEL_IDS, self._wheel_angle.tolist(), strict=True):
            yield 0x180 + node, self._drives[node].encode_feedback(DriveFeedback(word, position, 0.4))[0]
        for node, position, effort in zip(JOINT_IDS, truth.q.tolist(), truth.effort.tolist(), strict=True):
            yield 0x180 + node, self._drives[node].encode_feedback(DriveFeedback(word, position, effort))[0]
        if k % 10 == 0:
            velocities = [*truth.wheel_velocity, *truth.dq]
            for node, velocity in zip((*WHEEL_IDS, *JOINT_IDS), velocities, strict=True):
                yield 0x280 + node, round(float(velocity) * 1e6).to_bytes(4, "little", signed=True) + b"\x08"

    def _sensors(self, k: int) -> Iterator[tuple[int, bytes]]:
        truth = self._run.truths[k]
        yield from WRENCH.encode(Wrench(truth.contact_wrench, k % 256))[0]
        if k % 2 == 0 and k >= 2:
            seen = self._run.truths[k - 2].pose_WE
            turn = Rotation.from_matrix(seen[:3, :3]).as_rotvec()
            yield from TRACKED_POSE.encode(TrackedPose(seen[:3, 3] + 4e-4, turn, 20_000_000, (k // 2) % 256))[0]

    def _planner(self, k: int) -> Iterator[tuple[int, bytes]]:
        truth = self._run.truths[min(k + 2, len(self._run.truths) - 1)]
        phase = (
            PlannerPhase.EXECUTING if k >= MOTION_STARTS else (PlannerPhase.IDLE if k > 60 else PlannerPhase.ENABLING)
        )
        restrictions = Restriction.JOINT_2 | Restriction.VELOCITY if k % 700 > 600 else Restriction.NONE
        scale = 0.6 if k % 700 > 600 else 1.0
        yield from PLANNER_STATE.encode(PlannerState(phase, 1 if restrictions else 0, restrictions, scale, k % 256))[0]
        if k % 5 == 0:
            kind = SingularityKind.SEMI if k % 700 > 600 else SingularityKind.NONE
            yield from SINGULARITY.encode(SingularityReport(kind, 5, (0.5, 0.25, 0.05, 1.0), k % 256))[0]
            yield from SLIP.encode(SlipReport((0.01, -0.02), k % 256, 0, k % 256))[0]
        commanded = truth.pose_WE.copy()
        commanded[:3, 3] -= self._run.error[min(k + 2, len(self._run.truths) - 1)]
        in_R = self._world_to_R @ commanded
        rotation = Rotation.from_matrix(in_R[:3, :3]).as_rotvec()
        reference = ReferencePose(in_R[:3, 3], rotation, k >= MOTION_STARTS, (k + 1) % 65536, k % 256)
        yield from REFERENCE.encode(reference)[0]
        for node, velocity in zip(WHEEL_IDS, truth.wheel_velocity.tolist(), strict=True):
            yield 0x200 + node, self._drives[node].encode_set_point(0x0F, velocity, 0.0)[0]
        for node, position, effort in zip(JOINT_IDS, truth.q.tolist(), truth.effort.tolist(), strict=True):
            yield 0x200 + node, self._drives[node].encode_set_point(0x0F, position, effort)[0]

    def _strategic(self, k: int) -> Iterator[tuple[int, bytes]]:
        if k % 2 == 0:
            mode = Mode.COORDINATED if k >= MOTION_STARTS else Mode.HOLD
            twist = np.array([0.12 if k >= MOTION_STARTS else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
            yield from TWIST.encode(TwistCommand(twist, (k // 2) % 256))[0]
            yield from MISSION.encode(MissionCommand(mode, 1 if k >= MOTION_STARTS else 0, (k // 2) % 256))[0]


def play(
    run: Motion,
    on_frame: Callable[[Frame], None],
    on_truth: Callable[[Truth], None],
    on_timing: Callable[[int, int], None] = lambda t_ns, computing_ns: None,
) -> int:
    """Feeds a whole motion to a log, cycle by cycle; returns the number of frames."""
    wire, frames = Wire(run), 0
    for k, truth in enumerate(run.truths):
        on_truth(truth)
        on_timing(truth.t_ns, 400_000 + 1000 * k)
        for frame in wire.cycle(k):
            on_frame(frame)
            frames += 1
    return frames
