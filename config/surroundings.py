"""What stands around the robot: the tables of doors, people, tables, walls, objects, and of the gripper that takes hold of them."""

from __future__ import annotations

import itertools
from typing import Annotated, Literal

from pydantic import Field, model_validator

from config.table import Finite, NotNegative, Positive, Table, Vector3

Point2 = Annotated[tuple[Finite, Finite], Field()]
Size3 = Annotated[tuple[Positive, Positive, Positive], Field()]


class DoorTable(Table):
    """A door. `handle_m`: middle of the bar in the world when the door is shut; `heading_rad`: hinged: from the handle to the hinge;
    sliding: the way it opens; `side`: where the hand is (and a hinged door opens to), looking along `heading_rad`.

    Hinged: `radius_m` from axis to bar, `travel`, `start` rad, `friction`, `catch`, `closer_preload` N·m, `damping` N·m·s/rad,
    `closer_stiffness` N·m/rad. Sliding: `width_m` of the panel, `travel`, `start` m, friction and the like in N, N·s/m, N/m.
    Unset keys: see `DOOR_DEFAULTS`.
    """

    kind: Literal["hinged", "sliding"]
    handle_m: Vector3
    heading_rad: Finite
    side: Literal["left", "right"] = "right"
    radius_m: Positive | None = None
    width_m: Positive | None = None
    height_m: Positive = 2.0
    thickness_m: Positive = 0.04
    mass_kg: Positive | None = None
    travel: Positive | None = None
    start: NotNegative = 0.0
    friction: NotNegative | None = None
    damping: NotNegative | None = None
    closer_stiffness: NotNegative = 0.0
    closer_preload: NotNegative = 0.0
    catch: NotNegative = 0.0
    catch_width: Positive = 0.02
    standoff_m: Positive = 0.07
    bar_length_m: Positive = 0.2
    grasp: Literal["pivot", "rigid"] = "pivot"

    @model_validator(mode="after")
    def _of_one_kind(self) -> DoorTable:
        foreign = "width_m" if self.kind == "hinged" else "radius_m"
        if getattr(self, foreign) is not None:
            raise ValueError(f"a {self.kind} door has no {foreign}")
        travel = self.travel if self.travel is not None else DOOR_DEFAULTS[self.kind]["travel"]
        if self.start > travel:
            raise ValueError(f"start = {self.start:g} must not exceed travel = {travel:g}")
        return self


DOOR_DEFAULTS: dict[str, dict[str, float]] = {
    "hinged": {"radius_m": 0.8, "mass_kg": 15.0, "travel": 1.75, "friction": 0.5, "damping": 0.5},
    "sliding": {"width_m": 0.9, "mass_kg": 20.0, "travel": 0.9, "friction": 6.0, "damping": 4.0},
}
"""What the two kinds of doors are where a scenario says nothing."""


class WanderTable(Table):
    """A random smooth way of the hand, drawn from the scenario's seed: strokes inside a box around where it gripped."""

    box_m: Annotated[tuple[NotNegative, NotNegative, NotNegative], Field()] = (0.4, 0.4, 0.3)
    speed_m_s: Positive = 0.25
    duration_s: Positive


class PersonTable(Table):
    """A hand that leads the gripper, by a spring and damper of limited force. Its way is either `waypoints`, rows of t (s), x, y, z (m,
    world axes, from where it gripped), or `wander`; where both are given, `path` says which: recorded or random."""

    stiffness_n_m: Annotated[float, Field(ge=10.0, le=10_000.0)] = 500.0
    damping_n_s_m: NotNegative = 20.0
    strength_n: Positive = 150.0
    grips_s: NotNegative = 0.0
    lets_go_s: Positive | None = None
    waypoints: tuple[Annotated[tuple[NotNegative, Finite, Finite, Finite], Field()], ...] | None = None
    wander: WanderTable | None = None
    path: Literal["recorded", "random"] | None = None

    @model_validator(mode="after")
    def _one_way(self) -> PersonTable:
        if self.path is None and (self.waypoints is None) == (self.wander is None):
            raise ValueError("a person needs either waypoints or wander, or path to choose between both")
        if (self.path == "recorded" and self.waypoints is None) or (self.path == "random" and self.wander is None):
            raise ValueError(f"path = {self.path!r} needs {'waypoints' if self.path == 'recorded' else 'wander'}")
        if self.waypoints is not None:
            times = [row[0] for row in self.waypoints]
            if len(times) < 2 or any(b <= a for a, b in itertools.pairwise(times)):
                raise ValueError(f"waypoints need at least two rows with increasing times, got {times}")
        if self.lets_go_s is not None and self.lets_go_s <= self.grips_s:
            raise ValueError(f"lets_go_s = {self.lets_go_s:g} must be later than grips_s = {self.grips_s:g}")
        return self


class FurnitureTable(Table):
    """A table: `size_m` length, width, height; `position_m` of its middle on the floor."""

    name: str = "table"
    size_m: Size3
    position_m: Point2
    heading_rad: Finite = 0.0
    top_m: Positive = 0.03

    @model_validator(mode="after")
    def _has_legs(self) -> FurnitureTable:
        if self.top_m >= self.size_m[2]:
            raise ValueError(f"top_m = {self.top_m:g} must be less than the height {self.size_m[2]:g}")
        return self


class WallTable(Table):
    """A block that stands on the floor: `size_m`, `position_m` of its middle."""

    name: str = "wall"
    size_m: Size3
    position_m: Point2
    heading_rad: Finite = 0.0


class ObjectTable(Table):
    """Something that a gripper can take: `size_m` (a cylinder: diameter, diameter, height), `position_m` of the middle of its underside;
    `goal_m`: where that shall be at the end, for the metric `object_goal_error_max_m`."""

    name: str
    shape: Literal["box", "cylinder"] = "box"
    size_m: Size3
    position_m: Vector3
    heading_rad: Finite = 0.0
    mass_kg: Positive = 0.3
    friction: NotNegative = 0.6
    goal_m: Vector3 | None = None

    @model_validator(mode="after")
    def _round(self) -> ObjectTable:
        if self.shape == "cylinder" and self.size_m[0] != self.size_m[1]:
            raise ValueError(f"size_m = {self.size_m}: a cylinder has the same diameter both ways")
        return self


class GripperTable(Table):
    """The robot's gripper: `reach_m` from the TCP within which it finds what it closes around; its pads; `strength_n` of its hold."""

    closing_s: NotNegative = 0.3
    reach_m: Positive = 0.03
    stiffness_n_m: Positive = 20_000.0
    turning_stiffness_nm_rad: Positive = 40.0
    strength_n: Positive = 300.0
