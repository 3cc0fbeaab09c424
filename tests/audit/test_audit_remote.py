"""Versions read from a remote on an S3 server: only the parts of files that are needed, each once."""

import shutil
from pathlib import Path

import pytest
import s3_server
from versions_of_workshop import made_versions, only, states

from pipeline.audit.contents import Contents
from pipeline.audit.findings import State
from pipeline.audit.verification import MISSING, verify
from pipeline.dataset.stages import VIEWS

SLOW_FIXTURES = ("far",)


@pytest.fixture(scope="module")
def far(tmp_path_factory):
    """A checkout of two versions whose contents are at a remote only, and how many bytes those are."""
    with (
        pytest.MonkeyPatch.context() as patch,
        s3_server.serving() as address,
        made_versions(
            tmp_path_factory.mktemp("remote"), "workshop_of_remote", cup="steel", dish="wood"
        ) as workshop,
    ):
        for name, value in s3_server.environment(address).items():
            patch.setenv(name, value)
        workshop.edit("params.yaml", "accuracy_cents: 5.0", "accuracy_cents: 6.0")
        workshop.version("second")
        bucket = s3_server.new_bucket(address)
        cache = workshop.root / ".dvc" / "cache"
        for path in cache.rglob("*"):
            if path.is_file():
                key = f"store/{path.relative_to(cache).as_posix()}"
                # Long files, of which only an end is to be read.
                s3_server.client(address).put_object(Bucket=bucket, Key=key, Body=path.read_bytes())
        (workshop.root / ".dvc" / "config").write_text(
            "[core]\n    analytics = false\n    remote = store\n['remote \"store\"']\n"
            f"    url = s3://{bucket}/store\n    endpointurl = {address}\n"
        )
        shutil.rmtree(cache)
        shutil.rmtree(workshop.root / ".objectfolder")
        yield workshop


def test_versions_that_are_far_compare_as_those_at_hand(far):
    audit = far.audit("HEAD~1", "HEAD")
    assert states(audit) == {"cup": State.CHANGED, "dish": State.CHANGED}
    assert [str(reason) for reason in only(audit, "cup").roots] == [
        "parameter audio.accuracy_cents 5.0 -> 6.0"
    ]
    assert audit.problems == ()
    assert audit.fetch.files > 0
    assert audit.fetch.unknown == 0
    assert audit.fetch.bytes > 0
    # Nothing but descriptions came: the cache has no content.
    came = [path for path in (far.root / ".dvc/cache").rglob("*") if path.is_file()]
    assert [path for path in came if path.suffix != ".dir"] == []


@pytest.fixture
def cached(far):
    """Where descriptions are kept, with none in it."""
    with Contents(far.root) as contents:
        place = Path(contents.repository.site_cache_dir) / "objectfolder-audit"
    shutil.rmtree(place, ignore_errors=True)
    return place


@pytest.mark.usefixtures("cached")
def test_descriptions_are_fetched_once(far, monkeypatch):
    fetched = []
    fetch = Contents._describe_far
    monkeypatch.setattr(
        Contents, "_describe_far", lambda self, content: fetched.append(content.where) or fetch(self, content)
    )
    for _ in range(2):
        with Contents(far.root) as contents:
            version = far.at(contents, "HEAD")
            contents.describe_all([version.content(VIEWS, "cup"), version.content(VIEWS, "dish")])
            assert contents.describe(version.content(VIEWS, "cup")).fingerprint
    assert sorted(fetched) == ["data/views/cup.zarr.zip", "data/views/dish.zarr.zip"]


@pytest.mark.slow
def test_cache_that_is_damaged_costs_time_only(far, cached):
    far.audit("HEAD~1", "HEAD")
    (cached / "cache.db").write_bytes(b"no database" * 100)
    assert states(far.audit("HEAD~1", "HEAD")) == {"cup": State.CHANGED, "dish": State.CHANGED}


@pytest.mark.slow
def test_arrays_of_what_is_far_are_read(far):
    audit = far.audit("HEAD~1", "HEAD", arrays=True)
    assert audit.arrays_read
    stages = {change.stage: change.arrays for change in only(audit, "cup").stages}
    # The toys' values do not follow from this parameter.
    assert stages["modes"].verdicts == {"values": "equal", "attributes/warnings": "equal"}
    # Tensors carry no checksums: verdicts on them come from reading alone.
    assert stages["encode"].verdicts == {"weights": "equal", "attributes/format": "equal"}
    assert {comparison.unread for comparison in stages.values()} == {0}
    without = {change.stage: change.arrays for change in only(far.audit("HEAD~1", "HEAD"), "cup").stages}
    assert (without["encode"].verdicts, without["encode"].unread) == ({}, 1)


@pytest.mark.usefixtures("cached")
def test_same_version_needs_nothing_but_lists(far, monkeypatch):
    monkeypatch.delattr(Contents, "_describe_far")
    assert set(states(far.audit("HEAD", "HEAD")).values()) == {State.UNCHANGED}


def test_verification_reads_what_is_at_hand_and_names_the_rest(far):
    with Contents(far.root) as contents:
        report = verify(contents, far.at(contents, "HEAD"), far.stages)
    assert {finding.kind for finding in report.findings} == {MISSING}
    assert all("if a remote has it" in finding.remedy for finding in report.findings)
    assert len(report.findings) == 2 * 8


def test_remote_that_is_not_there(far):
    config = far.root / ".dvc" / "config"
    text = config.read_text()
    config.write_text(text.replace("/store\n", "/elsewhere\n"))
    shutil.rmtree(far.root / ".objectfolder", ignore_errors=True)
    try:
        audit = far.audit("HEAD~1", "HEAD")
        assert any("not readable here" in problem.finding for problem in audit.problems)
        assert all(problem.remedy for problem in audit.problems)
    finally:
        config.write_text(text)
