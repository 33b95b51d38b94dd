"""Pulling a door: what is identified from the way of the handle, and the law against a door on a hinge that nobody told it about."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from stack.kinematics.se3 import pose_exp, rotation_exp, rotation_log
from stack.messages import PlannerPhase, PlannerState, Restriction
from stack.strategic.door import DoorGuess, DoorState, Pull, PullDoor
from stack.strategic.door_identification import Hinge, Identification, Prior
from stack.strategic.motion import CYCLE_S, MotionInputs, MotionOutputs

Array = NDArray[np.float64]
Z = np.array([0.0, 0.0, 1.0])
RADIUS = 0.7
OPEN = np.radians(80.0)


def tilted(axis: Array, about_x: float, about_y: float) -> Array:
    return rotation_exp([about_x, about_y, 0.0]) @ axis


def way(hinge: Hinge, start: Array, angles: Array) -> Array:
    """Points (n, 3) of a handle that begins at `start`."""
    arm = start - hinge.centre
    return np.array([hinge.centre + rotation_exp(angle * hinge.axis) @ arm for angle in angles])


def identified(guess: Hinge, points: Array) -> Identification:
    found = Identification.starting(guess, Prior())
    for point in points:
        found = found.with_point(point)
    return found


share = st.floats(-0.3, 0.3)


@pytest.mark.slow
@given(st.floats(0.3, 1.2), share, share, share, share, st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_hinge_and_radius_come_out_of_any_guess_within_thirty_percent(
    radius: float, longer: float, beside: float, tilt_x: float, tilt_y: float, seed: int
) -> None:
    """Points of an opening by 80 degrees, each off by 0.3 mm."""
    true = Hinge(np.array([0.0, 0.0, 0.9]), Z, radius)
    handle = np.array([radius, 0.0, 0.9])
    guess = DoorGuess(radius * (1.0 + longer), rotation_exp(beside * Z) @ [-1.0, 0.0, 0.0], tilted(Z, tilt_x, tilt_y))
    points = way(true, handle, np.linspace(0.0, OPEN, round(OPEN * radius / 0.0035)))
    points += 0.0003 * np.random.default_rng(seed).standard_normal(points.shape)
    found = identified(guess.hinge(handle), points).hinge
    assert found.radius == pytest.approx(radius, rel=0.005)
    assert np.linalg.norm(found.centre[:2]) < 0.005 * radius + 0.001
    assert np.arccos(min(1.0, found.axis @ Z)) < 0.01


def test_what_is_known_grows_with_the_way_and_says_how_well() -> None:
    true = Hinge(np.zeros(3), Z, RADIUS)
    handle = np.array([RADIUS, 0.0, 0.0])
    guess = DoorGuess(0.9, np.array([-1.0, 0.2, 0.0]), Z).hinge(handle)
    points = way(true, handle, np.linspace(0.0, OPEN, 300))
    found, spreads = Identification.starting(guess, Prior()), []
    for point in points:
        found = found.with_point(point)
        spreads.append(found.radius_known)
        if len(found.points) > 20:
            assert abs(found.hinge.radius - RADIUS) < 4.0 * found.deviation[5] + 1e-6
    assert spreads[0] > 0.2
    assert spreads[-1] < 0.005
    assert found.hinge.radius == pytest.approx(RADIUS, rel=1e-3)


def test_points_that_are_no_way_apart_change_nothing() -> None:
    guess = Hinge(np.zeros(3), Z, 1.0)
    first = Identification.starting(guess, Prior()).with_point(np.array([1.0, 0.0, 0.0]))
    assert first.with_point(np.array([1.0, 0.001, 0.0])) is first
    assert len(first.with_point(np.array([1.0, 0.004, 0.0])).points) == 2


def test_tangent_and_angle_by_numbers() -> None:
    hinge = Hinge(np.array([1.0, 0.0, 5.0]), Z, 2.0)
    start, later = np.array([3.0, 0.0, 4.0]), np.array([1.0, 2.0, 6.0])
    np.testing.assert_allclose(hinge.tangent(start), [0.0, 1.0, 0.0])
    np.testing.assert_allclose(hinge.outward(later), [0.0, 1.0, 0.0])
    assert hinge.angle(start, later) == pytest.approx(np.pi / 2)
    assert replace(hinge, axis=-Z).angle(start, later) == pytest.approx(-np.pi / 2)


@dataclass
class Door:
    """A door of 15 kg with friction on a vertical hinge, held by an arm as soft as the robot's, with the loop's delays.

    The arm: 4 kg at the hand, 800 N/m, 60 N s/m and an integral between where it shall be and where it is; 10 N push it away by 9 mm
    within 0.2 s and by nothing in the end, as measured in the physics.
    """

    radius: float = RADIUS
    friction: float = 3.0
    mass: float = 5.0 + 4.0
    jammed_at: float = 10.0
    angle: float = 0.0
    rate: float = 0.0

    def __post_init__(self) -> None:
        self.desired = np.eye(4)
        self.desired[:3, 3] = [self.radius, 0.0, 0.9]
        self.reached = [self.desired.copy()] * 3
        self.integral = np.zeros(3)
        self.smooth = np.zeros(6)
        self.readings = [np.zeros(3)] * 2
        self.across = 0.0

    @property
    def handle(self) -> Array:
        return np.array([self.radius * np.cos(self.angle), self.radius * np.sin(self.angle), 0.9])

    def cycle(self, twist: Array) -> float:
        """20 ms on; the largest force across the handle meanwhile."""
        worst = 0.0
        for _ in range(2):
            self.smooth = self.smooth + 0.25 * (twist - self.smooth)
            before, total = self.reached.pop(0), np.zeros(3)
            self.desired = self.desired @ pose_exp(self.smooth * 0.01)
            self.reached.append(self.desired.copy())
            rate = (self.reached[0][:3, 3] - before[:3, 3]) / 0.01
            for ms in range(5):
                goal = before[:3, 3] + rate * 0.002 * (ms + 1)
                force = self._arm(goal, rate)
                total += force / 5.0
                worst = max(worst, self._across(force))
            self.readings.append(-total)
            self.readings.pop(0)
        return worst

    def _arm(self, goal: Array, rate: Array) -> Array:
        """2 ms: the arm's force on the handle (3,)."""
        along = np.array([-np.sin(self.angle), np.cos(self.angle), 0.0])
        error = goal - self.handle
        self.integral = self.integral + 3000.0 * error * 0.002
        force: Array = 800.0 * error + 60.0 * (rate - along * self.radius * self.rate) + self.integral
        pull = float(force @ along) - self.friction * np.tanh(self.rate / 0.002)
        self.rate += pull / (self.mass * self.radius) * 0.002
        if self.angle > self.jammed_at:
            self.rate = 0.0
        self.angle += self.rate * 0.002
        return force

    def _across(self, force: Array) -> float:
        outward = np.array([np.cos(self.angle), np.sin(self.angle), 0.0])
        return float(np.hypot(force @ outward, force[2]))

    def inputs(self, t_s: float, grasped: bool | None = True) -> MotionInputs:
        planner = PlannerState(PlannerPhase.EXECUTING, 0, Restriction.NONE, 1.0, 0)
        force = self.desired[:3, :3].T @ self.readings[0]
        wrench = np.concatenate([force, np.zeros(3)])
        return MotionInputs(t_s, planner, np.eye(3), self.desired.copy(), wrench, grasped)


