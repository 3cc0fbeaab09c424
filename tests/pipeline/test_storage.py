"""A store of products at a URL: whole or not there, and what it says when it cannot be used."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

import http_faults
import pytest
import s3_server
from toys import FILES, QUALITY, REPOSITORY, TUNED

from objectfolder.errors import InputError, MissingPackageError, SimulationError
from pipeline.dataset import products
from pipeline.dataset.manifest import Entry
from pipeline.store import shared
from pipeline.store.product_cache import INDEX, ProductCache
from pipeline.store.storage import PATIENCE, STORE, Store, product_name, source_name

FINGERPRINT = "ab" * 32
MD5 = "0a" * 16
NAME = product_name(FINGERPRINT, "views.zarr.zip")


@pytest.fixture(scope="module")
def server():
    with s3_server.serving() as address:
        yield address


@pytest.fixture
def faults(server, monkeypatch):
    """A proxy before the server; clients are pointed at it."""
    proxy = http_faults.Proxy(server, late_s=1.5)
    with http_faults.standing_before(proxy) as address:
        for name, value in s3_server.environment(address).items():
            monkeypatch.setenv(name, value)
        yield proxy


@pytest.fixture
def bucket(server, faults):
    return s3_server.new_bucket(server)


@pytest.fixture
def impatient(monkeypatch):
    """A second to answer, and one of tries."""
    monkeypatch.setattr("pipeline.store.storage.TIMEOUTS", {"connect_timeout": "2s", "read_timeout": "1s"})
    monkeypatch.setenv(PATIENCE, "1")


@pytest.fixture(autouse=True)
def _fresh_caches():
    shared._cache_at.cache_clear()


@pytest.fixture(params=["folder", "s3"])
def url(request, tmp_path_factory):
    if request.param == "s3":
        return f"s3://{request.getfixturevalue('bucket')}/some/prefix"
    return f"file://{tmp_path_factory.mktemp('store')}"


def test_what_is_put_is_got_and_what_is_not_there_is_said_to_be_so(url, tmp_path):
    store = Store(url)
    store.check()
    source, target = tmp_path / "source", tmp_path / "new" / "target"
    source.write_bytes(os.urandom(70_000))
    assert not store.get(NAME, target)
    assert store.size(NAME) is None
    store.remove(NAME)
    store.put(source, NAME)
    store.put(source, NAME)  # a second writer changes nothing
    assert store.size(NAME) == 70_000
    assert store.get(NAME, target)
    assert target.read_bytes() == source.read_bytes()
    assert list(target.parent.iterdir()) == [target]
    store.remove(NAME)
    assert store.size(NAME) is None


@pytest.mark.parametrize(
    "name", ["ab/x", f"../{FINGERPRINT}", f"ab/{FINGERPRINT}/../x", f"ab/{FINGERPRINT}/a b", ""]
)
def test_names_are_fingerprints_and_kinds_and_nothing_else(name, tmp_path):
    with pytest.raises(ValueError, match="no name"):
        Store(f"file://{tmp_path}").size(name)
    assert Store(f"file://{tmp_path}").size(source_name(FINGERPRINT)) is None


def test_products_come_from_the_store_where_data_are_gone(toys, url, monkeypatch):
    monkeypatch.setenv(STORE, url)
    toys.converge()
    assert len(toys.executed()) == 9
    first = _take_away(toys)
    for summary in toys.converge():
        assert summary.restored == ("ball", "cup", "dish")
    assert toys.executed() == []
    assert {path: path.read_bytes() for path in first} == first


def test_a_stage_with_two_products_counts_only_when_both_are_there(toys, bucket, server, monkeypatch):
    monkeypatch.setenv(STORE, f"s3://{bucket}")
    toys.converge()
    first = _take_away(toys)
    toys.executed()
    fingerprint = products.read_fingerprint(_written(first, QUALITY.path(toys.root, "cup")))
    s3_server.client(server).delete_object(
        Bucket=bucket, Key=product_name(fingerprint, products.kind_name(QUALITY.path(toys.root, "cup")))
    )
    toys.converge()
    assert toys.executed() == ["encode cup"]
    assert {path: path.read_bytes() for path in first} == first


@pytest.mark.parametrize(
    ("kind", "damage"),
    [(TUNED, "cut"), (FILES, "one bit"), (TUNED, "of another object")],
    ids=["cut", "one bit", "of another object"],
)
def test_a_damaged_entry_is_made_anew_and_made_good(toys, bucket, server, monkeypatch, kind, damage):
    monkeypatch.setenv(STORE, f"s3://{bucket}")
    toys.converge()
    first = _take_away(toys)
    toys.executed()
    path = _written(first, kind.path(toys.root, "cup"))
    key = product_name(products.read_fingerprint(path), products.kind_name(path))
    whole = path.read_bytes()
    broken = bytearray(whole)
    broken[len(whole) // 2 if kind is FILES else len(whole) // 4] ^= 1
    content = first[kind.path(toys.root, "ball")]
    body = {"cut": whole[:-9], "one bit": bytes(broken), "of another object": content}[damage]
    s3_server.client(server).put_object(Bucket=bucket, Key=key, Body=body)
    path.unlink()
    toys.converge()
    assert toys.executed() == [f"{kind.made_by if kind is TUNED else 'encode'} cup"]
    assert {path: path.read_bytes() for path in first} == first
    assert s3_server.contents(server, bucket)[key] == whole


def test_a_run_goes_on_without_its_cache_and_the_next_one_fills_it(
    toys, bucket, server, faults, impatient, monkeypatch, capsys
):
    monkeypatch.setenv(STORE, f"s3://{bucket}")
    faults.refuse = True
    for summary in toys.converge():
        assert summary.computed == ("ball", "cup", "dish")
    said = capsys.readouterr().err
    assert said.count("the run goes on without it") == 1
    assert f"s3://{bucket}" in said
    assert "products are not in" in said
    assert s3_server.contents(server, bucket) == {}
    faults.refuse = False
    shared._cache_at.cache_clear()  # as in a new process
    toys.executed()
    toys.converge()
    assert toys.executed() == []
    assert not list((toys.root / ".objectfolder" / "outbox").iterdir())
    assert len(s3_server.contents(server, bucket)) == 12
    first = _take_away(toys)
    toys.converge()
    assert toys.executed() == []
    assert {path: path.read_bytes() for path in first} == first


def test_a_store_that_comes_back_is_waited_for(bucket, faults, tmp_path, monkeypatch):
    store = Store(f"s3://{bucket}", patience_s=60)
    (tmp_path / "source").write_bytes(b"x" * 1000)
    faults.refuse = True
    tries = threading.Event()
    faults.refused = lambda: tries.set()
    threading.Thread(target=lambda: (tries.wait(60), setattr(faults, "refuse", False))).start()
    store.put(tmp_path / "source", NAME)
    assert tries.is_set()
    assert store.size(NAME) == 1000


@pytest.mark.slow
@pytest.mark.parametrize("kind", http_faults.KINDS)
def test_each_fault_is_tried_again(kind, bucket, faults, impatient, tmp_path):
    store = Store(f"s3://{bucket}", patience_s=60)
    (tmp_path / "source").write_bytes(os.urandom(200_000))
    faults.kinds, faults.late_s = (kind,), 1.5

    def once(action):
        faults.rate = 1.0
        faults.after_fault = lambda: setattr(faults, "rate", 0.0)
        return action()

    once(lambda: store.put(tmp_path / "source", NAME))
    assert once(lambda: store.size(NAME)) == 200_000
    assert once(lambda: store.get(NAME, tmp_path / "target"))
    assert (tmp_path / "target").read_bytes() == (tmp_path / "source").read_bytes()
    assert faults.faults[kind] >= 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["source", "target"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["500", "503", "late", "reset", "answer cut"])
def test_what_does_not_pass_ends_in_time_with_a_clear_error(kind, bucket, faults, impatient, tmp_path):
    store = Store(f"s3://{bucket}")
    (tmp_path / "source").write_bytes(b"x" * 1000)
    store.put(tmp_path / "source", NAME)
    faults.kinds, faults.rate = (kind,), 1.0
    with pytest.raises(SimulationError) as caught:
        store.get(NAME, tmp_path / "target")
    assert caught.value.where == f"s3://{bucket}"
    assert "no success" in caught.value.finding
    assert "for 1 s at most" in caught.value.finding
    assert "run again" in caught.value.remedy
    assert [path.name for path in tmp_path.iterdir()] == ["source"]


def test_a_store_that_cannot_be_used_says_why(bucket, faults, impatient, monkeypatch, tmp_path):
    with pytest.raises(InputError, match="no such bucket"):
        Store("s3://bucket-that-is-not-there/x").check()
    with pytest.raises(InputError, match=r"Bad_Bucket!.*correct OBJECTFOLDER_STORE"):
        Store("s3://Bad_Bucket!/x").check()
    with pytest.raises(InputError, match="nothing://x"):
        Store("nothing://x")
    with pytest.raises(InputError, match="relative path"):
        Store("some/folder")
    faults.kinds, faults.rate = ("403",), 1.0
    with pytest.raises(InputError, match=r"access denied.*rights to list, read, write and delete"):
        Store(f"s3://{bucket}").check()
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    with pytest.raises(InputError, match="credentials"):
        Store(f"s3://{bucket}").check()
    monkeypatch.setenv(PATIENCE, "soon")
    with pytest.raises(InputError, match="'soon' is not a number"):
        Store(f"file://{tmp_path}")


@pytest.mark.parametrize(
    ("status", "kind", "finding"),
    [
        ("503", SimulationError, r"no success \(.*503 Service Unavailable"),
        ("403", InputError, "access denied"),
    ],
)
def test_an_error_of_azure_is_one_of_the_store(
    faults, impatient, tmp_path, monkeypatch, status, kind, finding
):
    with http_faults.standing_before(faults) as address:
        for name, value in {"ACCOUNT_NAME": "me", "ACCOUNT_KEY": "a2V5", "ENDPOINT": address}.items():
            monkeypatch.setenv(f"AZURE_STORAGE_{name}", value)
        faults.kinds, faults.rate = (status,), 1.0
        (tmp_path / "source").write_bytes(b"x")
        with pytest.raises(kind, match=finding) as caught:
            Store("az://container/prefix").put(tmp_path / "source", NAME)
    assert caught.value.where == "az://container/prefix"
    assert NAME in caught.value.finding
    assert sum(faults.requests.values()) == 1 if status == "403" else sum(faults.requests.values()) > 1


def test_a_store_without_its_library_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "boto3", None)
    monkeypatch.delitem(sys.modules, "obstore.auth.boto3", raising=False)
    with pytest.raises(MissingPackageError, match=r"boto3: is not installed.*factory\[s3\]"):
        Store("s3://bucket/x")


def test_a_run_with_a_store_that_cannot_be_used_ends_before_it_works(toys, faults, monkeypatch):
    monkeypatch.setenv(STORE, "s3://bucket-that-is-not-there")
    with pytest.raises(InputError, match="no such bucket"):
        toys.converge()
    assert toys.executed() == []


def test_permission_denied_names_the_folder(tmp_path):
    """As a user without rights: root has all."""
    store = tmp_path / "store"
    (store / "ab").mkdir(parents=True)
    (store / "ab").chmod(0o555)
    (tmp_path / "source").write_bytes(b"x")
    for folder in (tmp_path, *tmp_path.parents):
        if folder.owner() == tmp_path.owner() and folder != Path("/"):
            folder.chmod(folder.stat().st_mode | 0o055)
    answer = _in_process(
        f"Store({str(store)!r}).put(Path({str(tmp_path / 'source')!r}), {NAME!r})",
        as_user=65534 if os.geteuid() == 0 else None,
    )
    assert answer["kind"] == "InputError"
    assert str(store / "ab") in answer["where"]
    assert "Permission denied" in answer["finding"]


@pytest.mark.parametrize("side", ["store", "data"])
def test_disk_full_names_the_folder_and_leaves_nothing_half_written(side, tmp_path):
    """On a file system of 64 KiB, in a mount namespace of its own."""
    small = tmp_path / "small"
    small.mkdir()
    probe = subprocess.run(
        ["unshare", "-m", "mount", "-t", "tmpfs", "none", str(small)], capture_output=True, check=False
    )
    if probe.returncode:
        pytest.skip("no mount namespaces here (needs root)")
    large = tmp_path / "large"
    large.mkdir()
    (tmp_path / "source").write_bytes(os.urandom(200_000))
    if side == "store":
        act = f"Store({str(small)!r}).put(Path({str(tmp_path / 'source')!r}), {NAME!r})"
    else:
        Store(str(large)).put(tmp_path / "source", NAME)
        act = f"Store({str(large)!r}).get({NAME!r}, Path({str(small / 'target')!r}))"
    mount = f'mount -t tmpfs -o size=64k none {small} && exec "$@"'
    left = f"[str(path) for path in Path({str(small)!r}).rglob('*') if path.is_file()]"
    answer = _in_process(act, left, prefix=["unshare", "-m", "sh", "-c", mount, "sh"])
    assert answer["kind"] == "SimulationError"
    assert str(small) in answer["where"]
    assert answer["finding"] == "no space left"
    assert "run again" in answer["remedy"]
    assert answer["left"] == []


def test_an_experiment_in_a_copy_has_the_cache_of_its_original(tmp_path):
    (tmp_path / ".dvc").mkdir()
    (tmp_path / ".dvc" / "config.local").write_text("[cache]\n    dir = ../elsewhere\n")
    cached = ProductCache(tmp_path).path(MD5)
    assert cached.resolve() == tmp_path / "elsewhere" / "files" / "md5" / MD5[:2] / MD5[2:]
    copy = tmp_path / ".dvc" / "tmp" / "exps" / "tmpabc"
    assert ProductCache(copy).path(MD5) == cached
    for checkout in (tmp_path, copy):  # a partition has that of its checkout
        assert ProductCache(checkout / "partitions" / "000").path(MD5) == cached
    assert ProductCache(tmp_path.parent / "exps" / "x").path(MD5) != cached
    ProductCache(copy).add([Entry("mug", "views", "data/views/mug.zarr.zip", "f" * 64, MD5, 1)])
    assert MD5 in (tmp_path / INDEX).read_text()


def test_a_damaged_copy_in_the_cache_goes(toys):
    toys.converge()
    toys.commit()
    toys.executed()
    path = TUNED.path(toys.root, "cup")
    whole = path.read_bytes()
    cached = ProductCache(toys.root).path(products.md5_of(path))
    cached.write_bytes(whole[:-7])
    path.unlink()
    toys.converge()
    assert toys.executed() == ["tune cup"]
    assert path.read_bytes() == whole
    assert not cached.exists()


def _take_away(toys) -> dict[Path, bytes]:
    """Remove all products; return what they were."""
    first = {path: path.read_bytes() for path in toys.root.glob("data/*/*")}
    for path in first:
        path.unlink()
    return first


def _written(first: dict[Path, bytes], path: Path) -> Path:
    path.write_bytes(first[path])
    return path


def _in_process(act: str, left: str = "[]", as_user: int | None = None, prefix: Sequence[str] = ()) -> dict:
    """Do something with a store in a process of its own; return its error as data."""
    script = f"""
import json, os
from pathlib import Path
import obstore.exceptions
from objectfolder.errors import ObjectFolderError
from pipeline.store.storage import Store
if {as_user} is not None:
    Store("/")  # imports what it needs: the other user may not read this checkout
    os.setuid({as_user})
try:
    {act}
except ObjectFolderError as error:
    said = {{"kind": type(error).__name__, "where": error.where, "finding": error.finding}}
    print(json.dumps({{**said, "remedy": error.remedy, "left": {left}}}))
"""
    command = [*prefix, sys.executable, "-c", script]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.stdout, done.stderr
    return json.loads(done.stdout)
