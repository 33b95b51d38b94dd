"""The singularity monitor in a whole run: its frame on the wire, and the switches of avoidance through the planner's dictionary."""

import re

import numpy as np
import pytest

from drivers.codec import SINGULARITY
from stack.kinematics import ArmModel
from stack.messages import SingularityKind
from stack.planner.monitor import monitor_arm
from stack.planner.singularities import manifolds
from tests.scenarios.conftest import Runner

pytestmark = pytest.mark.slow
_LINE = re.compile(r"\((\d+\.\d+)\) \S+ 4E2#([0-9A-F]{16})")


def test_it_is_published_at_20_hz_and_tells_of_the_home_position(runner: Runner) -> None:
    outcome = runner("hold-still", duration_s=2.0)
    found = _LINE.findall((outcome.directory / "bus.log").read_text())
    times = np.array([float(t) for t, _ in found])
    assert np.diff(times) == pytest.approx(0.05, abs=0.005)  # when the slowest drive has answered
    arm = ArmModel.load("moma8")
    expected = monitor_arm(arm, arm.home)
    last = SINGULARITY.assembler().feed(0x4E2, bytes.fromhex(found[-1][1]))
    assert last.kind is SingularityKind.NONE
    wanted = (expected.kinematic, expected.algorithmic, expected.semi, expected.semi_algorithmic)
    assert last.margins == pytest.approx(wanted, abs=0.02)
    distances = manifolds(arm, arm.home)
    assert list(distances)[last.manifold - 1] == min(distances, key=distances.__getitem__)


@pytest.mark.parametrize("switch", ["planner.repulsion", "planner.circumvention"])
def test_far_from_every_manifold_avoidance_changes_nothing(runner: Runner, switch: str) -> None:
    """`hold-still` stands more than a radian away from all of them."""
    plain, avoiding = (runner("hold-still", f"{switch}={value}", duration_s=2.0) for value in ("false", "true"))
    assert avoiding.metrics["tcp_error_max_m"] == pytest.approx(plain.metrics["tcp_error_max_m"], abs=1e-4)
    # Both were told over the bus: object 2009h or 200Ah was written with this value.
    index = {"planner.repulsion": "0920", "planner.circumvention": "0A20"}[switch]
    for outcome, value in ((plain, "00"), (avoiding, "01")):
        assert f"602#2F{index}00{value}" in (outcome.directory / "bus.log").read_text()
