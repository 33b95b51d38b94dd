"""`[drives.NODE]`: what a scenario may say of bought drives."""

from __future__ import annotations

import pytest

from config.bench import bench_drives
from config.errors import ConfigError
from config.load import dump_scenario, load_scenario
from config.scenario import Scenario
from drivers.cia402.bench import BenchDrive


def test_every_key_reaches_the_master() -> None:
    scenario = load_scenario(
        "hold-still",
        (
            "drives.25.vendor_id=0x2AB",
            "drives.25.product_code=7",
            "drives.25.position_unit=0xFD410000",
            "drives.25.velocity_unit=0x00B44700",
            "drives.25.acceleration_unit=0xFDC00300",
            "drives.25.rated_torque_mNm=80000",
            "drives.25.accept_missing=[0x607F, 0x6085]",
            "drives.11.identity=any",
        ),
    )
    assert isinstance(scenario, Scenario)
    assert bench_drives(scenario.drives) == {
        25: BenchDrive(False, 0x2AB, 7, 0xFD41_0000, 0x00B4_4700, 0xFDC0_0300, 80_000, frozenset({0x607F, 0x6085})),
        11: BenchDrive(any_identity=True),
    }


def test_a_scenario_without_bought_drives_says_nothing_of_them() -> None:
    scenario = load_scenario("hold-still")
    assert isinstance(scenario, Scenario)
    assert bench_drives(scenario.drives) == {}


def test_the_resolved_scenario_keeps_them(tmp_path) -> None:
    scenario = load_scenario("hold-still", ("drives.25.vendor_id=0x2AB", "drives.25.accept_missing=[0x607F]"))
    path = tmp_path / "again.toml"
    path.write_text(dump_scenario(scenario))
    assert load_scenario(str(path)) == scenario


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("drives.25.vendor=1", "unknown key 'drives.25.vendor', did you mean 'vendor_id'?"),
        ("drives.29.identity=any", "drives.29"),
        ("drives.elbow.identity=any", "drives.elbow"),
        ("drives.25.identity=all", "drives.25.identity"),
        ("drives.25.vendor_id=-1", "drives.25.vendor_id"),
        ("drives.25.vendor_id=4294967296", "drives.25.vendor_id"),
        ("drives.25.product_code=7", "product_code needs vendor_id"),
        ("drives.25.accept_missing=[0]", "drives.25.accept_missing.0"),
        ("drives.25.rated_torque_mNm=0", "drives.25.rated_torque_mNm"),
    ],
)
def test_what_is_wrong_is_named_in_one_line(override: str, words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        load_scenario("hold-still", (override,))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_any_identity_and_one_of_them_contradict_each_other() -> None:
    with pytest.raises(ConfigError, match="does not go together with vendor_id"):
        load_scenario("hold-still", ("drives.25.identity=any", "drives.25.vendor_id=1"))
