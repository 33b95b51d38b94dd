"""The planner: its state and reference as fast frames, its parameters as objects (2000h …)."""

from __future__ import annotations

from drivers.objects import Access, DataType, DeviceDef, ObjectDef
from drivers.tables.communication import U8, U16, Identity, array
from drivers.tables.fast import FastFrame, Signal, fast_device, vector
from drivers.tables.platform_path import platform_path_objects
from drivers.tables.slip import SLIP_FRAME, slip_objects
from stack.messages import SingularityKind
from stack.planner.leaf import LeafMotion
from stack.planner.parameters import Coordination, Method

I16, I24, REAL32 = DataType.INTEGER16, DataType.INTEGER24, DataType.REAL32

POSITION_SCALE_M = 2e-6
ROTATION_SCALE_RAD = 1e-4
PATH_SCALE_ONE = 65535

JOINT_NAMES = tuple(f"joint {i}" for i in range(1, 9))
WEIGHT_NAMES = (*JOINT_NAMES, "platform v", "platform omega")
MANIFOLD_NAMES = ("L1", "L2", "L3", "L4", "F1", "F2", "F3p", "F3m")
"""Of the robot's singular manifolds, in the order of `stack.planner.singularities.manifolds`."""
KIND_NAMES = ("KS", "AS", "SS", "SAS")
SINGULARITY_COB_ID = 0x4E2
"""TPDO 5 has no identifier of its own; this is TPDO 4 of node 98, which nobody is, and yields to all that control needs."""
MARGIN_SCALE = 1 / 255
PREFERENCE_NAMES = (*JOINT_NAMES, "unused 9", "unused 10")


MODE, METHOD, COORDINATION, PHASE, RESTRICTIONS, NULL_SPACE_MOTION, STATUS, PATH_SCALE, JOINT_LIMIT_RULES = range(
    0x2000, 0x2009
)
REPULSION, CIRCUMVENTION, COLLISION_AVOIDANCE = range(0x2009, 0x200C)
PREFERRED_CONFIGURATION, HEIGHTS, WIDTHS, WEIGHTS, PLATFORM = range(0x2010, 0x2015)
CONFIGURATION, TCP_POSITION, TCP_ROTATION_VECTOR = range(0x2020, 0x2023)
SINGULAR_VALUES, MANIPULABILITY = range(0x2030, 0x2032)
SINGULARITY_MARGINS, SINGULARITY_KIND, NEAREST_MANIFOLD, MANIFOLD_MARGINS, SINGULARITY_RADIUS = range(0x2040, 0x2045)
PLATFORM_ANGLE, PLATFORM_GAIN, PLATFORM_MAX_RATE, PLATFORM_FEED_FORWARD, PLATFORM_SPEED = range(1, 6)
"""Sub-indices of 2014h."""
OBSTACLES = range(0x2050, 0x2054)
OBSTACLE_NAMES = ("x", "y", "z", "length", "width", "height", "yaw")
"""A box in the reference frame, m and rad; one without height, width or length is none."""
DOOR_LEAF, DOOR_MOTION, DOOR_OPENING = 0x2054, 0x2055, 0x2056
DOOR_NAMES = (*OBSTACLE_NAMES, "handle x", "handle y", "hinge x", "hinge y")
"""The leaf when the door is shut, in the reference frame, and where its handle and its hinge are then. Writing the motion takes all of it
over, so that nothing is seen half written."""
LEAST_WIDTH, LEAST_WEIGHT = 1e-3, 1e-4
"""A width divides, and a weight of zero leaves the criterion without a minimum."""

FRAMES = (
    FastFrame(
        1,
        "state",
        0x2101,
        (
            Signal("phase", U8, key=(PHASE, 0)),
            Signal("status", U8, key=(STATUS, 0)),
            Signal("restrictions", U16, key=(RESTRICTIONS, 0)),
            Signal("path_scale", U16, key=(PATH_SCALE, 0), scale=1 / PATH_SCALE_ONE),
        ),
    ),
    FastFrame(2, "reference_xy", 0x2102, vector("x y", I24, "m", POSITION_SCALE_M)),
    FastFrame(
        3,
        "reference_z",
        0x2103,
        (Signal("z", I24, "m", POSITION_SCALE_M), Signal("valid", U8, high=1), Signal("sync_count", U16)),
    ),
    FastFrame(4, "reference_rotation", 0x2104, vector("rx ry rz", I16, "rad", ROTATION_SCALE_RAD)),
    FastFrame(
        5,
        "singularity",
        0x2105,
        (
            Signal("singularity_kind", U8, key=(SINGULARITY_KIND, 0)),
            Signal("nearest_manifold", U8, key=(NEAREST_MANIFOLD, 0)),
            *vector(" ".join(f"margin_{name}" for name in KIND_NAMES), U8, "", MARGIN_SCALE),
        ),
        cob_id=SINGULARITY_COB_ID,
    ),
    SLIP_FRAME,
)


