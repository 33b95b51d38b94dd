"""The one place where injected faults meet the wire: a function that judges each frame as it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from drivers.frame import Frame


@dataclass(frozen=True, slots=True)
class Verdict:
    """What happens to a frame that has just been on the wire (and has taken its time there in any case).

    drop: nobody gets it, observers included, and its sender does not notice.
    delay_ns: everybody gets it that much later, as from a slow gateway.
    data: replaces the payload: corruption that the CRC did not see.
    repeat: its sender sees no acknowledgement and sends it once more: everybody gets it twice.
    wire_error: the receivers saw a bit error: an error frame follows and the sender's controller repeats the frame.
    bus_off: the sender's controller leaves the bus after this frame; what it had queued is lost.
    """

    drop: bool = False
    delay_ns: int = 0
    data: bytes | None = None
    repeat: bool = False
    wire_error: bool = False
    bus_off: bool = False


Intercept = Callable[[str, Frame], Verdict | None]
"""(name of the sending port, frame) -> None for a frame that nothing happens to."""