def pulled(motion: PullDoor, door: Door, seconds: float = 40.0) -> tuple[DoorState, MotionOutputs, Array]:
    """Until it is done or has failed: last state, last outputs, and the force across of every cycle, with whether the radius was known."""
    state = motion.begin(door.inputs(0.0))
    rows = []
    for cycle in range(round(seconds / CYCLE_S)):
        state, outputs = motion.step(state, door.inputs(cycle * CYCLE_S))
        assert state is not None
        if outputs.done or outputs.failure is not None:
            return state, outputs, np.array(rows)
        rows.append([door.cycle(outputs.twist), float(state.known)])
    raise AssertionError(f"not at its end after {seconds} s, {np.degrees(door.angle):.1f} degrees")


def guessed(longer: float, beside: float, tilt_x: float = 0.0, tilt_y: float = 0.0) -> DoorGuess:
    direction = rotation_exp(beside * Z) @ [-1.0, 0.0, 0.0]
    return DoorGuess(RADIUS * (1.0 + longer), direction, tilted(Z, tilt_x, tilt_y))


GUESSES = [
    (0.3, 0.3, 0.2, 0.0),
    (-0.3, 0.3, 0.0, 0.2),
    (0.3, -0.3, -0.2, 0.1),
    (-0.3, -0.3, 0.1, -0.2),
    (0.0, 0.0, 0.0, 0.0),
    (0.2, -0.1, 0.0, 0.0),
]


