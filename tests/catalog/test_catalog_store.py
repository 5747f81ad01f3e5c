"""The same catalog in an object store: two writers at once, and no credential kept anywhere."""

from __future__ import annotations

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta

import boto3
import pytest
from catalog_records import demonstration, differences, key_of, plan, structure
from object_store import object_store
from pyarrow.fs import S3FileSystem

from upplied.catalog import compact, export_tables, open_catalog, vacuum, verify
from upplied.catalog.store.files import FileStore
from upplied.catalog.store.opening import Clock
from upplied.errors import CatalogError

SECRET = "not-to-be-seen-anywhere"
BUCKET = "fleet"


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    with object_store() as address:
        yield address


@pytest.fixture
def store(endpoint, monkeypatch, tmp_path):
    """A bucket of its own, reached through the environment alone."""
    for name, value in {
        "AWS_ACCESS_KEY_ID": "writer",
        "AWS_SECRET_ACCESS_KEY": SECRET,
        "AWS_REGION": "us-east-1",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ALLOW_HTTP": "true",
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }.items():
        monkeypatch.setenv(name, value)
    client = boto3.client("s3", endpoint_url=endpoint)
    client.create_bucket(Bucket=BUCKET)
    yield client
    for item in client.list_objects_v2(Bucket=BUCKET).get("Contents", []):
        client.delete_object(Bucket=BUCKET, Key=item["Key"])
    client.delete_bucket(Bucket=BUCKET)


def content(client) -> dict[str, bytes]:
    names = [item["Key"] for item in client.list_objects_v2(Bucket=BUCKET)["Contents"]]
    return {name: client.get_object(Bucket=BUCKET, Key=name)["Body"].read() for name in names}


def test_writers_who_come_first_at_once_make_one_catalog(store, monkeypatch):
    drawn = f"s3://{BUCKET}/drawn"
    files = [FileStore(drawn) for _ in range(4)]
    monkeypatch.setattr(FileStore, "has", lambda *_: False)  # all look before the first of them writes
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda at: files[at].create("note", f"of {at}".encode()), range(4)))
    note = files[0].read("note")
    files[1].create("note", b"of somebody who comes later")
    assert note == files[0].read("note")


def test_who_looked_before_another_wrote_takes_its_identity(store, monkeypatch):
    drawn, has = f"s3://{BUCKET}/drawn", FileStore.has
    first = open_catalog(drawn).create().identity.id
    looks = [False, False]  # before the other wrote: is there a catalog, and a file

    def looked(files, name):
        return looks.pop() if name == "catalog.json" and looks else has(files, name)

    monkeypatch.setattr(FileStore, "has", looked)
    assert open_catalog(drawn).create().identity.id == first
    assert open_catalog(drawn).identity.id == first


@pytest.mark.slow
def test_everything_works_as_in_a_folder(store, tmp_path):
    catalog = open_catalog(f"s3://{BUCKET}/catalog")
    catalog.add_structures([structure("boxy"), structure("target", 1)])
    catalog.add_demonstrations([demonstration()])
    catalog.add_plans([(key_of(at), plan("target", at), {}) for at in range(3)])
    catalog.add_plans([(key_of(1), plan("target", 1), {})])
    assert len(catalog.transfers(every=True)) == 3
    again = open_catalog(f"s3://{BUCKET}/catalog/")
    assert differences(structure("boxy"), again.structure("boxy")) == []
    assert differences(demonstration(), again.demonstration("flight")) == []
    assert differences(plan("target", 1).trajectory, again.plan(key_of(1)[:20]).trajectory) == []
    assert type(again.tables["transfers"].dataset().filesystem.base_fs) is S3FileSystem  # and no callbacks
    assert verify(again) == []
    assert compact(again)["transfers"] == 2
    vacuum(again)
    assert verify(again) == []
    assert export_tables(again, tmp_path / "reports")["transfers"] == 1
    assert str(again.cache.folder).startswith(str(tmp_path / "cache"))


@pytest.mark.ci
def test_no_credential_is_stored_or_said(store, tmp_path, caplog):
    caplog.set_level("DEBUG")
    catalog = open_catalog(f"s3://{BUCKET}/catalog")
    catalog.add_structures([structure("boxy")])
    catalog.add_plans([(key_of(0), plan(), {})])
    assert SECRET not in caplog.text + repr(catalog) + repr(vars(catalog))
    contents = content(store)
    assert any(name.endswith(".parquet") for name in contents)
    for name, stored in contents.items():
        assert SECRET.encode() not in stored, name
    for path in tmp_path.rglob("*"):
        assert not path.is_file() or SECRET.encode() not in path.read_bytes()


def test_a_store_that_cannot_be_reached_is_said_without_credentials(store, monkeypatch):
    for location in (f"s3://key:{SECRET}@{BUCKET}/catalog", f"s3://{BUCKET}/catalog?secret_key={SECRET}"):
        with pytest.raises(CatalogError, match="environment") as error:
            open_catalog(location)
        assert SECRET not in str(error.value)
    for location in ("s3://", "s3:///"):
        with pytest.raises(CatalogError, match="names no bucket"):
            open_catalog(location)
    for ask in (
        lambda c: c.transfers(),
        lambda c: c.structures(),
        lambda c: c.contents["meshes"].get("0" * 64),
    ):
        with pytest.raises(CatalogError, match=r"ucket no-such-bucket was requested at http://127"):
            ask(open_catalog("s3://no-such-bucket/catalog"))
    with pytest.raises(CatalogError, match="no-such-bucket") as error:
        open_catalog("s3://no-such-bucket/catalog").add_plans([(key_of(0), plan(), {})])
    assert SECRET not in str(error.value)


def writer(location: str, seed: int, count: int) -> None:
    catalog = open_catalog(location)
    for number in range(count):
        own, shared = key_of(seed, number), key_of("shared", number)
        catalog.add_plans(
            [(own, plan(f"t-{seed}-{number}", number), {}), (shared, plan(f"s-{number}", number), {})]
        )


@pytest.mark.ci
def test_two_writers_at_once_lose_nothing(store):
    location, count = f"s3://{BUCKET}/catalog", 3
    context = multiprocessing.get_context("spawn")
    writers = [context.Process(target=writer, args=(location, seed, count)) for seed in (1, 2)]
    for process in writers:
        process.start()
    for process in writers:
        process.join(240)
        assert process.exitcode == 0
    catalog = open_catalog(location)
    expected = {key_of(seed, number) for seed in (1, 2, "shared") for number in range(count)}
    rows = catalog.transfers(every=True)
    assert sorted(rows["key"]) == sorted(expected)
    assert [f for f in verify(catalog) if "is not in" not in f.found] == []  # no structures here


def test_jobs_of_killed_runs_go_from_an_object_store_too(store, monkeypatch):
    catalog = open_catalog(f"s3://{BUCKET}/jobs").create()
    for run in ("one", "other"):
        catalog.shards.write(f"{run}/00000.jobs", b"{}")
    assert vacuum(catalog, keep_days=30).runs_removed == 0
    later = datetime.now(UTC) + timedelta(days=40)
    monkeypatch.setattr(Clock, "now", lambda _: later)
    assert catalog.shards.names() == ["one", "other"]
    assert vacuum(catalog, keep_days=30).runs_removed == 2
    assert not any(name.endswith(".jobs") for name in content(store)) and not catalog.shards.names()
