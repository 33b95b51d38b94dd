"""The roles of a run, each a set of nodes on the bus: the simulated robot, the planner, the strategic layer."""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass

from canipulator.maps import pose_map
from canipulator.surroundings import surroundings
from config.bench import bench_drives
from config.mission import build_mission
from config.robot import Robot, planner_parameters
from config.scenario import Scenario
from drivers.bus.base import Bus
from drivers.catalogue import DRIVE_IDS, FORCE_SENSOR_ID, GRIPPER_ID, PLANNER_ID, STRATEGIC_ID, TRACKER_ID
from drivers.cia402.bank import DriveBank
from drivers.cia402.bring_up import MasterTimes
from drivers.cia402.device import Drive
from drivers.clock import Clock
from drivers.gripper_node import GripperNode
from drivers.planner_node import PlannerNode
from drivers.sensor_node import ForceSensorNode, TrackerNode
from drivers.strategic_node import StrategicNode
from logs.events import Level
from sim.faults import Breakable, FaultyCamera, FaultyPlant, FaultyReading
from sim.force_sensor import Compensation, ForceSensorParameters
from sim.physics import PhysicsParameters
from sim.slip import SlipParameters
from sim.tracker import Tracker, TrackerParameters
from sim.wheel_plant import WheelPlantParameters
from sim.world import World, WorldParameters
from stack.kinematics.arm import ArmModel
from stack.kinematics.platform import platform_of
from stack.kinematics.posture import best_posture
from stack.kinematics.proximity import BodyDistances
from stack.kinematics.robot_file import robot_directory
from stack.messages import Matrix, TrackedPose, Vector
from stack.planner.planner import Planner
from stack.strategic.point_to_point import Choose

TICK_NS = 1_000_000
_LEVELS = {"info": Level.INFO, "warning": Level.WARN, "error": Level.ERROR}
OnEvent = Callable[[Level, str, str], None]
"""(level, source, text)."""


