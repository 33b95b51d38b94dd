"""Drives that are not those of the table: other units, other identity, objects that are missing or cannot be written."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import pytest

from drivers.canopen.abort import AbortCode, SdoAbort
from drivers.catalogue import DRIVE_IDS, devices
from drivers.cia402.bench import BenchDrive
from drivers.cia402.configuration import DriveSettings
from drivers.cia402.drive_units import ACCELERATIONS, NO_LIMIT, POSITIONS, VELOCITIES
from drivers.cia402.phases import EventKind, MasterPhase
from drivers.objects import Access, DataType, DeviceDef, ObjectDef

pytestmark = pytest.mark.slow

MakeCell = Callable[..., Any]
TABLE = devices()
ELBOW, LIFT, WHEEL = 25, 22, 11
U32 = DataType.UNSIGNED32
TURN = 2 * math.pi
BOUGHT = {(0x1018, 1): 0x2AB, (0x1018, 2): 7}
ANY = BenchDrive(any_identity=True)


@dataclass(frozen=True)
class Units:
    """What a drive counts in, and how it says so."""

    objects: Mapping[tuple[int, int], int]
    position: float
    velocity: float
    acceleration: float


MILLIDEGREE = Units({(0x60A8, 0): 0xFD41_0000, (0x60A9, 0): 0xFD41_0300}, *[1e-3 * math.pi / 180] * 3)
HUNDREDTH = Units({(0x60A8, 0): 0xFB10_0000, (0x60A9, 0): 0xFB10_0300}, *[1e-5] * 3)
COUNTS = Units(
    {
        (0x60A8, 0): 0x00B5_0000,
        (0x60A9, 0): 0x00B5_0300,
        (0x608F, 1): 1 << 20,
        (0x608F, 2): 1,
        (0x6091, 1): 3,
        (0x6091, 2): 2,
    },
    *[TURN / (1.5 * (1 << 20))] * 3,
)
COUNTS_AND_RPM = Units(
    {
        (0x60A8, 0): 0x00B5_0000,
        (0x60A9, 0): 0xFDB4_4700,
        (0x60AA, 0): 0xFDC0_0300,
        (0x608F, 1): 1 << 17,
        (0x608F, 2): 1,
        (0x6092, 1): 1 << 17,
        (0x6092, 2): 1,
    },
    TURN / (1 << 17),
    1e-3 * TURN / 60,
    1e-3 * TURN / 60,
)
LIFT_TENTHS = Units({(0x60A8, 0): 0xFC01_0000, (0x60A9, 0): 0xFC01_0300}, *[1e-4] * 3)
TURNS = Units(
    {(0x60A8, 0): 0xFAB4_0000, (0x60A9, 0): 0xFBB4_0300, (0x60AA, 0): 0xFCB4_5700},
    1e-6 * TURN,
    1e-5 * TURN,
    1e-4 * TURN,
)


def with_objects(device: DeviceDef, values: Mapping[tuple[int, int], int]) -> DeviceDef:
    """The device with other power-on values, and with objects that it did not have."""
    objects = {entry.key: entry for entry in device.objects}
    for key, value in values.items():
        made = ObjectDef(*key, f"object {key[0]:04X}h", U32, Access.RO)
        objects[key] = replace(objects.get(key, made), default=value, low=None, high=None)
    return replace(device, objects=tuple(objects[key] for key in sorted(objects)))


def counting_in(device: DeviceDef, units: Units) -> DeviceDef:
    """The same drive as its maker has set it up: with limits of half of everything, in its own units."""
    scales = dict.fromkeys(POSITIONS, units.position) | dict.fromkeys(VELOCITIES, units.velocity)
    scales |= dict.fromkeys(ACCELERATIONS, units.acceleration)

    def said(entry: ObjectDef) -> ObjectDef:
        scale = scales.get(entry.index)
        if entry.index == 0x6064:
            scale = units.position
        elif entry.index == 0x606C:
            scale = units.velocity
        if scale is None or (entry.subindex == 0 and entry.index in (0x607D, 0x6099)):
            return entry
        value = int(entry.default)
        if NO_LIMIT.get(entry.key) == value:
            return replace(entry, scale=scale)
        return replace(entry, scale=scale, default=round(0.5 * value * entry.scale / scale))

    return with_objects(replace(device, objects=tuple(map(said, device.objects))), {**units.objects, **BOUGHT})


def without(device: DeviceDef, *indices: int) -> DeviceDef:
    return replace(device, objects=tuple(entry for entry in device.objects if entry.index not in indices))


def read_only(device: DeviceDef, values: Mapping[tuple[int, int], int]) -> DeviceDef:
    changed = with_objects(device, values)
    objects = (replace(entry, access=Access.RO) if entry.key in values else entry for entry in changed.objects)
    return replace(changed, objects=tuple(objects))


def cell_with(make_cell: MakeCell, node: int, drive: DeviceDef, bench: BenchDrive | None, **more: Any) -> Any:
    settings = DriveSettings(bench={} if bench is None else {node: bench}, **more)
    return make_cell(settings=settings, drive_devices={node: drive})


def refusal(cell: Any) -> str:
    """The one line that the master says of the drive that it does not take."""
    cell.power_on()
    cell.run(0.5)
    (event,) = cell.failures()
    assert event.kind is EventKind.CONFIGURATION_FAILED
    assert "\n" not in event.text
    assert cell.master.phase is MasterPhase.FAULT
    return str(event.text)


def notes(cell: Any) -> list[str]:
    return [event.text.partition(": ")[2].partition(": ")[2] for event in cell.of_kind(EventKind.NOTED)]


FREE = (0x1006, 0x2100, 0x605A, 0x605B, 0x605C, 0x605D, 0x605E, 0x6066, 0x60C5, 0x6502)
PROTECTING = (0x6007, 0x6065, 0x6072, 0x607D, 0x607F, 0x6085)


@pytest.mark.parametrize(
    ("node", "units"),
    [
        (ELBOW, MILLIDEGREE),
        (ELBOW, HUNDREDTH),
        (ELBOW, COUNTS),
        (ELBOW, COUNTS_AND_RPM),
        (LIFT, LIFT_TENTHS),
        (WHEEL, TURNS),
        (WHEEL, COUNTS_AND_RPM),
    ],
)
def test_limits_in_the_drive_are_those_of_the_table_or_tighter_by_less_than_a_unit(
    make_cell: MakeCell, node: int, units: Units
) -> None:
    cell = cell_with(make_cell, node, counting_in(TABLE[node], units), ANY).enabled()
    inside = cell.drives[node].parameters.limits
    own = make_cell().enabled().drives[node].parameters.limits
    a_bit = 1 + 1e-12
    for tighter, limit, unit in (
        (inside.upper, own.upper, units.position),
        (-inside.lower, -own.lower, units.position),
        (inside.following_error, own.following_error, units.position),
        (inside.velocity, own.velocity, units.velocity),
        (inside.acceleration, own.acceleration, units.acceleration),
        (-inside.quick_stop_deceleration, -own.quick_stop_deceleration, units.acceleration),
    ):
        if math.isinf(limit):
            assert tighter == limit
        else:
            assert limit - unit * a_bit <= tighter <= limit + abs(limit) * 1e-12


def ramp(axis: int, speed: float, begin: list[float]) -> Callable[[Any], tuple[Any, Any]]:
    """Targets: the axis goes on at `speed` from where it stands at the first call, the others stay."""

    def control(cell: Any) -> tuple[Any, Any]:
        targets = cell.master.targets()
        if cell.master.phase is MasterPhase.ENABLED:
            begin[:] = begin or [cell.syncs, float(targets[axis])]
            targets[axis] = begin[1] + speed * 0.01 * (cell.syncs - begin[0])
        return targets, cell.load

    return control


@pytest.mark.parametrize("units", [MILLIDEGREE, HUNDREDTH, COUNTS, COUNTS_AND_RPM])
def test_the_axis_goes_where_it_is_sent_and_says_where_it_is(make_cell: MakeCell, units: Units) -> None:
    axis = DRIVE_IDS.index(ELBOW)
    rated = BenchDrive(any_identity=True, rated_torque_mNm=100_000)  # at the joint: the plant has no gear
    cell = cell_with(make_cell, ELBOW, counting_in(TABLE[ELBOW], units), rated).enabled()
    start = float(cell.plant.position[axis])
    cell.control = ramp(axis, 0.4, [])
    cell.run(1.0)
    assert cell.failures() == []
    assert float(cell.plant.position[axis]) == pytest.approx(start + 0.4, abs=0.02)
    assert float(cell.plant.velocity[axis]) == pytest.approx(0.4, abs=0.02)
    assert cell.master.positions()[axis] == pytest.approx(float(cell.plant.position[axis]), abs=0.005)
    told = cell.master.axes[axis].velocity(cell.clock.now_ns(), 200_000_000)
    assert told == pytest.approx(0.4, abs=0.02)
    feedback = cell.master.feedback()[axis]
    assert feedback.effort == pytest.approx(float(cell.plant.command[axis]), abs=3.0)


def test_a_wheel_turns_as_fast_as_it_is_told(make_cell: MakeCell) -> None:
    cell = cell_with(make_cell, WHEEL, counting_in(TABLE[WHEEL], COUNTS_AND_RPM), ANY).enabled()

    def control(cell: Any) -> tuple[Any, Any]:
        targets = cell.master.targets()
        targets[0] = min(2.0, targets[0] + 0.05)
        return targets, cell.load

    cell.control = control
    cell.run(1.0)
    assert float(cell.plant.velocity[0]) == pytest.approx(2.0, abs=1e-3)


def test_the_drive_stops_at_its_own_end_and_keeps_to_its_own_speed(make_cell: MakeCell) -> None:
    axis = DRIVE_IDS.index(ELBOW)
    own = {ELBOW: {(0x607D, 2): 1_200_000, (0x607F, 0): 300_000}}  # the planner knows nothing of these
    drive = counting_in(TABLE[ELBOW], MILLIDEGREE)
    cell = cell_with(make_cell, ELBOW, drive, ANY, parameters=own).enabled()
    cell.control = ramp(axis, 0.35, [])
    start = float(cell.plant.position[axis])
    cell.run(0.5)
    assert 0.12 < float(cell.plant.position[axis]) - start <= 0.3 * 0.5
    cell.run(1.5)
    assert 1.19 < float(cell.plant.position[axis]) <= 1.2 + 1e-3


def test_gates_and_set_points_of_the_master_are_in_the_units_of_the_drive(make_cell: MakeCell) -> None:
    axis = DRIVE_IDS.index(ELBOW)
    usual = make_cell().enabled().master._cyclic.gates[ELBOW].limits
    drive = counting_in(TABLE[ELBOW], HUNDREDTH)
    cell = cell_with(make_cell, ELBOW, drive, ANY).enabled()
    limits = cell.master._cyclic.gates[ELBOW].limits
    assert (limits.lower, limits.upper) == (-296_700, 296_700)
    assert limits.jump == round(usual.jump / 10) + 2
    assert cell.master.axes[axis].feedback_gate.jump == 4_502  # three times 1.5 rad/s for 10 ms, and rounding
    assert limits.bend == round(usual.bend / 10) + 2
    assert cell.master.axes[axis].target_raw == pytest.approx(100_000, abs=10)


@pytest.mark.parametrize(
    ("rated", "gear", "limit", "newton_metres"),
    [
        (100_000, None, 2000, 0.1),
        (100_000, (1, 1), 2000, 0.1),
        (400, (100, 1), 2000, 0.04),  # 40 N·m at the joint: twice that, for the motor's sake
        (4_000, (50, 1), 1000, 0.2),  # 200 N·m at the joint, where the table allows 200
    ],
)
def test_torques_are_those_of_the_joint(
    make_cell: MakeCell, rated: int, gear: tuple[int, int] | None, limit: int, newton_metres: float
) -> None:
    objects = {**BOUGHT, (0x6076, 0): rated}
    if gear is not None:
        objects |= {(0x6091, 1): gear[0], (0x6091, 2): gear[1]}
    cell = cell_with(make_cell, ELBOW, with_objects(TABLE[ELBOW], objects), ANY)
    cell.power_on()
    cell.run_to(MasterPhase.READY)
    axis = cell.master.axes[DRIVE_IDS.index(ELBOW)]
    assert axis.effort_scale == pytest.approx(newton_metres)
    assert cell.drives[ELBOW].node.dictionary.get(0x6072) == limit


def test_the_force_of_the_lift_is_that_of_its_spindle(make_cell: MakeCell) -> None:
    spindle = {(0x6091, 1): 2, (0x6091, 2): 1, (0x6092, 1): 5_000, (0x6092, 2): 1}  # 5,000 µm per turn, gear 2 : 1
    drive = with_objects(TABLE[LIFT], {**BOUGHT, **spindle, (0x6076, 0): 300})
    cell = cell_with(make_cell, LIFT, drive, ANY)
    cell.power_on()
    cell.run_to(MasterPhase.READY)
    axis = cell.master.axes[DRIVE_IDS.index(LIFT)]
    assert axis.effort_scale == pytest.approx(0.3e-3 * 2 * TURN / 0.005)


@pytest.mark.parametrize(
    ("objects", "bench", "words"),
    [
        ({(0x60A8, 0): 0}, ANY, "60A8h (SI unit position), or what it would say as position_unit in [drives.25]"),
        ({(0x60A9, 0): 0}, ANY, "velocity_unit in [drives.25], e.g. 0xFA100300"),
        ({(0x60A8, 0): 0x00B5_0000}, ANY, "since 60A8h = 00B50000h says increments, came none"),
        (
            {**COUNTS.objects, (0x6092, 1): 3600, (0x6092, 2): 1},
            ANY,
            "1572864 units in a revolution of the shaft in 6092h, as 608Fh and 6091h say, or 1, came 3600",
        ),
        ({**COUNTS.objects, (0x608F, 2): 0}, ANY, "numbers above 0 in 608Fh sub 1 and 2, came 1048576 and 0"),
        ({(0x60A8, 0): 0x0041_0000}, ANY, "a position unit of at most 0.0005 rad (60A8h)"),
        (
            {(0x60A9, 0): 0x00B4_4700},
            ANY,
            "60A8h = FA100000h and 60A9h = 00B44700h leave open what 6085h and 60C5h count in",
        ),
        ({(0x60AA, 0): 0xFA10_0300}, ANY, "60AAh, acceleration, e.g. FA105700h, came SI unit FA100300h"),
        (
            {(0x60AA, 0): 0x00B4_5700},
            ANY,
            "expected a unit that is fine enough for 60C5h sub 0 = 6000000 of the table (6 in SI), came a unit of 6.28 in 60AAh",
        ),
        (
            {(0x60A8, 0): 0xF710_0000, (0x60A9, 0): 0xF710_0300},
            ANY,
            "607Dh sub 1 = -2967000 of the table (-2.967 in SI) fits",
        ),
        (
            {},
            BenchDrive(any_identity=True, position_unit=0xFD10_0000),
            "60A8h = FD100000h, position_unit in [drives.25]",
        ),
        ({(0x6076, 0): 0}, ANY, "a rated torque above 0 in 6076h, or rated_torque_mNm in [drives.25], came 0"),
        ({(0x6091, 1): 0}, ANY, "numbers above 0 in 6091h sub 1 and 2, came 0 and 1"),
        ({(0x6091, 1): 1 << 31}, ANY, "6072h sub 0 = 2000"),
    ],
)
def test_units_that_cannot_be_used_end_in_one_line(
    make_cell: MakeCell, objects: dict[tuple[int, int], int], bench: BenchDrive, words: str
) -> None:
    drive = with_objects(TABLE[ELBOW], {**BOUGHT, **objects})
    line = refusal(cell_with(make_cell, ELBOW, drive, bench))
    assert line.startswith("drive 25 (elbow): configuration failed: ")
    assert words in line


def test_a_wheel_that_can_only_be_told_whole_revolutions_a_minute_is_refused(make_cell: MakeCell) -> None:
    drive = with_objects(TABLE[WHEEL], {**BOUGHT, (0x60A9, 0): 0x00B4_4700, (0x60AA, 0): 0xFA10_5700})
    assert "a velocity unit of at most 0.1 rad/s" in refusal(cell_with(make_cell, WHEEL, drive, ANY))


def test_what_a_drive_does_not_say_the_scenario_may(make_cell: MakeCell) -> None:
    drive = without(counting_in(TABLE[ELBOW], COUNTS_AND_RPM), 0x60A8, 0x60A9, 0x60AA, 0x6076)
    said = BenchDrive(
        any_identity=True,
        position_unit=0x00B5_0000,
        velocity_unit=0xFDB4_4700,
        acceleration_unit=0xFDC0_0300,
        rated_torque_mNm=80_000,
    )
    cell = cell_with(make_cell, ELBOW, with_objects(drive, {(0x6076, 0): 80_000}), said).enabled()
    axis = cell.master.axes[DRIVE_IDS.index(ELBOW)]
    scales = (axis.position_scale, axis.velocity_scale, axis.effort_scale)
    assert scales == pytest.approx((TURN / (1 << 17), 1e-3 * TURN / 60, 0.08), rel=1e-12)


@pytest.mark.parametrize(
    ("bench", "words"),
    [
        (None, "vendor-ID 0x0 in 1018h sub 1, came vendor-ID 0x2ab, product code 0x7; if this drive shall be there"),
        (
            BenchDrive(vendor_id=0x2AC),
            "expected vendor-ID 0x2ac in 1018h sub 1, came vendor-ID 0x2ab, product code 0x7",
        ),
        (BenchDrive(vendor_id=0x2AB, product_code=8), "expected product code 0x8 in 1018h sub 2, came vendor-ID 0x2ab"),
    ],
)
def test_another_identity_is_refused_with_what_to_say_in_the_scenario(
    make_cell: MakeCell, bench: BenchDrive | None, words: str
) -> None:
    line = refusal(cell_with(make_cell, ELBOW, with_objects(TABLE[ELBOW], BOUGHT), bench))
    assert words in line
    assert line.endswith("say so in the scenario: [drives.25] vendor_id = 0x2AB, product_code = 0x7")


@pytest.mark.parametrize("bench", [BenchDrive(vendor_id=0x2AB), BenchDrive(vendor_id=0x2AB, product_code=7), ANY])
def test_the_identity_that_was_said_is_taken(make_cell: MakeCell, bench: BenchDrive) -> None:
    cell = cell_with(make_cell, ELBOW, with_objects(TABLE[ELBOW], BOUGHT), bench).enabled()
    said = notes(cell)
    assert said == (["vendor-ID 0x2ab, product code 0x7: taken as it is"] if bench is ANY else [])


FREE = (0x1006, 0x2100, 0x605A, 0x605B, 0x605C, 0x605D, 0x605E, 0x6066, 0x60C5, 0x6502)
PROTECTING = (0x6007, 0x6065, 0x6072, 0x607D, 0x607F, 0x6085)


def lacking(cell: Any, node: int, missing: Collection[int]) -> Any:
    """Whoever asks from outside is told that the objects do not exist. (The simulated drive cannot do without them inside.)"""
    dictionary = cell.drives[node].node.dictionary
    upload, download = dictionary.upload, dictionary.download

    def hidden(access: Callable[..., Any]) -> Callable[..., Any]:
        def ask(index: int, *more: Any) -> Any:
            if index in missing:
                raise SdoAbort(AbortCode.NO_SUCH_OBJECT)
            return access(index, *more)

        return ask

    dictionary.upload, dictionary.download = hidden(upload), hidden(download)
    return cell


def bought(make_cell: MakeCell, bench: BenchDrive = ANY, **more: Any) -> Any:
    return cell_with(make_cell, ELBOW, with_objects(TABLE[ELBOW], BOUGHT), bench, **more)


def test_objects_that_may_be_missing_are_noted_and_set_up_goes_on(make_cell: MakeCell) -> None:
    gate = {ELBOW: {(0x2100, 0): 3000}}
    cell = lacking(bought(make_cell, parameters=gate), ELBOW, FREE).enabled()
    assert cell.failures() == []
    said = notes(cell)
    for index in FREE:
        assert len([text for text in said if text.startswith(f"{index:04X}h")]) == 1, (index, said)
    absent = "(abort 06020000h: object does not exist in the object dictionary)"
    assert f"60C5h sub 0 (max acceleration) is not set to 6000000 {absent}" in said
    assert f"2100h sub 0 is not set to 3000 {absent}" in said
    assert all(
        event.text.startswith("drive 25 (elbow): set up with a difference: ") for event in cell.of_kind(EventKind.NOTED)
    )


@pytest.mark.parametrize("index", PROTECTING)
def test_what_protects_the_axis_must_be_there_or_be_given_up_by_name(make_cell: MakeCell, index: int) -> None:
    line = refusal(lacking(bought(make_cell), ELBOW, {index}))
    assert line.startswith("drive 25 (elbow): configuration failed: ")
    assert f"{index:04X}h sub" in line
    assert f"or accept_missing = [0x{index:04X}] in [drives.25], came abort 06020000h: object does not exist" in line
    accepted = BenchDrive(any_identity=True, accept_missing=frozenset({index}))
    cell = lacking(bought(make_cell, accepted), ELBOW, {index}).enabled()
    assert any(text.startswith(f"{index:04X}h sub") for text in notes(cell))


@pytest.mark.parametrize("index", [0x1000, 0x1016, 0x1017, 0x6061])
def test_what_has_to_be_there_cannot_be_given_up(make_cell: MakeCell, index: int) -> None:
    generous = BenchDrive(any_identity=True, accept_missing=frozenset({index}))
    line = refusal(lacking(bought(make_cell, generous), ELBOW, {index}))
    assert f"SDO access to {index:04X}h sub" in line
    assert "abort 06020000h: object does not exist in the object dictionary" in line


def test_a_limit_that_the_axis_does_not_have_may_be_missing(make_cell: MakeCell) -> None:
    drive = with_objects(TABLE[WHEEL], BOUGHT)
    cell = lacking(cell_with(make_cell, WHEEL, drive, ANY), WHEEL, {0x607D, 0x6065}).enabled()
    assert cell.failures() == []


@pytest.mark.parametrize(
    ("key", "tighter", "looser"),
    [
        ((0x6065, 0), 50_000, 200_000),
        ((0x6066, 0), 20, 500),
        ((0x6072, 0), 1_000, 3_000),
        ((0x607D, 1), -2_000_000, -3_100_000),
        ((0x607D, 2), 2_000_000, 3_100_000),
        ((0x607F, 0), 1_000_000, 2_000_000),
        ((0x60C5, 0), 5_000_000, 9_000_000),
        ((0x6085, 0), 15_000_000, 9_000_000),
    ],
)
def test_a_limit_that_cannot_be_written_may_be_tighter_but_not_looser(
    make_cell: MakeCell, key: tuple[int, int], tighter: int, looser: int
) -> None:
    name = f"{key[0]:04X}h sub {key[1]}"
    drive = read_only(TABLE[ELBOW], {key: tighter})
    cell = cell_with(make_cell, ELBOW, drive, None).enabled()
    (said,) = notes(cell)
    assert said.startswith(name)
    assert f"stays {tighter}, not " in said
    assert said.endswith("(abort 06010002h: attempt to write a read-only object)")
    line = refusal(cell_with(make_cell, ELBOW, read_only(TABLE[ELBOW], {key: looser}), None))
    assert f"or tighter in {name}" in line
    assert f"came {looser}, and abort 06010002h: attempt to write a read-only object" in line


def test_no_limit_at_all_is_not_taken_for_a_tight_one(make_cell: MakeCell) -> None:
    """0 in both ends, or as the highest speed: in some drives that is none."""
    drive = with_objects(TABLE[ELBOW], BOUGHT)
    cell = cell_with(make_cell, ELBOW, drive, ANY)
    dictionary = cell.drives[ELBOW].node.dictionary
    upload = dictionary.upload
    dictionary.upload = lambda index, sub: bytes(4) if index == 0x607F else upload(index, sub)
    assert "1500000 or tighter in 607Fh sub 0 (max profile velocity) after it was written, came 0" in refusal(cell)


def test_a_drive_that_rounds_to_the_tighter_side_is_taken(make_cell: MakeCell) -> None:
    for offset, taken in ((-7, True), (7, False)):
        cell = bought(make_cell)
        dictionary = cell.drives[ELBOW].node.dictionary
        upload = dictionary.upload
        value = (1_500_000 + offset).to_bytes(4, "little")
        dictionary.upload = lambda index, sub, upload=upload, value=value: (
            value if index == 0x607F else upload(index, sub)
        )
        if taken:
            cell.enabled()
            assert "607Fh sub 0 (max profile velocity) stays 1499993, not 1500000 (as the drive rounds it)" in notes(
                cell
            )
        else:
            assert "came 1500007" in refusal(cell)


def test_a_quick_stop_that_cannot_be_changed_is_reckoned_with(make_cell: MakeCell) -> None:
    drive = read_only(TABLE[ELBOW], {(0x605A, 0): 6})
    assert "2 in 605Ah sub 0 (quick stop option code)" in refusal(cell_with(make_cell, ELBOW, drive, None))
    agreed = BenchDrive(accept_missing=frozenset({0x605A}))
    cell = cell_with(make_cell, ELBOW, drive, agreed).enabled()
    cell.master.quick_stop([ELBOW])
    cell.run(1.0)
    assert cell.failures() == []
    assert cell.master.axes[DRIVE_IDS.index(ELBOW)].phase.name == "STOPPED"


def test_a_target_that_cannot_be_mapped_is_named(make_cell: MakeCell) -> None:
    drive = with_objects(TABLE[ELBOW], {**BOUGHT, (0x1600, 0): 0, (0x1600, 3): 0})
    objects = (replace(entry, mappable=entry.mappable and entry.index != 0x60B2) for entry in drive.objects)
    pdos = (replace(pdo, mapping=pdo.mapping[:2]) if pdo.cob_id == 0x219 else pdo for pdo in drive.pdos)
    cell = cell_with(make_cell, ELBOW, replace(drive, objects=tuple(objects), pdos=tuple(pdos)), ANY)
    assert "60B2h sub 0 to be mapped in RPDO1 (1600h sub 3), came abort 06040041h: object cannot be mapped" in refusal(
        cell
    )


def test_a_drive_of_the_table_is_asked_no_more_than_before(cell: Any) -> None:
    cell.enabled()
    asked = {int.from_bytes(frame.data[1:3], "little") for frame in cell.wire if frame.can_id == 0x600 + ELBOW}
    assert not asked & {0x60AA, 0x608F, 0x6091, 0x6092}
    assert cell.of_kind(EventKind.NOTED) == []
