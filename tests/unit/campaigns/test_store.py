"""What is on disk counts, once; what is not is computed; nothing that does not belong together is mixed."""

import tempfile
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from canipulator.campaigns.campaign import Batch, Row, batches, unit_generator
from canipulator.campaigns.store import Store
from canipulator.campaigns.workers import compute_batch
from config.errors import ConfigError
from tests.unit.campaigns.counting import Walks

GROUPS = {"left": 20, "right": 7}


def rows(batch: Batch) -> list[Row]:
    return [{"group": batch.group, "index": i, "error": None, "value": float(i)} for i in batch.indices]


def keep(out: Path, *kept: Batch, seed: int = 1) -> None:
    with Store(out, Walks(), seed, resume=True) as store:
        for batch in kept:
            store.keep(batch, rows(batch))


@given(st.sets(st.integers(0, 200)), st.integers(1, 30))
def test_batches_hold_every_missing_unit_once_and_nothing_else(missing: set[int], size: int) -> None:
    made = list(batches("left", sorted(missing), size))
    assert [i for batch in made for i in batch.indices] == sorted(missing)
    assert all(1 <= batch.count <= size for batch in made)


@given(st.lists(st.tuples(st.sampled_from(list(GROUPS)), st.integers(0, 6)), unique=True), st.integers(1, 9))
def test_what_is_missing_and_what_is_there_make_the_whole(done: list[tuple[str, int]], size: int) -> None:
    with tempfile.TemporaryDirectory() as folder, Store(Path(folder), Walks(), 1, resume=False) as store:
        for group, index in done:
            store.keep(Batch(group, index, 1), rows(Batch(group, index, 1)))
        todo = store.missing(GROUPS, size)
        units = [(batch.group, i) for batch in todo for i in batch.indices]
        assert sorted(units + done) == [(group, i) for group, count in sorted(GROUPS.items()) for i in range(count)]


def test_results_are_in_the_order_of_the_units_whoever_came_first(tmp_path: Path) -> None:
    keep(tmp_path, Batch("right", 0, 7), Batch("left", 10, 10), Batch("left", 9, 1), Batch("left", 0, 9))
    with Store(tmp_path, Walks(), 1, resume=True) as store:
        table = store.results(GROUPS)
    assert table["index"].to_pylist() == [*range(20), *range(7)]
    assert table["group"].to_pylist() == ["left"] * 20 + ["right"] * 7
    assert pq.read_table(tmp_path / "results.parquet").equals(table)


def test_fewer_pairs_than_are_there_give_only_those(tmp_path: Path) -> None:
    keep(tmp_path, Batch("left", 0, 15))
    with Store(tmp_path, Walks(), 1, resume=True) as store:
        assert store.missing({"left": 12}, 5) == []
        assert store.results({"left": 12})["index"].to_pylist() == list(range(12))


def test_a_file_torn_by_a_crash_does_not_count(tmp_path: Path) -> None:
    keep(tmp_path, Batch("left", 0, 5))
    torn = tmp_path / "parts" / ".left--5+5.parquet.tmp"
    torn.write_bytes((tmp_path / "parts" / "left--0+5.parquet").read_bytes()[:100])
    with Store(tmp_path, Walks(), 1, resume=True) as store:
        assert store.done() == {"left": set(range(5))}
    assert not torn.exists()


def test_results_are_not_overwritten_unasked(tmp_path: Path) -> None:
    keep(tmp_path, Batch("left", 0, 5))
    with pytest.raises(ConfigError, match=r"has results already.*--resume"):
        Store(tmp_path, Walks(), 1, resume=False)


def test_another_seed_does_not_go_on_with_these(tmp_path: Path) -> None:
    keep(tmp_path, Batch("left", 0, 5))
    with pytest.raises(ConfigError, match=r"seed 1, not 2"):
        Store(tmp_path, Walks(), 2, resume=True)


def test_only_one_writes(tmp_path: Path) -> None:
    with Store(tmp_path, Walks(), 1, resume=False), pytest.raises(ConfigError, match="another campaign is writing"):
        Store(tmp_path, Walks(), 1, resume=True)
    Store(tmp_path, Walks(), 1, resume=True).close()


def test_a_part_that_somebody_added_is_not_counted_twice(tmp_path: Path) -> None:
    keep(tmp_path, Batch("left", 0, 5), Batch("left", 4, 2))
    with Store(tmp_path, Walks(), 1, resume=True) as store, pytest.raises(ConfigError, match="another part holds"):
        store.missing(GROUPS, 5)


def test_a_unit_that_fails_says_so_and_leaves_the_others_alone() -> None:
    walks = Walks(busy_s=0.0)
    found = compute_batch(walks, 1, Batch("left", 13_012, 3)).rows
    assert [row["index"] for row in found] == [13_012, 13_013, 13_014]
    assert found[1]["error"] == "ArithmeticError: no walk of this number"
    assert found[0]["error"] is found[2]["error"] is None
    assert found[2]["end"] == compute_batch(walks, 1, Batch("left", 13_014, 1)).rows[0]["end"]


@given(st.integers(0, 2**63 - 1), st.integers(0, 2**40), st.integers(0, 2**40))
def test_units_have_numbers_of_their_own(seed: int, one: int, other: int) -> None:
    def draw(stream: str, index: int) -> list[float]:
        numbers: list[float] = unit_generator(seed, stream, index).random(4).tolist()
        return numbers

    assert draw("iiwa14", one) == draw("iiwa14", one)
    assert draw("iiwa14", one) != draw("panda", one)
    assert (draw("iiwa14", one) == draw("iiwa14", other)) == (one == other)
