"""Repulsion and circumvention of the singular manifolds of moma8: the pure functions, and the arm driven towards every manifold."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.load import load_scenario
from config.robot import load_robot, planner_parameters
from stack.messages import Restriction
from stack.planner.avoidance import Avoidance, Zones, circumvent, repulsion, zones
from stack.planner.coordination import Coordinator
from stack.planner.odometry import PlatformRate
from stack.planner.parameters import Method, PlannerParameters
from stack.planner.preferences import window
from stack.planner.problem import Status
from stack.planner.singularities import Margin, manifold_margins

ROBOT = load_robot("moma8")
ARM = ROBOT.arm
BASE = np.array([0.15, 0.0, 0.35])
COORDINATOR = Coordinator(ARM, ROBOT.limits, BASE)
SIZES = Avoidance()
REACHABLE = ("L1", "L2", "L3", "L4", "F1", "F2", "F3p")  # F3m has the elbow at π, beyond its limit
SPEED = 0.3


def parameters(**changes: object) -> PlannerParameters:
    """No preferences of its own."""
    base = planner_parameters(ROBOT, load_scenario("sliding-door"))
    none = replace(base.preferences, heights=np.zeros(8))
    return replace(base, preferences=none, **changes)  # type: ignore[arg-type]


def start_near(name: str, seed: int, low: float, high: float) -> np.ndarray:
    """A configuration inside the limits whose margin of manifold `name` is between low and high, all others larger than `low`."""
    rng = np.random.default_rng(seed)
    while True:
        q = rng.uniform(ARM.q_min + ARM.padding, ARM.q_max - ARM.padding)
        found = manifold_margins(ARM, q)
        near = found[name]
        if low < near.distance < high and min(m.distance for m in found.values()) > low:
            return q


@dataclass
class Drive:
    """What a closed loop of arm cycles went through: smallest margin, last one, the worst error of twists that were said to be met."""

    least: float
    last: float
    moved: float
    twist_error: float
    statuses: set[Status]
    restrictions: Restriction


def drive(q: np.ndarray, chosen: PlannerParameters, *, towards: str | None, cycles: int = 250) -> Drive:
    """The arm with the twist that leads it straight to a manifold (None: no twist); commands are followed exactly."""
    dq, period, start = np.zeros(8), chosen.arm_period_s, ARM.pose(q)
    margins, errors, statuses, restrictions = [], [0.0], set(), Restriction.NONE
    for k in range(cycles):
        found = manifold_margins(ARM, q)
        margins.append(min(m.distance for m in found.values()))
        model = ARM.state(q)
        twist = np.zeros(6) if towards is None else -SPEED * model.end_point_jacobian @ found[towards].gradient
        command = COORDINATOR.arm_cycle(model, twist, dq, window(k * period, chosen.window_s), chosen)
        assert np.isfinite(command.dq).all()
        statuses.add(command.status)
        restrictions |= command.restrictions
        if command.status in (Status.OK, Status.CONSTRAINED) and not command.restrictions & Restriction.ACCELERATION:
            errors.append(float(np.abs(model.end_point_jacobian @ command.dq - command.scale * twist).max()))
        dq = command.dq
        q = q + dq * period
    moved = float(np.linalg.norm(ARM.pose(q)[:3, 3] - start[:3, 3]))
    return Drive(min(margins), margins[-1], moved, max(errors), statuses, restrictions)


@pytest.mark.parametrize("name", REACHABLE)
@pytest.mark.parametrize("seed", [1, 2])
def test_circumvention_keeps_out_of_the_safety_sphere(name: str, seed: int) -> None:
    q = start_near(name, seed, 0.45, 0.7)
    kept = drive(q, parameters(circumvention=True), towards=name)
    assert kept.least > SIZES.radius
    assert kept.twist_error < 1e-9


@pytest.mark.parametrize("name", ["L1", "L3", "L4", "F3p"])
def test_without_it_the_same_drive_enters_the_sphere(name: str) -> None:
    worst = min(
        drive(start_near(name, seed, 0.45, 0.7), parameters(), towards=name, cycles=400).least for seed in (1, 2)
    )
    assert worst < SIZES.radius


def test_it_says_so_when_it_shapes_the_command() -> None:
    q = start_near("L4", 1, 0.45, 0.7)
    assert drive(q, parameters(circumvention=True), towards="L4").restrictions & Restriction.SINGULARITY


@pytest.mark.parametrize("name", REACHABLE)
def test_a_preferred_configuration_on_a_manifold_is_kept_off_and_the_tcp_rests(name: str) -> None:
    """All of it is null-space motion, so redundancy suffices: the TCP must not move."""
    q = start_near(name, 3, 0.45, 0.7)
    found = manifold_margins(ARM, q)[name]
    chosen = parameters(circumvention=True)
    wish = replace(
        chosen.preferences,
        preferred=q - found.distance * found.gradient,
        heights=np.full(8, 0.5),
        widths=np.full(8, 0.2),
    )
    kept = drive(q, replace(chosen, preferences=wish), towards=None, cycles=400)
    assert kept.least > SIZES.radius
    assert kept.moved < 1e-3  # what explicit steps of 10 ms leave of it
    assert kept.statuses <= {Status.OK, Status.CONSTRAINED}


@pytest.mark.parametrize("name", REACHABLE)
def test_repulsion_makes_the_margin_grow_and_the_tcp_rests(name: str) -> None:
    q = start_near(name, 4, 0.25, 0.35)
    before = min(m.distance for m in manifold_margins(ARM, q).values())
    pushed = drive(q, parameters(repulsion=True), towards=None)
    assert pushed.last > before + 0.002
    assert pushed.moved < 1e-3
    still = drive(q, parameters(), towards=None, cycles=5)
    assert still.last == pytest.approx(before, abs=1e-12)


@pytest.mark.parametrize("method", [Method.QP, Method.FSP, Method.GRADIENT])
def test_every_method_keeps_out(method: Method) -> None:
    q = start_near("L4", 1, 0.45, 0.6)
    kept = drive(q, parameters(circumvention=True, repulsion=True, method=method), towards="L4", cycles=200)
    assert kept.least > SIZES.radius


def test_the_whole_robot_goes_round_as_well() -> None:
    """The platform cycle gives the arm the same rows: its own share of the motion does not approach."""
    q = start_near("L4", 1, 0.12, 0.2)
    margin = manifold_margins(ARM, q)["L4"]
    model = ARM.state(q)
    twist = -SPEED * model.end_point_jacobian @ margin.gradient
    rest = PlatformRate(0.0, 0.0)
    for method in (Method.PNS, Method.QP):
        free, _ = COORDINATOR.robot_cycle(model, twist, twist, rest, 1.0, parameters(method=method))
        kept, _ = COORDINATOR.robot_cycle(model, twist, twist, rest, 1.0, parameters(method=method, circumvention=True))
        assert margin.gradient @ free.dq < 0.0
        assert margin.gradient @ kept.dq > 0.5 * margin.gradient @ free.dq
        assert kept.restrictions & Restriction.SINGULARITY


@given(st.lists(st.sampled_from([0.0, np.pi / 2, -np.pi / 2, 1e-12, 0.05]), min_size=8, max_size=8))
@settings(max_examples=60)
def test_on_the_manifolds_themselves_everything_is_finite(angles: list[float]) -> None:
    q = np.clip(np.array(angles), ARM.q_min, ARM.q_max)
    command = COORDINATOR.arm_cycle(
        ARM.state(q), np.full(6, 0.05), np.zeros(8), 1.0, parameters(circumvention=True, repulsion=True)
    )
    assert np.isfinite(command.dq).all()
    assert (np.abs(command.dq) <= ROBOT.limits.dq_max + 1e-9).all()


def margin_at(distance: float) -> dict[str, Margin]:
    return {"L1": Margin(distance, np.array([0.0, 0.6, 0.8]))}


def test_repulsion_is_radial_fades_out_and_vanishes_on_the_manifold() -> None:
    push = repulsion(margin_at(0.2), SIZES)
    np.testing.assert_allclose(push / np.linalg.norm(push), [0.0, 0.6, 0.8])
    assert 0.5 * SIZES.strength < np.linalg.norm(push) <= SIZES.strength
    assert not repulsion(margin_at(SIZES.reach), SIZES).any()
    assert np.linalg.norm(repulsion(margin_at(SIZES.reach - 1e-4), SIZES)) < 1e-6
    assert not repulsion({"L1": Margin(0.0, np.zeros(3))}, SIZES).any()


def test_zones_follow_the_rule_of_the_joint_limits() -> None:
    edge = SIZES.radius + SIZES.zone
    assert zones(margin_at(edge), SIZES).names == ()
    middle = zones(margin_at(SIZES.radius + 0.5 * SIZES.zone), SIZES)
    assert middle.softness == pytest.approx([0.75])
    assert middle.floor == pytest.approx([0.0])
    inside = zones(margin_at(SIZES.radius - 0.02), SIZES)
    assert inside.softness == pytest.approx([0.0])
    assert inside.floor == pytest.approx([SIZES.recovery_rate * 0.02])
    assert zones({"L1": Margin(0.0, np.zeros(3))}, SIZES).names == ()


@dataclass
class Answer:
    dq: np.ndarray


def test_an_answer_that_goes_away_is_left_alone() -> None:
    asked = []

    def resolve(rows: np.ndarray, values: np.ndarray) -> Answer:
        asked.append(rows)
        return Answer(np.array([0.0, 1.0, 1.0]))

    _, around = circumvent(resolve, zones(margin_at(0.2), SIZES), 3, 2)
    assert around == ()
    assert len(asked) == 1


def test_no_more_rows_than_there_is_room_the_innermost_first() -> None:
    near = Zones(("a", "b", "c"), np.eye(3), np.array([0.9, 0.1, 0.5]), np.zeros(3))
    given: list[np.ndarray] = []

    def resolve(rows: np.ndarray, values: np.ndarray) -> Answer:
        given.append(rows)
        return Answer(np.full(3, -1.0))

    _, around = circumvent(resolve, near, 3, 2)
    assert set(around) == {"b", "c"}
    assert max(len(rows) for rows in given) == 2


@pytest.mark.parametrize("name", ["strength", "reach", "radius", "zone", "recovery_rate"])
def test_sizes_must_be_positive(name: str) -> None:
    with pytest.raises(ValueError, match=name):
        Avoidance(**{name: 0.0})