def planner(node_id: int, watched: list[int]) -> DeviceDef:
    """The planner produces SYNC and watches the heartbeats of `watched`, i.e. of everybody else."""
    identity = Identity("planner", 3, sync_producer=True)
    return fast_device("planner", node_id, identity, FRAMES, _parameters(), watched)


def _parameters() -> list[ObjectDef]:
    return [
        ObjectDef(MODE, 0, "Mode", U8, Access.RO, 0),
        ObjectDef(METHOD, 0, "Method", U8, Access.RW, Method.PNS, low=0, high=max(Method)),
        ObjectDef(COORDINATION, 0, "Coordination", U8, Access.RW, Coordination.ABC, low=0, high=max(Coordination)),
        ObjectDef(PHASE, 0, "Phase", U8, Access.RO, 0, mappable=True),
        ObjectDef(RESTRICTIONS, 0, "Restrictions", U16, Access.RO, 0, mappable=True),
        ObjectDef(NULL_SPACE_MOTION, 0, "Null space motion", U8, Access.RW, 1, low=0, high=1),
        ObjectDef(JOINT_LIMIT_RULES, 0, "Joint limit rules", U8, Access.RW, 1, low=0, high=1),
        ObjectDef(REPULSION, 0, "Repulsion", U8, Access.RW, 0, low=0, high=1),
        ObjectDef(CIRCUMVENTION, 0, "Circumvention", U8, Access.RW, 0, low=0, high=1),
        ObjectDef(COLLISION_AVOIDANCE, 0, "Collision avoidance", U8, Access.RW, 0, low=0, high=1),
        ObjectDef(STATUS, 0, "Status", U8, Access.RO, 0, mappable=True),
        ObjectDef(PATH_SCALE, 0, "Path scale", U16, Access.RO, PATH_SCALE_ONE, mappable=True, scale=1 / PATH_SCALE_ONE),
        # joint 2 is the lift: metres where the others have radians
        *array(PREFERRED_CONFIGURATION, "Preferred configuration", PREFERENCE_NAMES, REAL32),
        *array(HEIGHTS, "Heights of the preferences", PREFERENCE_NAMES, REAL32, low=0.0),
        *array(WIDTHS, "Widths of the preferences", PREFERENCE_NAMES, REAL32, defaults=[1.0] * 10, low=LEAST_WIDTH),
        *array(WEIGHTS, "Weights of the motions", WEIGHT_NAMES, REAL32, defaults=[1.0] * 10, low=LEAST_WEIGHT),
        *array(PLATFORM, "Platform", ("angle", "gain", "max rate", "feed forward", "speed"), REAL32),
        *(
            entry
            for number, index in enumerate(OBSTACLES, start=1)
            for entry in array(index, f"Obstacle {number}", OBSTACLE_NAMES, REAL32)
        ),
        *array(DOOR_LEAF, "Door leaf", DOOR_NAMES, REAL32),
        ObjectDef(DOOR_MOTION, 0, "Door motion", U8, Access.RW, LeafMotion.ABSENT, low=0, high=max(LeafMotion)),
        ObjectDef(DOOR_OPENING, 0, "Door opening", REAL32, Access.RO, 0.0),
        *platform_path_objects(),
        *slip_objects(),
        *array(CONFIGURATION, "Configuration", JOINT_NAMES, REAL32, access=Access.RO),
        *array(TCP_POSITION, "TCP position", ("x", "y", "z"), REAL32, access=Access.RO, unit="m"),
        *array(TCP_ROTATION_VECTOR, "TCP rotation vector", ("x", "y", "z"), REAL32, access=Access.RO, unit="rad"),
        *array(SINGULAR_VALUES, "Singular values", [f"sigma {i}" for i in range(1, 7)], REAL32, access=Access.RO),
        *array(SINGULARITY_MARGINS, "Singularity margins", KIND_NAMES, REAL32, access=Access.RO),
        ObjectDef(SINGULARITY_KIND, 0, "singularity_kind", U8, Access.RO, 0, mappable=True, high=max(SingularityKind)),
        ObjectDef(NEAREST_MANIFOLD, 0, "nearest_manifold", U8, Access.RO, 0, mappable=True, high=len(MANIFOLD_NAMES)),
        *array(MANIFOLD_MARGINS, "Manifold margins", MANIFOLD_NAMES, REAL32, access=Access.RO, unit="rad"),
        ObjectDef(SINGULARITY_RADIUS, 0, "Singularity radius", REAL32, Access.RW, 0.1, low=0.0, high=1.0),
        *array(MANIPULABILITY, "Manipulability", ("arm", "robot"), REAL32, access=Access.RO),
    ]
