"""What is around the robot, in a recording: doors, tables, objects and the hand of a person in 3-D, forces as arrows and curves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import rerun as rr
from scipy.spatial.transform import Rotation

from logs import palette
from logs.palette import Color
from logs.signals import Decimation, Signal, SignalTable

RATE_HZ = 25.0
FORCE_SCALE = 0.004
"""Metres drawn per newton."""
HAND = "world/around/hand"
HAND_FORCE = "world/force/hand"
CONTACT_FORCE = "world/force/gripper"


@dataclass(frozen=True, slots=True)
class Part:
    """A box (`size` full lengths) or a cylinder along z (`size` diameter, diameter, length) with its middle `at`, in the body's frame."""

    size: tuple[float, float, float]
    at: tuple[float, float, float]
    color: Color
    shape: Literal["box", "cylinder"] = "box"


@dataclass(frozen=True, slots=True)
class Body:
    """A body with its pose (4, 4) in the world at the start; `row`: which of the truth's body poses it follows, None: it stands still."""

    name: str
    parts: tuple[Part, ...]
    pose: np.ndarray
    row: int | None = None


@dataclass(frozen=True, slots=True)
class Around:
    """Everything around the robot of a run; `door`: of which kind, if there is one."""

    bodies: tuple[Body, ...] = ()
    door: Literal["hinged", "sliding"] | None = None
    person: bool = False


NOTHING = Around()


class AroundScene:
    """Writes the 3-D entities of what is around, below `world/around` and `world/force`."""

    def __init__(self, around: Around) -> None:
        self._around = around
        self._paths = [f"world/around/{i}_{_plain(body.name)}" for i, body in enumerate(around.bodies)]
        self._poses, self._forces, self._hands = Decimation(RATE_HZ), Decimation(RATE_HZ), Decimation(RATE_HZ)

    def log_statics(self, recording: rr.RecordingStream) -> None:
        """Shapes, and where they are at the start."""
        for path, body in zip(self._paths, self._around.bodies, strict=True):
            still = body.row is None
            recording.log(path, _transform(body.pose), static=still)
            for shape in ("box", "cylinder"):
                parts = [part for part in body.parts if part.shape == shape]
                if parts:
                    recording.log(f"{path}/{shape}", _shapes(parts, shape), static=True)

    def send(self, signals: Mapping[str, Signal], send: Any) -> None:
        """Poses and forces of one block."""
        poses, wrench = signals.get("truth/body_poses"), signals.get("truth/contact_wrench")
        if poses is not None:
            rows = self._poses.due(poses.t_ns)
            for path, body in zip(self._paths, self._around.bodies, strict=True):
                if body.row is not None and len(rows):
                    send(path, poses.t_ns[rows], _transforms(poses.values[rows, body.row]))
        tcp = signals.get("truth/pose_WE")
        if (
            wrench is not None
            and tcp is not None
            and len(rows := self._forces.due(wrench.t_ns))
            and wrench.values.any()
        ):
            turn = tcp.values[rows, :3, :3]
            force = np.einsum("nij,nj->ni", turn, wrench.values[rows, :3])
            send(CONTACT_FORCE, wrench.t_ns[rows], _arrows(tcp.values[rows, :3, 3], force, palette.LIMIT))
        hand = signals.get("truth/hand")
        if hand is not None and len(rows := self._hands.due(hand.t_ns)):
            t_ns, at, force = hand.t_ns[rows], hand.values[rows, :3], hand.values[rows, 3:]
            n = len(rows)
            send(HAND, t_ns, rr.Points3D.columns(positions=at, colors=[palette.VIOLET] * n, radii=[0.035] * n))
            send(HAND_FORCE, t_ns, _arrows(at, force, palette.VIOLET))


def around_values(signals: Mapping[str, Signal], around: Around) -> Iterable[tuple[str, Signal]]:
    """Entity path and values of the curves."""
    door, force, hand = (signals.get(f"truth/{name}") for name in ("door", "handle_force", "hand"))
    if door is not None:
        scale = np.array([180.0 / np.pi if around.door == "hinged" else 1e3])
        yield _opening(around), Signal(door.t_ns, door.values[:, :1] * scale)
    if force is not None:
        yield "door/handle_force_N", force
    if hand is not None:
        yield "hand/force_N", Signal(hand.t_ns, np.linalg.norm(hand.values[:, 3:], axis=1, keepdims=True))


