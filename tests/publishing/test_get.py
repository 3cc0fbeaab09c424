"""Single objects fetched from a published data set: whole or not at all, and never twice."""

import contextlib
import hashlib
import json
import os
import shutil
import socket
import tempfile
from pathlib import Path

import pytest
import s3_server
import yaml
from published_set import IDS, Server, command, publish, serving, write_version

from objectfolder.errors import InputError
from objectfolder.products.store import read_product
from pipeline.audit import cloning, stores
from pipeline.audit.stores import NotHere, Stores
from pipeline.cli import main
from pipeline.dataset.stages import OBJECT_FILES
from pipeline.publish.cards import single_objects
from pipeline.publish.cards.single_objects import opened, split_revision


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The publisher's repository, a bare one as on a server, its remote, and the files of its versions."""
    folder = tmp_path_factory.mktemp("published")
    versions = publish(folder / "work", str(folder / "store"))
    command(folder, "git", "clone", "-q", "--bare", "work", "bare.git")
    return folder, versions


@pytest.fixture(scope="module")
def bare(made):
    return str(made[0] / "bare.git")


def get(*arguments, **options):
    return list(single_objects.get(*arguments, **options))


def add(root: Path) -> None:
    from dvc.repo import Repo

    with contextlib.chdir(root), Repo(str(root)) as repository:
        repository.add(["data/object_files"])


def stored(root: Path, content: bytes) -> Path:
    digest = hashlib.md5(content, usedforsecurity=False).hexdigest()
    return root / "files" / "md5" / digest[:2] / digest[2:]


def files(folder):
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("there", ("there", None)),
        ("there@v1", ("there", "v1")),
        ("a/b.git@feature/x", ("a/b.git", "feature/x")),
        ("git@host:owner/repo.git", ("git@host:owner/repo.git", None)),
        ("git@host:owner/repo.git@v2", ("git@host:owner/repo.git", "v2")),
        ("https://host/repo", ("https://host/repo", None)),
        ("https://me@host/repo", ("https://me@host/repo", None)),
        ("ssh://git@host/repo@1a2b", ("ssh://git@host/repo", "1a2b")),
        ("https://me@host/repo@v1", ("https://me@host/repo", "v1")),
    ],
)
def test_revisions_are_told_from_user_names(text, expected):
    assert split_revision(text) == expected


def test_a_path_with_an_at_sign_is_a_path(tmp_path):
    (tmp_path / "set@home").mkdir()
    assert split_revision(str(tmp_path / "set@home")) == (str(tmp_path / "set@home"), None)


@pytest.mark.slow
def test_objects_of_versions_come_alone(made, bare, tmp_path, capsys):
    _, versions = made
    for revision, version in (("", versions[1]), ("@v1", versions[0])):
        folder = tmp_path / f"got{revision}"
        assert main(["get", f"{bare}{revision}", "mug", "cup", "-o", str(folder)]) == 0
        assert files(folder) == {"mug.safetensors", "cup.safetensors"}
        for name in files(folder):
            assert (folder / name).read_bytes() == version[name]
    assert "fetched" in capsys.readouterr().out
    assert main(["get", f"{bare}@v1", "mug", "-o", str(tmp_path / "got")]) == 0  # another version replaces
    assert (tmp_path / "got/mug.safetensors").read_bytes() == versions[0]["mug.safetensors"]
    again = ["get", f"{bare}@v1", "mug", "-o", str(tmp_path / "got")]
    assert main(again) == 0
    assert "already there" in capsys.readouterr().out.splitlines()[-1]
    assert main([*again, "--json"]) == 0
    (figures,) = json.loads(capsys.readouterr().out)
    path = tmp_path / "got" / "mug.safetensors"
    assert figures == {"file": str(path), "bytes": path.stat().st_size, "outcome": "already there"}


@pytest.mark.slow
def test_ids_may_stand_after_options(bare, tmp_path, capsys):
    assert main(["get", bare, "-o", str(tmp_path), "mug", "--jobs", "2", "cup"]) == 0
    assert main(["get", bare, "fork", "-o", str(tmp_path / "more"), "cup"]) == 0
    assert files(tmp_path) == {
        "mug.safetensors", "cup.safetensors", "more/fork.safetensors", "more/cup.safetensors",
    }  # fmt: skip
    assert main(["get", bare, "mug", "--nothing", "cup"]) == 2
    assert "Unknown option: --nothing" in capsys.readouterr().err


