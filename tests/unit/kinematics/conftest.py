import json
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from stack.kinematics import ArmModel

VECTORS = json.loads((Path(__file__).parent / "thesis_vectors.json").read_text())
ROBOTS = ("moma8", "planar3", "kr15", "comau_racer7", "iiwa14", "panda")

load = cache(ArmModel.load)


@pytest.fixture(scope="session")
def moma8() -> ArmModel:
    return load("moma8")


@pytest.fixture(params=ROBOTS)
def any_arm(request: pytest.FixtureRequest) -> ArmModel:
    return load(request.param)


def dh_frames(rows: list[tuple[bool, float, float, float]], q: np.ndarray) -> list[np.ndarray]:
    """The textbook, independent of the URDF: frames 0 … n of standard DH rows (revolute, d, a, alpha)."""
    frames = [np.eye(4)]
    for (revolute, d, a, alpha), angle in zip(rows, q, strict=True):
        theta, lift = (angle, d) if revolute else (0.0, d + angle)
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        step = [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, lift], [0, 0, 0, 1]]
        frames.append(frames[-1] @ np.array(step))
    return frames


def derivative(f: Callable[[np.ndarray], np.ndarray], q: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Central differences, one column for each entry of q."""
    return np.array([(f(q + h) - f(q - h)) / (2 * step) for h in step * np.eye(len(q))]).T
