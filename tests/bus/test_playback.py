"""A recorded bus in front of a node: what it hears and when, what is made of what it sends."""

from drivers.bus.lockstep import LockstepBus
from drivers.bus.playback import Pair, PlaybackBus
from drivers.clock import LockstepClock
from drivers.frame import Frame

OWN, OTHER, LATE = 0x200, 0x180, 0x700
US = 1000


class Echo:
    """Sends a frame whenever it hears one; the first byte is that of what it heard, plus `offset`."""

    def __init__(self, offset: int = 0, can_id: int = OWN) -> None:
        self.offset, self.can_id = offset, can_id
        self.heard: list[Frame] = []

    def attach(self, bus: LockstepBus | PlaybackBus) -> None:
        self.port = bus.attach("echo", [OTHER], self.on_frame)

    def on_frame(self, frame: Frame) -> None:
        self.heard.append(frame)
        self.port.send(self.can_id, bytes([frame.data[0] + self.offset]))


def recorded() -> tuple[list[Frame], list[Frame]]:
    """Frames of a lockstep run of an echo, in a log's resolution, and those that it heard."""
    clock, log, echo = LockstepClock(), [], Echo()
    bus = LockstepBus(clock)
    bus.observe(log.append)
    echo.attach(bus)
    other = bus.attach("other", [], lambda frame: None)
    for i in range(10):
        clock.call_at(i * 700 * US, lambda i=i: (other.send(LATE, bytes([i])), other.send(OTHER, bytes([i]))))
    clock.run_until(20_000 * US)
    return [frame._replace(t_ns=frame.t_ns // US * US) for frame in log], echo.heard


def play(
    frames: list[Frame], node: Echo, own: frozenset[int] = frozenset({OWN}), as_sent: list[Frame] | None = None
) -> list[Pair]:
    clock, pairs = LockstepClock(), []
    bus = PlaybackBus(clock, frames, own, pairs.append, as_sent=as_sent or [])
    node.attach(bus)
    bus.start()
    while not bus.ended:
        clock.run_until(clock.now_ns() + 1_000_000 * US)
    return pairs


def test_the_same_node_hears_the_same_and_all_its_frames_are_the_same() -> None:
    frames, heard = recorded()
    node = Echo()
    pairs = play(frames, node)
    assert node.heard == heard
    assert len(pairs) == 10
    assert all(pair.same for pair in pairs)


def test_other_bytes_are_a_pair_that_differs() -> None:
    pairs = play(recorded()[0], Echo(offset=3))
    assert [(pair.recorded.data[0], pair.sent.data[0]) for pair in pairs if pair.recorded and pair.sent] == [
        (i, i + 3) for i in range(10)
    ]
    assert not any(pair.same for pair in pairs)


def test_a_frame_under_another_identifier_is_one_missing_and_one_in_excess() -> None:
    pairs = play(recorded()[0], Echo(can_id=0x201), frozenset({OWN, 0x201}))
    assert sum(pair.sent is None for pair in pairs) == 10
    excess = [pair.sent for pair in pairs if pair.recorded is None and pair.sent is not None]
    assert [frame.can_id for frame in excess] == [0x201] * len(excess)
    assert len(excess) >= 9, "the last one may have been on its way"


def test_a_frame_that_is_taken_out_of_the_log_is_in_excess() -> None:
    frames, _ = recorded()
    third = [frame for frame in frames if frame.can_id == OWN][3]
    pairs = play([frame for frame in frames if frame is not third], Echo())
    excess = [pair for pair in pairs if pair.recorded is None]
    assert len(excess) == 1
    assert excess[0].sent is not None
    assert excess[0].sent.data == third.data


def test_the_queue_is_as_full_as_it_was() -> None:
    """A port of one place: while the log does not show the frame on the wire, the next one is refused."""
    clock, pairs = LockstepClock(), []
    frames = [Frame(OTHER, b"\x00", 1000 * US), Frame(OWN, b"\x00", 5000 * US)]
    bus = PlaybackBus(clock, frames, frozenset({OWN}), pairs.append, queue_limit=1)
    port = bus.attach("node", [OTHER], lambda frame: None)
    assert port.send(OWN, b"\x00")
    assert not port.send(OWN, b"\x01")
    assert port.refused == 1
    bus.start()
    clock.run_until(6000 * US)
    assert port.send(OWN, b"\x01")


def test_a_frame_that_a_fault_took_from_the_log_is_compared_as_it_was_sent() -> None:
    frames, heard = recorded()
    (gone,) = [frame for frame in frames if frame.can_id == OWN][4:5]
    left = [frame for frame in frames if frame is not gone]
    node = Echo()
    pairs = play(left, node, as_sent=[gone])
    assert node.heard == heard
    assert len(pairs) == 10
    assert all(pair.same for pair in pairs)


def test_a_frame_that_nobody_got_is_not_heard() -> None:
    frames, heard = recorded()
    asked = [frame for frame in frames if frame.can_id == OTHER][4]
    answer = [frame for frame in frames if frame.can_id == OWN][4]
    node = Echo()
    pairs = play([frame for frame in frames if frame not in (asked, answer)], node, as_sent=[asked])
    assert node.heard == heard[:4] + heard[5:]
    assert len(pairs) == 9
    assert all(pair.same for pair in pairs)


def test_a_frame_that_came_with_other_bytes_is_heard_so_and_compared_as_it_was_sent() -> None:
    frames, heard = recorded()
    sent = [frame for frame in frames if frame.can_id == OWN][4]
    asked = [frame for frame in frames if frame.can_id == OTHER][4]
    changed = [frame._replace(data=b"\x77") if frame in (sent, asked) else frame for frame in frames]
    node = Echo()
    pairs = play(changed, node, as_sent=[asked, sent])
    assert node.heard[4].data == b"\x77"
    assert [frame.data for frame in node.heard[5:]] == [frame.data for frame in heard[5:]]
    assert [pair.same for pair in pairs] == [True] * 4 + [False] + [
        True
    ] * 5  # the answer to what it heard, not to what was sent