def around_series(around: Around) -> tuple[tuple[str, tuple[str, ...], tuple[Color, ...]], ...]:
    """Path, names and colours of the curves of a run with these surroundings."""
    door = (
        (_opening(around), ("door",), (palette.TRUE,)),
        ("door/handle_force_N", ("along its way", "across", "along the handle"), palette.AXES),
    )
    hand = (("hand/force_N", ("hand",), (palette.VIOLET,)),)
    return (*(door if around.door else ()), *(hand if around.person else ()))


def _opening(around: Around) -> str:
    """The curve of how far the door is open."""
    return "door/opening_deg" if around.door == "hinged" else "door/opening_mm"


def around_views(around: Around) -> dict[str, tuple[str, ...]]:
    """Entity paths by the title of their plot."""
    unit = "°" if around.door == "hinged" else "mm"
    door = {
        f"Door, open [{unit}]": (_opening(around),),
        "Force on the handle [N]": ("door/handle_force_N",),
    }
    return {**(door if around.door else {}), **({"Force of the hand [N]": ("hand/force_N",)} if around.person else {})}


def around_metrics(table: SignalTable, door: str | None) -> dict[str, float | None]:
    """How far the door is open at the end, forces on its handle while it is held and of the hand while it pulls; N, sampled at SYNC.

    `handle_force_across_*`: the part of the force that is not along the handle's way. None where there is no door, no person.
    """
    way, handle, hand = (table.get(f"truth/{name}") for name in ("door", "handle_force", "hand"))
    last = None if way is None else float(way.values[-1, 0])
    held = np.empty((0, 3)) if handle is None else handle.values[handle.values.any(axis=1)]
    across = np.hypot(held[:, 1], held[:, 2])
    pull = np.empty(0) if hand is None else np.linalg.norm(hand.values[:, 3:], axis=1)
    pull = pull[pull > 0.0]
    return {
        "door_angle_rad": last if door == "hinged" else None,
        "door_way_m": last if door == "sliding" else None,
        "handle_force_along_max_n": _largest(np.abs(held[:, 0])),
        "handle_force_across_max_n": _largest(across),
        "handle_force_across_p99_n": _percentile(across),
        "hand_force_max_n": _largest(pull),
        "hand_force_p99_n": _percentile(pull),
    }


def _largest(values: np.ndarray) -> float | None:
    return float(values.max()) if len(values) else None


def _percentile(values: np.ndarray) -> float | None:
    return float(np.percentile(values, 99)) if len(values) else None


def _plain(name: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in name)


def _transform(pose: np.ndarray) -> rr.Transform3D:
    return rr.Transform3D(translation=pose[:3, 3], quaternion=Rotation.from_matrix(pose[:3, :3]).as_quat())


def _transforms(poses: np.ndarray) -> Any:
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    return rr.Transform3D.columns(translation=poses[:, :3, 3], quaternion=turns)


def _shapes(parts: Sequence[Part], shape: str) -> rr.Boxes3D | rr.Cylinders3D:
    at, colors = [part.at for part in parts], [part.color for part in parts]
    fill = rr.components.FillMode.Solid
    if shape == "box":
        return rr.Boxes3D(centers=at, sizes=[part.size for part in parts], colors=colors, fill_mode=fill)
    return rr.Cylinders3D(
        centers=at,
        lengths=[part.size[2] for part in parts],
        radii=[part.size[0] / 2 for part in parts],
        colors=colors,
        fill_mode=fill,
    )


def _arrows(at: np.ndarray, force: np.ndarray, color: Color) -> Any:
    n = len(at)
    return rr.Arrows3D.columns(origins=at, vectors=FORCE_SCALE * force, colors=[color] * n, radii=[0.008] * n)


__all__ = ["Around", "AroundScene", "Body", "Part", "around_metrics", "around_series", "around_values", "around_views"]