@pytest.mark.slow
def test_a_place_that_cannot_be_written_is_said_and_others_come(bare, tmp_path, capsys):
    (tmp_path / "mug.safetensors").mkdir()
    assert main(["get", bare, "mug", "cup", "-o", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert f"{tmp_path}/mug.safetensors: cannot be written (Is a directory)" in said
    assert "1 of 2 failed" in said
    assert (tmp_path / "cup.safetensors").is_file()
    (tmp_path / "file").touch()
    assert main(["get", bare, "mug", "-o", str(tmp_path / "file")]) == 1
    assert "mug.safetensors: cannot be written (File exists)" in capsys.readouterr().err


class Unreachable:
    """A store that answers as one without credentials."""

    path = "far"

    def __init__(self, error):
        self.error = error
        self.fs = self

    def oid_to_path(self, oid):
        return oid

    def open(self, path, mode):
        raise self.error


def list_of(root: Path, store: Path) -> Path:
    """The stored list of Object Files, of a cache or a remote."""
    out = yaml.safe_load((root / "data/object_files.dvc").read_text())["outs"][0]["md5"]
    return store / "files/md5" / out[:2] / out[2:]


def test_a_list_comes_from_the_next_store_where_one_fails(made, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(made[0] / "work", copy)
    with opened(str(copy)) as published:
        whole = published.products(OBJECT_FILES)
        assert sorted(whole) == list(IDS)
        caches = published.stores._caches
        published.stores._caches = [Unreachable(PermissionError("403"))]
        assert published.products(OBJECT_FILES) == whole
        published.stores._caches = caches
        cached = list_of(copy, copy / ".dvc/cache")
        cached.chmod(0o644)
        cached.write_bytes(b"[]")
        assert published.products(OBJECT_FILES) == whole
        published.stores.remote = None
        with pytest.raises(NotHere, match=r"the cache: what is stored as .* is damaged"):
            published.products(OBJECT_FILES)


@pytest.mark.parametrize("error", [PermissionError("403 Forbidden"), RuntimeError("no credentials")])
def test_stores_that_cannot_be_read_are_named_without_a_traceback(bare, tmp_path, capsys, monkeypatch, error):
    monkeypatch.setattr(Stores, "remote", Unreachable(error))
    assert main(["get", bare, "mug", "-o", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert f"the remote far: {type(error).__name__}: {error}" in said
    assert "credentials" in said


def test_products_of_stages_lie_as_in_the_repository(bare, tmp_path):
    got = get(bare, ["fork"], tmp_path, stages=("views", "object_files"))
    assert [entry.path.relative_to(tmp_path).as_posix() for entry in got] == [
        "data/views/fork.zarr.zip", "data/object_files/fork.safetensors",
    ]  # fmt: skip
    assert read_product(got[0].path)["rgba"].tolist() == [[2] * 3] * 2


@pytest.mark.slow
def test_all_objects_and_the_list_of_them(bare, tmp_path, capsys):
    assert main(["get", bare, "--list"]) == 0
    assert capsys.readouterr().out.split() == list(IDS)
    assert [entry.object_id for entry in get(bare, [], tmp_path, jobs=3)] == list(IDS)


def test_a_local_repository_needs_no_remote(made, tmp_path):
    """Its cache serves, and what lies in it is what is asked for where no revision is."""
    copy = tmp_path / "copy"
    shutil.copytree(made[0] / "work", copy)
    (copy / ".dvc/config").write_text("")
    get(f"{copy}@v1", ["mug"], tmp_path / "a")
    assert (tmp_path / "a/mug.safetensors").read_bytes() == made[1][0]["mug.safetensors"]
    third = write_version(copy, 3)
    add(copy)
    get(str(copy), ["mug"], tmp_path / "b")
    assert (tmp_path / "b/mug.safetensors").read_bytes() == third["mug.safetensors"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "ids", "options", "match"),
    [
        ("{bare}", ["mugg"], [], "no object 'mugg' in data/object_files. Near are mug"),
        ("{bare}@v9", ["mug"], [], "no revision 'v9'"),
        ("{bare}", ["mug"], ["--stage", "viws"], "no products of this name. There are object_files"),
        ("{bare}", ["mug"], ["--stage", "modes"], "this revision has no data/modes"),
        ("{bare}", ["mug"], ["--remote", "other"], "The repository has store."),
        ("{nowhere}", ["mug"], [], "cannot be opened ("),
        ("{plain}", ["mug"], [], "Name the path or URL of a data set: a git repository under DVC"),
    ],
)
def test_what_cannot_be_got_is_said(bare, tmp_path, capsys, where, ids, options, match):
    (tmp_path / "plain").mkdir()
    command(tmp_path / "plain", "git", "init", "-q")
    (tmp_path / "plain/x").write_text("x")
    command(tmp_path / "plain", "git", "add", "x")
    command(tmp_path / "plain", "git", "commit", "-qm", "x")
    repository = where.format(bare=bare, nowhere=tmp_path / "nowhere", plain=tmp_path / "plain")
    assert main(["get", repository, *ids, *options, "-o", str(tmp_path / "got")]) == 1
    assert match in capsys.readouterr().err
    assert not (tmp_path / "got").exists()


def test_content_that_was_not_pushed_is_said_and_others_come(made, tmp_path, capsys):
    folder, versions = made
    shutil.copytree(folder, tmp_path / "there")
    store = tmp_path / "there/store"
    bare = tmp_path / "there/bare.git"
    config = (folder / "work/.dvc/config").read_text().replace(str(folder), str(tmp_path / "there"))
    work = tmp_path / "there/work"
    (work / ".dvc/config").write_text(config)
    command(work, "git", "commit", "-qam", "moved")
    command(work, "git", "push", "-q", str(bare), "main")
    stored(store, versions[1]["mug.safetensors"]).unlink()
    assert main(["get", str(bare), "mug", "cup", "-o", str(tmp_path / "got")]) == 1
    error = capsys.readouterr().err
    assert "mug.safetensors: not readable here" in error
    assert "neither in the cache nor at the remote" in error
    assert "dvc push" in error
    assert "1 of 2 failed" in error
    assert files(tmp_path / "got") == {"cup.safetensors"}


@pytest.mark.parametrize("place", [0, 700_000, -1])
def test_a_flipped_bit_in_the_store_is_never_delivered(made, tmp_path, place):
    folder, versions = made
    copy = tmp_path / "copy"
    shutil.copytree(folder / "work", copy)
    content = versions[1]["mug.safetensors"]
    path = stored(copy / ".dvc/cache", content)
    damaged = bytearray(content)
    damaged[place] ^= 4
    path.chmod(0o644)
    path.write_bytes(damaged)
    # The remote has it whole, and serves where the cache does not.
    assert [entry.outcome for entry in get(str(copy), ["mug"], tmp_path / "a")] == ["fetched"]
    assert (tmp_path / "a/mug.safetensors").read_bytes() == content
    (copy / ".dvc/config").write_text("")
    [got] = get(str(copy), ["mug"], tmp_path / "b")
    assert "that are not" in str(got.error)
    assert files(tmp_path / "b") == set()


def test_a_published_file_that_is_no_product_is_refused(made, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(made[0] / "work", copy)
    (copy / "data/object_files/bad.safetensors").write_bytes(b"not a product at all")
    add(copy)
    [got] = get(str(copy), ["bad"], tmp_path / "got")
    assert "safetensors" in str(got.error)
    assert files(tmp_path / "got") == set()


def clone_with(publication, tmp_path, settings: str, file: str = ".dvc/config") -> Path:
    """A clone of the publisher's repository, in which a file of settings is committed."""
    work = tmp_path / "work"
    command(tmp_path, "git", "clone", "-q", str(publication[0] / "bare.git"), str(work))
    (work / file).write_text(settings)
    command(work, "git", "add", "-f", file)
    command(work, "git", "commit", "-qm", "settings")
    return work


@pytest.mark.parametrize("revision", ["", "@HEAD", "by URL"])
def test_settings_of_a_remote_that_may_run_a_command_are_refused(
    made, tmp_path, capsys, monkeypatch, revision
):
    """A file of credentials names a process to run; the user alone may name it."""
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    mark, credentials = tmp_path / "mark", tmp_path / "credentials"
    credentials.write_text(f"[default]\ncredential_process = /usr/bin/touch {mark}\n")
    settings = (
        "[core]\n    remote = x\n['remote \"x\"']\n    url = s3://bucket/p\n"
        f"    endpointurl = http://127.0.0.1:9\n    credentialpath = {credentials}\n"
    )
    work = clone_with(made, tmp_path, settings)
    address = f"file://{work}" if revision == "by URL" else f"{work}{revision}"
    assert main(["get", address, "--list"]) == 1
    said = capsys.readouterr().err
    assert "remote 'x' sets credentialpath, which is taken from your own settings alone" in said
    assert "dvc remote modify --local x credentialpath" in said
    assert main(["history", "mug", "--root", str(work)]) == 1
    assert "sets credentialpath" in capsys.readouterr().err
    assert not mark.exists()
    assert files(scratch) == set()
    # What the user sets counts.
    (work / ".dvc/config.local").write_text(f"['remote \"x\"']\n    credentialpath = {credentials}\n")
    if revision != "by URL":
        with opened(address) as published:
            assert published.stores.remote.path == "bucket/p/files/md5"


def test_own_settings_under_version_control_are_refused(made, tmp_path, capsys):
    work = clone_with(made, tmp_path, "['remote \"store\"']\n    profile = lab\n", ".dvc/config.local")
    for address in (str(work), f"file://{work}"):
        assert main(["get", address, "--list"]) == 1
        assert ".dvc/config.local: is under version control" in capsys.readouterr().err


@pytest.mark.parametrize("link", [".dvc", ".dvc/tmp"])
def test_links_in_place_of_the_folder_of_settings_are_refused(made, tmp_path, capsys, link):
    """DVC would read the author's ``config.local`` as the user's own, or write where a link leads."""
    work = clone_with(made, tmp_path, "[core]\n    analytics = false\n")
    place = work / link
    if place.exists():
        place.rename(work / "elsewhere")
    place.symlink_to(os.path.relpath(work / "elsewhere", place.parent))
    (work / "elsewhere").mkdir(exist_ok=True)
    (work / "elsewhere/config.local").write_text("['remote \"store\"']\n    profile = lab\n")
    command(work, "git", "add", "-A", "-f")
    command(work, "git", "commit", "-qm", "link")
    for arguments in (["get", str(work), "--list"], ["history", "mug", "--root", str(work)]):
        assert main(arguments) == 1
        assert f"objectfolder: {link}: is a link" in capsys.readouterr().err


def test_imports_of_a_foreign_repository_are_not_read(made, tmp_path):
    """DVC would read the settings that an import names: of a named pipe it would wait for them."""
    os.mkfifo(tmp_path / "settings")
    an_import = {"path": "x", "repo": {"url": "x", "config": str(tmp_path / "settings")}}
    text = yaml.safe_dump({"deps": [an_import], "outs": [{"path": "x"}]})
    work = clone_with(made, tmp_path, text, "data/x.dvc")
    [got] = get(str(work), ["mug"], tmp_path / "got", remote="store")
    assert got.outcome == "fetched"


def test_a_remote_that_lies_in_itself_is_refused(made, tmp_path, capsys):
    settings = (
        "[core]\n    remote = x\n['remote \"x\"']\n    url = remote://y/a\n"
        "['remote \"y\"']\n    url = remote://x/b\n"
    )
    assert main(["get", str(clone_with(made, tmp_path, settings)), "--list"]) == 1
    assert "remote 'x' lies in others, more than 10 deep or in itself" in capsys.readouterr().err


def test_a_remote_of_the_users_own_is_not_sent_elsewhere(made, tmp_path, capsys, monkeypatch):
    """Its password would go to an address that a repository names."""
    monkeypatch.setenv("DVC_GLOBAL_CONFIG_DIR", str(tmp_path))
    (tmp_path / "config").write_text("['remote \"store\"']\n    url = http://127.0.0.1:9\n    password = x\n")
    assert main(["get", str(made[0] / "bare.git"), "--list"]) == 1
    assert "remote 'store' sets another url than your settings" in capsys.readouterr().err


@pytest.mark.slow
def test_contents_larger_than_any_of_their_kind_are_refused(bare, tmp_path, monkeypatch):
    monkeypatch.setitem(stores.MOST_BYTES, ".safetensors", 1000)
    [got] = get(bare, ["mug"], tmp_path)
    assert "more than the 1000 of any product of this kind" in str(got.error)
    assert files(tmp_path) == set()
    monkeypatch.setattr(stores, "MOST_LIST_BYTES", 10)
    with pytest.raises(NotHere, match="a list of more than 10 bytes"):
        get(bare, ["mug"], tmp_path)


def test_a_repository_that_cannot_be_cloned_leaves_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert main(["get", f"file://{tmp_path}/nowhere", "mug", "-o", str(tmp_path / "got")]) == 1
    assert "cannot be opened (" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_clone_is_bounded_in_size_and_in_patience(bare, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(cloning, "MOST_FILES", 10)
    with pytest.raises(InputError, match="or 10 files, which no repository of a data set needs"):
        get(f"file://{bare}@HEAD", ["mug"], tmp_path / "got")
    monkeypatch.undo()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(cloning, "PATIENCE_S", 0.5)
    with (
        socket.create_server(("127.0.0.1", 0)) as silent,
        pytest.raises(InputError, match=r"sent nothing for 0.5 s"),
    ):
        get(f"git://127.0.0.1:{silent.getsockname()[1]}/x", ["mug"], tmp_path / "got")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def by_http(made, tmp_path):
    """The repository with a remote that only HTTP serves, without the publisher's cache."""
    folder, versions = made
    with serving(Server(folder / "store")) as server:
        bare = tmp_path / "http.git"
        work = tmp_path / "work"
        command(tmp_path, "git", "clone", "-q", str(folder / "bare.git"), str(work))
        (work / ".dvc/config").write_text(
            f"[core]\n    remote = store\n['remote \"store\"']\n    url = {server.address}\n"
        )
        command(work, "git", "commit", "-qam", "by HTTP")
        command(tmp_path, "git", "clone", "-q", "--bare", str(work), str(bare))
        yield server, str(bare), versions[1]["mug.safetensors"]


@pytest.mark.slow
def test_a_full_disk_is_no_fault_of_the_store(by_http, tmp_path, monkeypatch):
    server, bare, _ = by_http
    opened = Path.open

    def full(path, *arguments, **options):
        partial = path.parent.name.startswith(".partial-")
        return opened(Path("/dev/full") if partial else path, *arguments, **options)

    monkeypatch.setattr(Path, "open", full)
    [got] = get(bare, ["mug"], tmp_path / "got")
    assert "No space left" in str(got.error)
    assert "Make room" in str(got.error)
    assert sum(server.sent.values()) < 2_000_000  # one try, not one after the other


def test_a_cut_is_tried_again_at_once(by_http, tmp_path):
    server, bare, content = by_http
    server.cut_at, server.cuts = 800_000, 2
    [got] = get(bare, ["mug"], tmp_path)
    assert server.cuts == 0
    assert got.outcome == "fetched"
    assert (tmp_path / "mug.safetensors").read_bytes() == content


@pytest.mark.slow
def test_objects_come_from_s3(tmp_path, monkeypatch):
    with s3_server.serving() as address:
        for name, value in s3_server.environment(address).items():
            monkeypatch.setenv(name, value)
        settings = f"    endpointurl = {os.environ['AWS_ENDPOINT_URL']}\n"
        versions = publish(tmp_path / "work", f"s3://{s3_server.new_bucket(address)}/dvc", settings, (1,))
        command(tmp_path, "git", "clone", "-q", "--bare", "work", "bare.git")
        content = versions[0]["mug.safetensors"]
        get(f"{tmp_path}/bare.git@v1", ["mug"], tmp_path / "got")
        assert (tmp_path / "got/mug.safetensors").read_bytes() == content