@pytest.mark.slow
@pytest.mark.parametrize("guess", GUESSES)
def test_the_door_opens_softly_whatever_was_guessed(guess: tuple[float, float, float, float]) -> None:
    door = Door()
    state, outputs, rows = pulled(PullDoor(guessed(*guess), Pull(OPEN)), door)
    assert outputs.failure is None
    assert np.degrees(door.angle) == pytest.approx(80.0, abs=1.0)
    hinge = state.identification.hinge
    assert hinge.radius == pytest.approx(RADIUS, rel=0.02)
    assert np.arccos(min(1.0, abs(hinge.axis @ Z))) < 0.03
    known = rows[:, 1] > 0.0
    assert known.any()
    assert rows[known, 0].max() <= 15.0
    assert outputs.event is not None
    assert f"radius {hinge.radius:.4f} m" in outputs.event


def test_without_identification_it_stops_somewhere_else() -> None:
    door = Door()
    pulled(PullDoor(guessed(0.3, 0.3), Pull(OPEN, identify=False)), door)
    assert abs(np.degrees(door.angle) - 80.0) > 10.0


def test_without_giving_way_the_force_across_is_another() -> None:
    stiff = PullDoor(guessed(0.3, 0.3), Pull(OPEN, yielding_n=1e6, force_limit_n=1e6))
    stiff = replace(stiff, law=replace(stiff.law, gain=0.0))
    door = Door()
    state, worst = stiff.begin(door.inputs(0.0)), 0.0
    for cycle in range(250):
        state, outputs = stiff.step(state, door.inputs(cycle * CYCLE_S))
        worst = max(worst, door.cycle(outputs.twist))
    assert worst > 60.0


@pytest.mark.parametrize("follow", [0.0, 0.4, 1.0])
def test_the_hand_makes_its_share_of_the_turn_and_about_the_true_axis(follow: float) -> None:
    door = Door()
    pulled(PullDoor(guessed(-0.3, 0.2, 0.2, -0.1), Pull(OPEN, follow=follow)), door)
    np.testing.assert_allclose(rotation_log(door.desired[:3, :3]), follow * OPEN * Z, atol=0.05)


def test_a_door_that_opens_the_other_way_round() -> None:
    """The same door, told as a negative angle about the opposite axis."""
    door = Door()
    guess = DoorGuess(0.8, np.array([-1.0, 0.1, 0.0]), -Z)
    _, outputs, _ = pulled(PullDoor(guess, Pull(-OPEN)), door)
    assert outputs.done
    assert np.degrees(door.angle) == pytest.approx(80.0, abs=1.0)


def test_a_jammed_door_is_given_up_with_its_angle_and_forces() -> None:
    door = Door(jammed_at=np.radians(30.0))
    _, outputs, rows = pulled(PullDoor(guessed(0.1, 0.1), Pull(OPEN)), door)
    assert outputs.failure is not None
    assert "stuck at 3" in outputs.failure
    assert "N along" in outputs.failure
    assert rows[:, 0].max() < 60.0


def test_a_lost_handle_a_deaf_sensor_and_an_unknown_pose_are_named() -> None:
    door, motion = Door(), PullDoor(guessed(0.0, 0.0), Pull(OPEN))
    state = motion.begin(door.inputs(0.0))
    _, outputs = motion.step(state, door.inputs(0.0, grasped=False))
    assert outputs.failure is not None
    assert "handle was lost" in outputs.failure
    _, outputs = motion.step(state, replace(door.inputs(0.0), X_RE=None))
    assert outputs.failure is not None
    for cycle in range(30):
        state, outputs = motion.step(state, replace(door.inputs(cycle * CYCLE_S), wrench=None))
        assert not outputs.twist.any()
    assert outputs.failure is not None
    assert "force sensor" in outputs.failure


def test_the_same_pull_gives_the_same_bits() -> None:
    twists = []
    for _ in range(2):
        door, motion = Door(), PullDoor(guessed(0.2, 0.1, 0.1, 0.0), Pull(OPEN))
        state = motion.begin(door.inputs(0.0))
        for cycle in range(200):
            state, outputs = motion.step(state, door.inputs(cycle * CYCLE_S))
            door.cycle(outputs.twist)
        twists.append(outputs.twist.tobytes())
    assert twists[0] == twists[1]
