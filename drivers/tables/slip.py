"""The planner's slip observer as objects, and the frame in which it tells what it believes."""

from __future__ import annotations

from drivers.objects import Access, DataType, ObjectDef
from drivers.tables.communication import U8, array
from drivers.tables.fast import FastFrame, Signal, vector
from stack.planner.observer import SlipModel

I16, U32, REAL32 = DataType.INTEGER16, DataType.UNSIGNED32, DataType.REAL32

SLIP_OBSERVER, SLIP_MODEL = 0x200C, 0x2015
SLIP, MEASUREMENTS = 0x2060, 0x2061
SLIP_COB_ID = 0x4E4
"""TPDO 6 has no identifier of its own; this is TPDO 4 of node 100, which nobody is: the frame with the least to say."""
SLIP_SCALE = 1e-5
MODEL_FIELDS = ("position_noise_m", "rotation_noise_rad", "sigma", "tau_s", "learning_s")
"""Of `SlipModel`, in the order of the sub-indices of 2015h."""
_ENTRIES = (
    ("feedback noise position", 0.0, 1.0, "m"),
    ("feedback noise rotation", 0.0, 1.0, "rad"),
    ("slip sigma", 0.0, 1.0, ""),
    ("slip tau", 1e-2, 1e3, "s"),
    ("slip learning", 0.0, 1e3, "s"),
)

SLIP_FRAME = FastFrame(
    6,
    "slip",
    0x2106,
    (*vector("slip_left slip_right", I16, "", SLIP_SCALE), Signal("measured", U8), Signal("rejected", U8)),
    cob_id=SLIP_COB_ID,
)
"""Slip ratios of the wheels; tracked poses that were taken in and rejected, both counted modulo 256."""


def slip_objects() -> list[ObjectDef]:
    """200Ch, 2015h: standard deviations of a tracked pose, slip as a process; 2060h, 2061h: what became of it."""
    model = SlipModel()
    return [
        ObjectDef(SLIP_OBSERVER, 0, "Slip observer", U8, Access.RW, 1, low=0, high=1),
        ObjectDef(SLIP_MODEL, 0, "Slip model: number of entries", U8, Access.CONST, len(_ENTRIES)),
        *(
            ObjectDef(SLIP_MODEL, i, name, REAL32, Access.RW, getattr(model, key), low=low, high=high, unit=unit)
            for i, (key, (name, low, high, unit)) in enumerate(zip(MODEL_FIELDS, _ENTRIES, strict=True), start=1)
        ),
        *array(SLIP, "Slip ratio", ("left", "right"), REAL32, access=Access.RO),
        *array(MEASUREMENTS, "Tracked poses", ("taken in", "rejected"), U32, access=Access.RO),
    ]
