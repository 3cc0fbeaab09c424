"""A DVC remote on an S3 server: versions pushed, pulled, and one object of one version fetched alone."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import http_faults
import pytest
import s3_server
from repositories import Repository
from store_runs import made
from toys import TUNED


@pytest.fixture
def repository(toys) -> Repository:
    return Repository(toys)


@pytest.fixture
def bucket_and_proxy(monkeypatch):
    pytest.importorskip("dvc_s3", reason="dvc-s3 is not installed")
    with s3_server.serving() as server:
        proxy = http_faults.Proxy(server)
        with http_faults.standing_before(proxy) as address:
            for name, value in s3_server.environment(address).items():
                monkeypatch.setenv(name, value)
            yield s3_server.new_bucket(server), proxy


@pytest.mark.slow
@pytest.mark.release("pipeline.run", "pipeline.store")
def test_one_object_of_one_version_comes_alone(repository, bucket_and_proxy, tmp_path_factory):
    bucket, proxy = bucket_and_proxy
    toys = repository.toys
    (toys.root / ".dvc" / "config").write_text(
        "[core]\n    remote = store\n['remote \"store\"']\n"
        f"    url = s3://{bucket}/dvc\n    endpointurl = {os.environ['AWS_ENDPOINT_URL']}\n"
    )
    versions = []
    for message, content in (("first", "2.0"), ("second", "5.0")):
        toys.add("cup", content)
        toys.rows["cup"]["material"] = {"stiffness": float(content)}
        repository.save()
        repository.repro()
        repository.commit(message)
        versions.append(made(toys))
    name = TUNED.path(toys.root, "cup").relative_to(toys.root).as_posix()
    first, second = (version[name] for version in versions)
    assert first != second
    repository.run("dvc", "push", "-q", "--all-commits")

    # Nothing is here any more: what comes, comes from the remote.
    shutil.rmtree(toys.root / ".dvc" / "cache")
    shutil.rmtree(toys.root / "data")
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    for revision, expected in (("HEAD~1", first), ("HEAD", second)):
        proxy.paths.clear()
        out = f"{revision.replace('~', '_')}.zarr.zip"
        run(elsewhere, "get", "-q", str(toys.root), name, "--rev", revision, "-o", out)
        assert (elsewhere / out).read_bytes() == expected
        fetched = {path for method, path in proxy.paths if method == "GET" and "/files/md5/" in path}
        assert len(fetched) <= 2, fetched  # the list of the folder, and the one product

    # An import knows where it comes from, and follows.
    subprocess.run(["git", "init", "-q"], cwd=elsewhere, check=True)
    run(elsewhere, "init", "-q")
    run(elsewhere, "import", "-q", str(toys.root), name, "--rev", "HEAD~1", "-o", "mug.zarr.zip")
    assert (elsewhere / "mug.zarr.zip").read_bytes() == first
    run(elsewhere, "update", "-q", "--rev", "HEAD", "mug.zarr.zip.dvc")
    assert (elsewhere / "mug.zarr.zip").read_bytes() == second

    # A clone gets all of the newest version, and has nothing to do.
    clone = tmp_path_factory.mktemp("clone") / "clone"
    repository.run("git", "clone", "-q", str(toys.root), str(clone))
    repository.root = toys.root = clone
    repository.run("dvc", "pull", "-q")
    assert made(toys) == versions[1]


def run(folder: Path, *command: str) -> None:
    environment = {**os.environ, "DVC_NO_ANALYTICS": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "dvc", *command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