@dataclass
class SimulatedRobot:
    """World, ten drives and the sensors. `tick` moves all of it by one millisecond."""

    world: World
    bank: DriveBank
    drives: list[Drive]
    force_sensor: ForceSensorNode
    gripper: GripperNode
    tracker: TrackerNode | None
    clock: Clock
    breakable: Breakable | None = None
    """What faults may be injected into; None in a scenario without any."""

    def power_on(self, *, sensors: bool = True) -> None:
        """Boots every node, or the drives alone, and starts the physics."""
        for drive in self.drives:
            drive.power_on()
        for other in (self.force_sensor, self.gripper, self.tracker) if sensors else ():
            if other is not None:
                other.node.power_on()
        self._next_ns = (self.clock.now_ns() // TICK_NS + 1) * TICK_NS
        self.clock.call_at(self._next_ns, self._tick)

    def _tick(self) -> None:
        now_ns = self._next_ns
        self.world.step()
        self.bank.tick(now_ns)
        self._next_ns = now_ns + TICK_NS
        self.clock.call_at(self._next_ns, self._tick)


def simulated_robot(
    robot: Robot, scenario: Scenario, clock: Clock, bus: Bus, absent: Container[int] = ()
) -> SimulatedRobot:
    """The robot of the scenario at its start, nothing powered yet. `absent`: drives that somebody else brings to the bus."""
    platform = platform_of(robot.arm)
    start = scenario.start
    around = surroundings(scenario)
    parameters = WorldParameters(
        physics=PhysicsParameters(step_s=TICK_NS * 1e-9, gripper_touches=around.solid, links_touch=around.solid),
        wheels=WheelPlantParameters(
            bandwidth_hz=platform.wheel_bandwidth,
            dead_time_s=platform.wheel_dead_time,
            peak_torque=platform.wheel_peak_effort,
        ),
        surroundings=around,
        slip=SlipParameters(sigma=scenario.slip.sigma, tau_s=scenario.slip.tau_s),
        force_sensor=_force_sensor(scenario),
        home=tuple(start.configuration if start.configuration is not None else robot.arm.home),
        start=(start.x_m, start.y_m, start.heading_rad),
    )
    world = World(robot_directory(scenario.robot) / "robot.urdf", parameters, scenario.seed)
    parts = _breakable(world) if scenario.fault else None
    bank = DriveBank(robot.servo, world.plant if parts is None else parts.plant, TICK_NS, encoders_flicker=True)
    devices = robot.devices
    drives = [
        Drive(devices[node_id], clock, bus, bank, axis)
        for axis, node_id in enumerate(DRIVE_IDS)
        if node_id not in absent
    ]
    read = _force_reading(world) if parts is None else parts.force
    has_noise = parameters.force_sensor.force_noise_n > 0.0
    sensor = ForceSensorNode(devices[FORCE_SENSOR_ID], clock, bus, read, flickers=has_noise)
    gripper = GripperNode(devices[GRIPPER_ID], clock, bus, world.surroundings.gripper)
    tracker = _tracker(robot, scenario, world, clock, bus, parts) if scenario.feedback.rate_hz > 0.0 else None
    return SimulatedRobot(world, bank, drives, sensor, gripper, tracker, clock, parts)


def _force_sensor(scenario: Scenario) -> ForceSensorParameters:
    table = scenario.force_sensor
    if table is None:
        return ForceSensorParameters()
    return ForceSensorParameters(table.force_noise_n, table.torque_noise_nm, Compensation(table.compensation))


def _force_reading(world: World) -> Callable[[], Vector]:
    return lambda: world.force_sensor.read()


def _breakable(world: World) -> Breakable:
    return Breakable(FaultyPlant(world.plant, TICK_NS * 1e-9), FaultyReading(_force_reading(world)), None)


def _tracker(
    robot: Robot, scenario: Scenario, world: World, clock: Clock, bus: Bus, parts: Breakable | None
) -> TrackerNode:
    feedback = scenario.feedback
    parameters = TrackerParameters(feedback.rate_hz, feedback.latency_s, feedback.noise_m, feedback.noise_rad)
    camera = Tracker(parameters, scenario.seed, TICK_NS)
    deliver: Callable[[int], TrackedPose | None] = camera.deliver
    if parts is not None:
        deliver = parts.camera = FaultyCamera(camera.deliver)
    return TrackerNode(
        robot.devices[TRACKER_ID],
        clock,
        bus,
        lambda t_ns: camera.expose(t_ns, world.physics.pose_WE()),
        deliver,
        period_ns=camera.period_ns,
    )


def planner_role(
    robot: Robot,
    scenario: Scenario,
    clock: Clock,
    bus: Bus,
    on_event: OnEvent,
    stopwatch: Callable[[], int] | None = None,
    times: MasterTimes | None = None,
) -> PlannerNode:
    """Node 2, nothing powered yet. `times`: how long it waits for its drives."""
    devices = robot.devices
    others = [STRATEGIC_ID, FORCE_SENSOR_ID, TRACKER_ID, GRIPPER_ID]
    return PlannerNode(
        devices[PLANNER_ID],
        [devices[node_id] for node_id in DRIVE_IDS],
        others,
        clock,
        bus,
        Planner(robot.arm, robot.limits),
        planner_parameters(robot, scenario),
        lambda level, text: on_event(_LEVELS[level], "planner", text),
        stopwatch,
        sdo_gap_ns(scenario),
        times,
        bench_drives(scenario.drives),
    )


def sdo_gap_ns(scenario: Scenario) -> int:
    """Time between SDO requests that takes two thirds of what the cyclic frames leave of the bus, 6 % of it at least.

    Heartbeats have the lowest priority: on a bus that is full for longer than their time-out they are lost.
    """
    bit_ns = 1e9 / scenario.bus.bitrate
    cyclic = CYCLIC_FRAMES * scenario.planner.arm_cycle_hz * FRAME_BITS * bit_ns * 1e-9
    return min(round(2 * FRAME_BITS * bit_ns / max(0.667 * (1.0 - cyclic), 0.06)), MOST_SDO_GAP_NS)


MOST_SDO_GAP_NS = 8_000_000
"""Ten drives are set up side by side, and each waits 100 ms for an answer at most."""
CYCLIC_FRAMES = 30
"""Frames of one arm cycle, SYNC and what comes at lower rates included."""
FRAME_BITS = 125


def strategic_role(robot: Robot, scenario: Scenario, clock: Clock, bus: Bus, on_event: OnEvent) -> StrategicNode:
    """Node 1 with the scenario's mission, nothing powered yet."""
    devices = robot.devices
    return StrategicNode(
        devices[STRATEGIC_ID],
        devices[PLANNER_ID],
        clock,
        bus,
        build_mission(scenario, robot.arm, _choice(robot, scenario)),
        lambda text: on_event(Level.INFO, "strategic", text),
    )


def _choice(robot: Robot, scenario: Scenario) -> Choose | None:
    """Configurations for poses by the manipulability map, clear of the robot itself; None where no step asks for any."""
    if not any(goal.pose is not None for step in scenario.step for goal in step.goal):
        return None
    arm = ArmModel.load(scenario.robot)  # one instance of its own: the planner's belongs to the planner
    hand, bodies = pose_map(arm), BodyDistances(arm)

    def choose(T: Matrix) -> Vector | None:
        posture = best_posture(arm, T, hand, bodies)
        return None if posture is None else posture.q

    return choose
