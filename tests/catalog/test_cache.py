"""The memo gives back what was put in, and never believes a damaged entry."""

import os
from dataclasses import dataclass, replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from catalog_records import demonstration, differences, plan, structure
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from upplied.catalog.schema.codec import decode, encode
from upplied.catalog.store.contents import Cache
from upplied.errors import CatalogError, InputError
from upplied.records import Cloud, Correspondences, Record, Registration, Visibility


@dataclass(frozen=True, eq=False, repr=False)
class Everything(Record):
    """A record of all that a record may hold."""

    seen: np.ndarray
    cloud: Cloud
    maybe: Registration | None
    parts: tuple[Cloud, ...]
    named: dict[str, float]
    words: tuple[str, ...]
    number: float
    text: str = ""


def everything(seen: np.ndarray, number: float = 0.5, text: str = "ü\n") -> Everything:
    cloud = Cloud(np.arange(6.0).reshape(2, 3), part=np.array([0, 1]))
    return Everything(seen, cloud, None, (cloud, cloud), {"a": float("inf")}, ("x", "y"), number, text)


@given(
    hnp.arrays(bool, hnp.array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=9)),
    st.floats(),
    st.text(st.characters(exclude_categories=["Cs"])),
)
@settings(max_examples=60, deadline=None)
def test_any_record_comes_back_bit_by_bit(seen, number, text):
    record = everything(seen, number, text)
    back = decode(encode(record), Everything)
    assert differences(record, back) == []


@given(hnp.arrays(hnp.floating_dtypes(endianness="<"), hnp.array_shapes(max_dims=2, min_side=0)))
@settings(max_examples=40, deadline=None)
def test_floats_of_any_width_come_back(values):
    assert differences(values, decode(encode(Cloud(values)), Cloud).points) == []


@pytest.mark.parametrize("record", [structure(), demonstration(), plan(), plan(status="refused")], ids=str)
def test_the_records_of_the_method_come_back(record):
    assert differences(record, decode(encode(record), type(record))) == []


def test_equal_records_have_equal_bytes():
    assert encode(plan()) == encode(plan())


def test_arrays_that_come_back_can_be_written():
    back = decode(encode(everything(np.ones((3, 3), bool))), Everything)
    back.seen[0] = False
    back.cloud.points[0] = 1.0
    assert not back.seen[0].any() and (back.cloud.points[0] == 1.0).all()


def test_truth_values_are_packed():
    seen = np.random.default_rng(0).random((1000, 800)) < 0.5
    assert len(encode(Visibility(seen))) < 1.05 * seen.size / 8


def test_what_cannot_be_kept_is_named():
    with pytest.raises(TypeError, match="cloud"):
        encode(replace(everything(np.ones(2, bool)), cloud={1, 2}))


class Counted:
    """A function that counts its calls."""

    def __init__(self, record):
        self.record, self.calls = record, 0

    def __call__(self):
        self.calls += 1
        return self.record


def test_computed_once_per_stage_and_key(tmp_path):
    cache, compute = Cache(tmp_path), Counted(everything(np.ones((2, 9), bool)))
    for _ in range(3):
        assert differences(compute.record, cache("stage", Everything, "ab12", compute)) == []
    assert compute.calls == 1
    Cache(tmp_path)("stage", Everything, "ab12", compute)  # another process finds it as well
    assert compute.calls == 1
    cache("stage", Everything, "ab13", compute)
    cache("other", Everything, "ab12", compute)
    assert compute.calls == 3


@pytest.mark.parametrize("count", range(0, 3000, 150))
def test_a_truncated_entry_is_computed_again(tmp_path, count: int):
    cache, compute = Cache(tmp_path), Counted(everything(np.ones((2, 9), bool)))
    cache("stage", Everything, "k", compute)
    path = cache.path("stage", "k")
    content = path.read_bytes()
    assert len(content) > 2900
    path.write_bytes(content[:count])
    assert differences(compute.record, cache("stage", Everything, "k", compute)) == []
    assert compute.calls == 2
    assert path.read_bytes() == content  # and is whole again


def test_no_changed_byte_changes_what_is_believed(tmp_path):
    record = Correspondences(
        np.arange(40), np.random.default_rng(0).random(40), np.zeros((40, 3)), "two parts"
    )
    content = encode(record)
    noticed = 0
    for at in range(4, len(content) - 4, 3):
        damaged = bytearray(content)
        damaged[at] ^= 0x41
        try:
            back = decode(bytes(damaged), Correspondences)
        except CatalogError:
            noticed += 1
        else:
            assert differences(record, back) == [], at  # a byte that carries nothing
    assert noticed > 0.3 * len(content) / 3


def test_another_type_is_not_believed(tmp_path):
    cache = Cache(tmp_path)
    cache.put("stage", "k", Cloud(np.zeros((1, 3))))
    assert cache.get("stage", Visibility, "k") is None


def test_a_file_made_by_others_is_not_believed(tmp_path):
    path = tmp_path / "x.parquet"
    pq.write_table(__import__("pyarrow").table({"a": [1]}), path)
    with pytest.raises(CatalogError):
        decode(path.read_bytes(), Cloud)


@pytest.mark.parametrize("name", ["../x", "a/b", "", ".hidden", "a" * 65, "C:x", "x\0"])
def test_names_that_are_not_safe_are_refused(tmp_path, name: str):
    cache = Cache(tmp_path)
    with pytest.raises(InputError):
        cache.path("stage", name)
    with pytest.raises(InputError):
        cache.path(name, "key")


def test_no_draft_stays_behind(tmp_path):
    cache = Cache(tmp_path)
    cache.put("stage", "k", Cloud(np.zeros((1, 3))))
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["k.parquet"]


def test_where_nothing_can_be_kept_it_is_still_computed(tmp_path, caplog):
    blocked = tmp_path / "file"
    blocked.write_text("")
    compute = Counted(Cloud(np.zeros((1, 3))))
    assert Cache(blocked)("stage", Cloud, "k", compute) is compute.record
    assert "cannot remember" in caplog.text


def test_prune_forgets_what_was_unused_for_longest(tmp_path):
    cache = Cache(tmp_path)
    for at in range(5):
        cache.put("stage", f"k{at}", Cloud(np.zeros((1, 3))))
        os.utime(cache.path("stage", f"k{at}"), (at, at))
    assert cache.get("stage", Cloud, "k0") is not None  # used just now
    size = cache.path("stage", "k0").stat().st_size
    cache.prune(2 * size)
    assert {path.stem for _, _, path in cache.entries()} == {"k0", "k4"}
    cache.prune(0)
    assert cache.entries() == []
