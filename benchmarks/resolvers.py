"""What one step of every resolver costs, next to LAPACK's SVD of the same matrix and to other libraries' differential IK.

One process, one thread, all contenders interleaved on the same configurations of the same arm with the same task, so that the
machine's moods hit all of them alike; the ratios are what counts. `pink` and `placo` take part where they are installed
(neither is a dependency).

    python -m benchmarks.resolvers [--steps 2000]
"""

from __future__ import annotations

import argparse
import gc
import os
from collections.abc import Callable
from time import perf_counter_ns
from typing import Any

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np  # noqa: E402

from stack.kinematics import ArmModel  # noqa: E402
from stack.kinematics.robot_file import robot_directory  # noqa: E402
from stack.planner.problem import Problem  # noqa: E402
from stack.planner.resolvers import RESOLVERS  # noqa: E402
from stack.planner.resolvers.decomposition import decompose  # noqa: E402
from stack.planner.resolvers.extended import extended_step  # noqa: E402
from stack.planner.resolvers.pns import pns  # noqa: E402
from stack.planner.resolvers.step import arm_step, limit_table  # noqa: E402

Vector = np.ndarray[Any, np.dtype[np.float64]]
Contender = tuple[str, Callable[[Vector, Vector], object]]
DT = 0.01


def ours(arm: ArmModel) -> list[Contender]:
    """Given J: the SVDs, the kernel, the resolvers through Problem and Solution; with kinematics: the control cycle's steps."""
    n = arm.n
    table = limit_table(arm.q_min, arm.q_max, arm.padding, arm.dq_max)
    wishes, weight = np.array([arm.preferred, np.full(n, 0.1), np.full(n, 0.3)]), np.eye(n)
    none, no_values, row = np.zeros((0, n)), np.zeros(0), np.eye(n)[:1]
    free = np.array([np.inf, np.inf])
    wide = limit_table(
        np.append(arm.q_min, -free),
        np.append(arm.q_max, free),
        np.append(arm.padding, (1, 1)),
        np.append(arm.dq_max, (0.6, 1.2)),
    )
    at: dict[str, Any] = {}

    def jacobian(q: Vector) -> Vector:
        if at.get("q") is not q:
            at["q"], at["J"] = q, arm.jacobian(q)
        value: Vector = at["J"]
        return value

    def extended(q: Vector, xdot: Vector) -> object:
        state = arm.state(q)
        x, y, _ = state.position
        columns = np.array([[1.0, -y], [0.0, x + 0.15], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
        return extended_step(
            state.jacobian,
            columns,
            xdot,
            np.append(q, (0, 0)),
            np.zeros(n + 2),
            np.eye(n + 2),
            wide,
            np.zeros((0, n + 2)),
            no_values,
        )

    def by_name(name: str) -> Callable[[Vector, Vector], object]:
        return lambda q, xdot: RESOLVERS[name](
            Problem(
                jacobian(q),
                xdot,
                z=0.1 * np.tanh((arm.preferred - q) / 0.3),
                A=row,
                b=[0.0],
                lower=-arm.dq_max,
                upper=arm.dq_max,
            )
        )

    return [
        ("numpy.linalg.svd of J", lambda q, _: np.linalg.svd(jacobian(q))),
        ("decompose (SVD)", lambda q, _: decompose(jacobian(q))),
        ("pns kernel, one row", lambda q, x: pns(jacobian(q), x, weight, q, row, np.zeros(1), 0.01, 1e-6)),
        ("arm_step", lambda q, x: arm_step(jacobian(q), x, q, wishes, 1.0, weight, table, none, no_values)),
        *((f"{name}: Problem -> Solution", by_name(name)) for name in RESOLVERS),
        (
            "kinematics + arm_step",
            lambda q, x: arm_step(arm.state(q).jacobian, x, q, wishes, 1.0, weight, table, none, no_values),
        ),
        ("kinematics + extended_step", extended),
    ]


def pink_step(arm: ArmModel) -> Contender:
    """Pink with DAQP: the same TCP target, a posture task for the preferences, position and velocity limits."""
    import pink
    import pinocchio as pin
    from pink.tasks import FrameTask, PostureTask

    model = pin.buildModelFromUrdf(str(robot_directory(arm.name) / "robot.urdf"))
    for frame in model.frames:  # a link and a joint may share a name in URDF, not here
        if frame.type == pin.FrameType.BODY:
            frame.name = "link:" + frame.name
    others = [model.getJointId(name) for name in model.names[1:] if name not in arm.joint_names]
    model, tcp = pin.buildReducedModel(model, others, pin.neutral(model)), "link:" + arm.description.tcp_link
    task, posture = FrameTask(tcp, 1.0, 1.0, gain=1.0), PostureTask(cost=1e-3, gain=0.1)
    configuration = pink.Configuration(model, model.createData(), np.zeros(model.nq))

    def step(q: Vector, xdot: Vector) -> object:
        configuration.update(q)
        task.set_target(configuration.get_transform_frame_to_world(tcp) * pin.exp6(pin.Motion(xdot * DT)))
        if posture.target_q is None:
            posture.set_target(arm.preferred)
        return pink.solve_ik(configuration, [task, posture], DT, solver="daqp", safety_break=False)

    return "pink, daqp (with kinematics)", step


def placo_step(arm: ArmModel) -> Contender:
    """Placo: the same TCP target as a hard-free frame task, posture regularisation, joint and velocity limits."""
    import placo

    robot = placo.RobotWrapper(str(robot_directory(arm.name)), placo.Flags.ignore_collisions)
    solver = placo.KinematicsSolver(robot)
    solver.mask_fbase(True)
    solver.dt = DT
    solver.enable_velocity_limits(True)
    frame = solver.add_frame_task(arm.description.tcp_link, np.eye(4))
    frame.configure("tcp", "soft", 1.0, 1.0)
    solver.add_regularization_task(1e-4)

    def step(q: Vector, xdot: Vector) -> object:
        for name, value in zip(arm.joint_names, q, strict=True):
            robot.set_joint(name, float(value))
        robot.update_kinematics()
        target = robot.get_T_world_frame(arm.description.tcp_link)
        target[:3, 3] += xdot[:3] * DT
        frame.T_world_frame = target
        return solver.solve(False)

    return "placo (with kinematics)", step


def contenders(arm: ArmModel) -> list[Contender]:
    found = ours(arm)
    for name, make in (("pink", pink_step), ("placo", placo_step)):
        try:
            found.append(make(arm))
        except ImportError as error:
            print(f"{name} takes no part: {error}")
    return found


def measure(found: list[Contender], arm: ArmModel, steps: int) -> dict[str, Vector]:
    """Microseconds of every step (steps,) by contender, interleaved; configurations with a reasonable σ along a random walk."""
    rng = np.random.default_rng(1)
    times = {name: np.empty(steps) for name, _ in found}
    q = arm.home.copy()
    gc.disable()
    for k in range(-20, steps):
        q = np.clip(q + 0.02 * rng.normal(size=arm.n), arm.q_min + 0.05, arm.q_max - 0.05)
        xdot = 0.05 * rng.normal(size=6)
        arm.jacobian(q)
        for name, step in found:
            start = perf_counter_ns()
            step(q, xdot)
            if k >= 0:
                times[name][k] = 1e-3 * (perf_counter_ns() - start)
    gc.enable()
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=2000)
    arguments = parser.parse_args()
    arm = ArmModel.load("moma8")
    times = measure(contenders(arm), arm, arguments.steps)
    unit = float(np.median(times["numpy.linalg.svd of J"]))
    print(f"{'contender':34} {'median µs':>10} {'p99 µs':>10} {'÷ numpy SVD':>12}")
    for name, values in times.items():
        median, high = np.percentile(values, (50, 99))
        print(f"{name:34} {median:10.1f} {high:10.1f} {median / unit:12.2f}")


if __name__ == "__main__":
    main()
