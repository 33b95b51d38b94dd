"""What each kind of fault does to the robot, its nodes and its machine, and how it is undone. Faults of frames: frame_faults.py."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from canipulator.roles import OnEvent
from config.faults import FaultTable
from drivers.bus.base import OnFrame
from drivers.bus.lockstep import LockstepBus
from drivers.canopen.node import CanopenNode
from drivers.catalogue import DRIVE_IDS
from drivers.cia402.device import Drive
from drivers.clock import Clock
from drivers.objects import DeviceDef
from sim.faults import Breakable

BABBLE_FRAMES = 48
BABBLE_NS = 2_000_000
Undo = Callable[[], None]


def nothing() -> None:
    """A fault that leaves nothing to undo."""


@dataclass
class Parts:
    """What faults befall. `files`: name -> descriptor of the open file. `on_spoilt` gets each frame that nobody received, or not as it
    was sent, as it was sent."""

    clock: Clock
    bus: LockstepBus
    devices: Mapping[int, DeviceDef]
    drives: Sequence[Drive]
    breakable: Breakable
    planner: CanopenNode
    strategic: CanopenNode
    files: Mapping[str, Callable[[], int]]
    on_event: OnEvent
    on_spoilt: OnFrame


def port_name(parts: Parts, node: int) -> str:
    """The port of a node; one that is not there is named by its number, and never sends."""
    device = parts.devices.get(node)
    return f"node {node}" if device is None else device.name


# ---- on the bus


def _bus_off(parts: Parts, fault: FaultTable) -> Undo:
    name = port_name(parts, fault.value("node"))
    ports = [port for port in parts.bus.port_names if port == name or port.startswith(f"{name} ")]
    for port in ports:
        parts.bus.disconnect(port)

    def back() -> None:
        for port in ports:
            parts.bus.reconnect(port)

    return back


def _babble(parts: Parts, fault: FaultTable) -> Undo:
    name = _free_name(parts, "babbling idiot")
    port = parts.bus.attach(name, [], lambda frame: None)
    can_id = fault.value("can_id")

    def talk() -> None:
        if port.online:
            for _ in range(BABBLE_FRAMES - port.queued):
                port.send(can_id, b"\xaa" * 8)
            parts.clock.call_at(parts.clock.now_ns() + BABBLE_NS, talk)

    talk()
    return lambda: parts.bus.disconnect(name)


def _duplicate(parts: Parts, fault: FaultTable) -> Undo:
    device = parts.devices[fault.value("node")]
    twin = CanopenNode(replace(device, name=_free_name(parts, f"twin of {device.name}")), parts.clock, parts.bus)
    twin.power_on()
    return twin.power_off


def _free_name(parts: Parts, name: str) -> str:
    taken = parts.bus.port_names
    return next(free for n in range(1, 1000) if (free := f"{name} {n}") not in taken)


# ---- in the drives and what they are bolted to


def _axis(fault: FaultTable) -> int:
    return DRIVE_IDS.index(fault.value("node"))


def _reboot(parts: Parts, fault: FaultTable) -> Undo:
    drive = parts.drives[_axis(fault)]
    drive.power_off()
    return drive.power_on


def _over_current(parts: Parts, fault: FaultTable) -> Undo:
    parts.drives[_axis(fault)].trip()
    return nothing


def _jam(parts: Parts, fault: FaultTable) -> Undo:
    plant, axis = parts.breakable.plant, _axis(fault)
    plant.jam(axis, True)
    return partial(plant.jam, axis, False)


def _encoder_jump(parts: Parts, fault: FaultTable) -> Undo:
    plant, axis, distance = parts.breakable.plant, _axis(fault), fault.value("amount")
    plant.shift_encoder(axis, distance)
    return partial(plant.shift_encoder, axis, -distance)


def _encoder_frozen(parts: Parts, fault: FaultTable) -> Undo:
    plant, axis = parts.breakable.plant, _axis(fault)
    plant.freeze_encoder(axis, True)
    return partial(plant.freeze_encoder, axis, False)


def _encoder_lost(parts: Parts, fault: FaultTable) -> Undo:
    plant, axis = parts.breakable.plant, _axis(fault)
    plant.lose_encoder(axis, True)
    return partial(plant.lose_encoder, axis, False)


def _weak(parts: Parts, fault: FaultTable) -> Undo:
    plant, axis = parts.breakable.plant, _axis(fault)
    plant.weaken(axis, fault.value("amount"))
    return partial(plant.weaken, axis, 1.0)


def _wheel_blocked(parts: Parts, fault: FaultTable) -> Undo:
    plant, wheel = parts.breakable.plant, _axis(fault)
    plant.block_wheel(wheel, True)
    return partial(plant.block_wheel, wheel, False)


def _wheel_slip(parts: Parts, fault: FaultTable) -> Undo:
    plant, wheel = parts.breakable.plant, _axis(fault)
    plant.slip_wheel(wheel, 1.0 - fault.value("amount"))
    return partial(plant.slip_wheel, wheel, 1.0)


# ---- in the other nodes


def _planner_killed(parts: Parts, fault: FaultTable) -> Undo:
    parts.planner.power_off()
    return nothing


def _strategic_killed(parts: Parts, fault: FaultTable) -> Undo:
    parts.strategic.power_off()
    return nothing


def _force_stuck(parts: Parts, fault: FaultTable) -> Undo:
    force = parts.breakable.force
    force.stick(True)
    return partial(force.stick, False)


def _force_saturated(parts: Parts, fault: FaultTable) -> Undo:
    force = parts.breakable.force
    force.saturate(fault.value("amount"))
    return partial(force.saturate, None)


def _force_nan(parts: Parts, fault: FaultTable) -> Undo:
    force = parts.breakable.force
    force.break_down(True)
    return partial(force.break_down, False)


def _feedback_lost(parts: Parts, fault: FaultTable) -> Undo:
    camera = parts.breakable.camera
    if camera is None:
        return nothing
    camera.blind = True

    def sees() -> None:
        camera.blind = False

    return sees


# ---- in the machine that all of it runs on


def _disk_full(parts: Parts, fault: FaultTable) -> Undo:
    """From now on the file is the device that is always full: the kernel itself says so to whoever writes."""
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, parts.files[fault.value("file")]())
    os.close(full)
    return nothing


def _sigkill(parts: Parts, fault: FaultTable) -> Undo:
    os.kill(os.getpid(), signal.SIGKILL)
    return nothing


INJECTIONS: dict[str, Callable[[Parts, FaultTable], Undo]] = {
    "bus-off": _bus_off,
    "babbling-idiot": _babble,
    "duplicate-node": _duplicate,
    "drive-reboot": _reboot,
    "drive-stuck": _jam,
    "over-current": _over_current,
    "encoder-jump": _encoder_jump,
    "encoder-frozen": _encoder_frozen,
    "encoder-lost": _encoder_lost,
    "following-error": _weak,
    "planner-killed": _planner_killed,
    "strategic-killed": _strategic_killed,
    "force-stuck": _force_stuck,
    "force-saturated": _force_saturated,
    "force-nan": _force_nan,
    "wheel-blocked": _wheel_blocked,
    "wheel-slip": _wheel_slip,
    "feedback-lost": _feedback_lost,
    "disk-full": _disk_full,
    "sigkill": _sigkill,
}
