"""Manipulability maps: made once with a progress bar, kept in .cache/maps, drawn like the figures of the thesis."""

from __future__ import annotations

import hashlib
from dataclasses import fields
from pathlib import Path
from typing import TypeVar

import numpy as np

from canipulator.outcome import progress_bar
from stack.kinematics import ArmModel
from stack.kinematics import manipulability_map as maps
from stack.kinematics.manipulability_map import PoseMap, RadiusMap
from stack.kinematics.robot_file import robot_directory

CACHE = Path(__file__).parents[1] / ".cache" / "maps"
RADIUS_SAMPLES, POSE_SAMPLES = 2_000_000, 10_000_000
M = TypeVar("M", RadiusMap, PoseMap)


def radius_map(arm: ArmModel, samples: int = RADIUS_SAMPLES, *, quiet: bool = False) -> RadiusMap:
    """The wrist centre's map of `arm`, from the cache if it is there."""
    return _cached(RadiusMap, arm, samples, quiet)


def pose_map(arm: ArmModel, samples: int = POSE_SAMPLES, *, quiet: bool = False) -> PoseMap:
    """The hand's map of `arm`, from the cache if it is there."""
    return _cached(PoseMap, arm, samples, quiet)


def _cached(kind: type[M], arm: ArmModel, samples: int, quiet: bool) -> M:
    path = CACHE / f"{kind.__name__}-{arm.name}-{samples}-{_state_of(arm)}.npz"
    if path.is_file():
        with np.load(path) as stored:
            return kind(**{name: stored[name] for name in stored.files})
    done = 0
    with progress_bar(f"manipulability map of {arm.name}", samples, quiet=quiet) as bar:

        def advance(more: int) -> None:
            nonlocal done
            done += more
            bar(done, f"{done:,} of {samples:,} postures")

        made = (
            maps.radius_map(arm, samples, advance=advance)
            if kind is RadiusMap
            else maps.pose_map(arm, samples, advance=advance)
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".part.npz")
    np.savez_compressed(partial, **{field.name: getattr(made, field.name) for field in fields(made)})
    partial.replace(path)
    return made  # type: ignore[return-value]


def _state_of(arm: ArmModel) -> str:
    """Whatever a map depends on: the robot's files and the code that makes it."""
    digest = hashlib.sha256()
    for path in (
        robot_directory(arm.name) / "robot.toml",
        robot_directory(arm.name) / "robot.urdf",
        Path(str(maps.__file__)),
    ):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
