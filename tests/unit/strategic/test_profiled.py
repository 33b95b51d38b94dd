"""The gripper's step: it waits for what the gripper itself says, and gives up in words."""

import numpy as np
import pytest

from stack.messages import Gripper, PlannerPhase, PlannerState, Restriction
from stack.strategic.motion import CYCLE_S, MotionInputs
from stack.strategic.profiled import Grip

PLANNER = PlannerState(PlannerPhase.EXECUTING, 0, Restriction.NONE, 1.0, 0)


def run(motion: Grip, says):
    """Cycle by cycle, the gripper saying `says(t)`; the last outputs and how long it took."""
    state, t = None, 0.0
    while t < 10.0:
        state, outputs = motion.step(state, MotionInputs(t, PLANNER, np.eye(3), grasped=says(t)))
        if outputs.done or outputs.failure is not None:
            return outputs, t
        assert outputs.gripper is motion.asked
        assert not outputs.twist.any()
        t += CYCLE_S
    raise AssertionError("never ends")


def test_it_closes_until_the_gripper_holds() -> None:
    outputs, t = run(Grip(Gripper.CLOSE), lambda t: t > 0.35)
    assert outputs.done
    assert t == pytest.approx(0.36, abs=CYCLE_S)


def test_it_opens_until_the_gripper_holds_nothing() -> None:
    outputs, t = run(Grip(Gripper.OPEN), lambda t: t < 0.2)
    assert outputs.done
    assert t == pytest.approx(0.2, abs=2 * CYCLE_S)


@pytest.mark.parametrize(
    ("asked", "says", "word"),
    [
        (Gripper.CLOSE, lambda t: False, "is empty"),
        (Gripper.CLOSE, lambda t: None, "was not heard"),
        (Gripper.OPEN, lambda t: True, "still holds"),
    ],
)
def test_a_gripper_that_does_not_do_it_ends_the_step_in_words(asked: Gripper, says, word: str) -> None:
    outputs, t = run(Grip(asked, patience_s=1.0), says)
    assert outputs.failure is not None
    assert word in outputs.failure
    assert t == pytest.approx(1.0, abs=2 * CYCLE_S)
