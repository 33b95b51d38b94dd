"""How the hand gives way to forces: the tables of the steps that guide and of those that pull a door, and the laws built from them."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from config.table import Finite, NotNegative, Positive, Table, Vector3
from stack.strategic.door import DoorGuess, LeafObjects, Pull, PullDoor
from stack.strategic.fence import Fence
from stack.strategic.force_guidance import Admittance, Pair, Tool
from stack.strategic.guide import Guide


class ToolTable(Table):
    """What hangs on the sensor, where the sensor does not take its weight off itself: centre of mass in the end-point frame."""

    mass_kg: Positive
    centre_m: Vector3 = (0.0, 0.0, 0.0)


class ForceSensorTable(Table):
    """The force/torque sensor: what its electronics take off the reading, `none`, the tool's `weight`, or weight and inertia (`motion`);
    its white noise from reading to reading."""

    compensation: Literal["none", "weight", "motion"] = "weight"
    force_noise_n: NotNegative = 0.05
    torque_noise_nm: NotNegative = 0.002


class GuidanceTable(Table):
    """An admittance of the TCP (see stack.strategic.force_guidance); unset keys keep the law's own numbers.

    `mass_kg`, `damping_n_s_m`: one number per axis of the end-point frame. `turning`: whether torques turn the hand, too.
    `gain = 0` switches it off. `fence_margin`: kinematic singularity margin at which a spring begins to pull the hand back, 0 for none.
    """

    gain: NotNegative = 1.0
    mass_kg: Annotated[tuple[Positive, Positive, Positive], Field()] = (25.0, 25.0, 25.0)
    damping_n_s_m: Annotated[tuple[Positive, Positive, Positive], Field()] = (55.0, 55.0, 55.0)
    inertia_kg_m2: Positive = 1.0
    turning_damping_n_m_s: Positive = 2.0
    turning: bool = False
    lead_s: NotNegative = 0.08
    filter_s: NotNegative = 0.0
    dead_band_n: NotNegative = 0.5
    dead_band_nm: NotNegative = 0.05
    saturation_n: Positive = 60.0
    saturation_nm: Positive = 6.0
    speed_m_s: Positive = 0.5
    rate_rad_s: Positive = 1.0
    acceleration_m_s2: Positive = 2.5
    turning_acceleration_rad_s2: Positive = 6.0
    fence_margin: NotNegative = 0.35
    tool: ToolTable | None = None


class DoorStepTable(Table):
    """Pulling a hinged door by its handle, from a guess of where its hinge is.

    `radius_m`: guessed distance of the handle from the axis; `hinge_direction`: guessed direction from the handle to the axis, in the
    reference frame; `axis`: guessed direction of the axis; a positive `angle_rad` turns about it by the right hand. `angle_rad`: how far
    to open. `identification = false` trusts the guess to the end. `follow`: share of the door's turning that the hand makes.
    """

    radius_m: Positive
    hinge_direction: Vector3
    axis: Vector3 = (0.0, 0.0, 1.0)
    angle_rad: Finite = math.radians(80.0)
    speed_m_s: Positive = 0.12
    feeling_speed_m_s: Positive = 0.05
    follow: Annotated[float, Field(ge=0, le=1)] = 1.0
    identification: bool = True

    @model_validator(mode="after")
    def _a_circle(self) -> DoorStepTable:
        axis, direction = np.array(self.axis), np.array(self.hinge_direction)
        if not axis.any():
            raise ValueError("axis must not be the zero vector")
        if np.linalg.norm(np.cross(axis, direction)) < 1e-3 * np.linalg.norm(axis):
            raise ValueError(f"hinge_direction {self.hinge_direction} must not lie along axis {self.axis}")
        if self.angle_rad == 0.0:
            raise ValueError("angle_rad must not be 0")
        return self


def guide(table: GuidanceTable, duration_s: float) -> Guide:
    """The motion of a step of kind `guide`."""
    return Guide(admittance(table), duration_s, Fence(margin=table.fence_margin))


def admittance(table: GuidanceTable) -> Admittance:
    """The law of a table."""
    tool = table.tool
    return Admittance(
        mass=np.array([*table.mass_kg, *[table.inertia_kg_m2] * 3]),
        damping=np.array([*table.damping_n_s_m, *[table.turning_damping_n_m_s] * 3]),
        lead_s=table.lead_s,
        filter_s=table.filter_s,
        dead_band=Pair(table.dead_band_n, table.dead_band_nm),
        saturation=Pair(table.saturation_n, table.saturation_nm),
        speed=Pair(table.speed_m_s, table.rate_rad_s),
        acceleration=Pair(table.acceleration_m_s2, table.turning_acceleration_rad_s2),
        guided=np.repeat([1.0, float(table.turning)], 3),
        gain=table.gain,
        tool=None if tool is None else Tool(tool.mass_kg, np.array(tool.centre_m)),
    )


def pull_door(table: DoorStepTable, leaf: LeafObjects | None) -> PullDoor:
    """The motion of a step of kind `door`; `leaf`: where the planner hears of the hinge."""
    guess = DoorGuess(table.radius_m, np.array(table.hinge_direction), np.array(table.axis))
    pull = Pull(
        angle=table.angle_rad,
        speed=table.speed_m_s,
        feeling_speed=table.feeling_speed_m_s,
        follow=table.follow,
        identify=table.identification,
    )
    return PullDoor(guess, pull, leaf=leaf)
