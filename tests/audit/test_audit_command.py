"""The commands as users call them: exit status, thresholds, JSON, page, and what cannot be read."""

import json
import math
import shutil

import pytest
from versions_of_workshop import made_versions

from objectfolder.errors import InputError
from objectfolder.products.store import read_product, write_product
from pipeline import cli as command_line
from pipeline.audit.fidelity import MEASURES, changes, exceeded, thresholds, worst_first
from pipeline.cli import USAGE
from pipeline.cli.printing import FAILED, FINE
from pipeline.dataset import stages
from pipeline.dataset.lock_file import is_folder, read_folder, read_lock
from pipeline.dataset.stages import FIDELITY, VIEWS

pytestmark = pytest.mark.usefixtures("quiet")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A checkout with two versions, the second with other materials, and a work tree as the second."""
    with made_versions(
        tmp_path_factory.mktemp("command"), "workshop_of_command", cup="steel", dish="wood"
    ) as workshop:
        path = FIDELITY.path(workshop.root, "dish")
        product = read_product(path)
        worse = {**product.attributes["vision"], "psnr_db": product.attributes["vision"]["psnr_db"] - 1.5}
        hostile = {"name": "<script>alert(1)</script>\x1b[31m"}
        path.unlink()
        write_product(path, product.with_attributes(vision=worse, object=hostile))
        workshop.row("cup")["licence"] = "<img src=x onerror=alert(2)>\x1b[31m"
        workshop.save()
        workshop.version("second <b>bold</b>", make=False)
        yield workshop


@pytest.fixture
def run(made, monkeypatch, capsys):
    """Run a command in the checkout, on the stages over toy bodies."""
    monkeypatch.chdir(made.root)
    monkeypatch.setattr(stages, "STAGES", {stage.name: stage for stage in made.stages})

    def called(*arguments):
        status = command_line.main(list(arguments))
        said = capsys.readouterr()
        return status, said.out, said.err

    return called


def test_nothing_changed(run):
    status, out, _ = run("audit", "HEAD", "HEAD")
    assert status == FINE
    assert "2 objects: 2 unchanged" in out
    assert "to fetch: 0 bytes" in out


def test_defaults_are_head_and_the_work_tree(run):
    status, out, _ = run("audit")
    assert status == FINE
    assert "work tree" in out.splitlines()[1]
    assert "2 unchanged" in out
    assert "to fetch: 0 bytes" in out


def test_table_fits_and_commands_no_terminal(run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    _, out, _ = run("audit", "HEAD~1", "HEAD")
    assert max(map(len, out.splitlines())) <= 120
    assert "\x1b" not in out
    assert "dish" in out
    assert "worse by 1.50" in out


def test_threshold(run):
    assert run("audit", "HEAD~1", "HEAD", "--max-loss", "vision.psnr_db=2")[0] == FINE
    status, out, _ = run(
        "audit", "HEAD~1", "HEAD", "--max-loss", "vision.psnr_db=0.5", "--max-loss", "touch.ssim=0"
    )
    assert status == FAILED
    assert "too much: dish: vision.psnr_db worse by 1.50, more than the 0.5 allowed" in out
    assert run("audit", "HEAD", "HEAD~1", "--max-loss", "vision.psnr_db=0")[0] == FINE  # a gain


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("vision.psnr=0.5", "the nearest is 'vision.psnr_db'"),
        ("vision.psnr_db", "the allowed loss must be a finite number of at least 0"),
        ("vision.psnr_db=-1", "the allowed loss must be a finite number of at least 0"),
        ("vision.psnr_db=nan", "the allowed loss must be a finite number of at least 0"),
    ],
)
def test_threshold_that_is_none(run, text, said):
    status, _, error = run("audit", "HEAD", "HEAD", "--max-loss", text)
    assert status == USAGE
    assert said in error


@pytest.mark.parametrize("revision", ["nowhere", "--output=x", "HEAD~99", ""])
def test_unknown_revision(run, revision):
    # What looks like an option is argparse's to refuse, unless it is told otherwise.
    status, _, error = run("audit", "--", revision, "HEAD")
    assert status == FAILED
    assert "no such revision" in error


def test_revision_without_a_data_set(run, made):
    empty = made.git("commit-tree", made.git("hash-object", "-t", "tree", "/dev/null"), "-m", "empty")
    status, _, error = run("audit", empty, "HEAD")
    assert status == FAILED
    assert "it has no dvc.lock" in error
    assert "git log" in error


def test_damaged_lock(run, made):
    blob = made.root / "broken"
    blob.write_text("stages: [1, {")
    lock = made.git("hash-object", "-w", str(blob))
    blob.unlink()
    made.git("update-index", "--add", "--cacheinfo", f"100644,{lock},dvc.lock")
    commit = made.git("commit-tree", made.git("write-tree"), "-m", "broken")
    made.git("reset", "-q")
    status, _, error = run("audit", commit, "HEAD")
    assert status == FAILED
    assert "not a lock file of DVC" in error


@pytest.mark.parametrize("text", [b"stages: [1, {", b"\x00\xff\xfe", b"schema: '2.0'\nstages:\n  views: 3\n"])
def test_damaged_lock_of_the_work_tree_is_a_finding(run, made, text):
    lock = made.root / "dvc.lock"
    whole = lock.read_bytes()
    lock.write_bytes(text)
    try:
        status, _, error = run("audit")
        assert status == FAILED
        assert "dvc.lock: not a lock file of DVC" in error
        status, out, _ = run("verify")
        assert status == FAILED
        assert "damaged: dvc.lock: not a lock file of DVC" in out
        assert "Restore it from git" in out
        # Every product is still held against its own checksums, and nothing else is wrong.
        assert ": 1 finding\n" in out
    finally:
        lock.write_bytes(whole)


def test_detached_head_and_a_folder_inside_the_data_set(run, made, monkeypatch):
    made.git("checkout", "-q", "--detach")
    monkeypatch.chdir(made.root / "data")
    assert run("audit", "HEAD", "HEAD")[0] == FINE
    made.git("checkout", "-q", "main")


def test_not_a_data_set(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("audit")[0] == run("verify")[0] == run("history", "cup")[0] == FAILED


def test_json_has_everything(run):
    _, out, _ = run("audit", "HEAD~1", "HEAD", "--json", "--max-loss", "vision.psnr_db=0.5")
    report = json.loads(out)
    states = {entry["object_id"]: entry["state"] for entry in report["objects"]}
    assert states == {"cup": "unchanged", "dish": "changed"}
    (excess,) = report["exceeded"]
    assert (excess["object_id"], excess["measure"], round(excess["loss"], 9)) == (
        "dish",
        "vision.psnr_db",
        1.5,
    )
    assert report["fetch"]["files"] == 1
    assert report["fetch"]["unknown"] == 0


def test_page_escapes_what_strangers_wrote(run, tmp_path):
    path = tmp_path / "page.html"
    run("audit", "HEAD~1", "HEAD", "--html", str(path))
    page = path.read_text()
    assert "&lt;b&gt;bold&lt;/b&gt;" in page
    assert "<b>bold" not in page
    assert "<img" not in page
    assert "http" not in page.replace("http-equiv", "")


def test_content_that_is_nowhere_is_said_and_judged_by_no_threshold(run, made):
    path = made.in_cache(FIDELITY.path(made.root, "dish"))
    away = path.rename(path.with_suffix(".away"))
    try:
        status, out, error = run("audit", "HEAD~1", "HEAD")
        assert status == FAILED
        assert "not all could be compared" in error
        assert "not readable here" in out
        assert "incomplete" in out
        assert "dvc fetch" in out
        status, _, error = run("audit", "HEAD~1", "HEAD", "--max-loss", "vision.psnr_db=0.5")
        assert status == FAILED
        assert "limits were judged by what was read" in error
    finally:
        away.rename(path)


def test_list_of_a_folder_that_is_nowhere(run, made, tmp_path):
    shutil.move(made.root / ".dvc/cache", tmp_path / "cache")
    try:
        status, out, _ = run("audit", "HEAD~1", "HEAD")
        assert status == FAILED
        assert "2 objects: 2 not compared" in out
        assert "data/fidelity: not readable here" in " ".join(out.split())
        assert "what data/fidelity has, of which the list is unknown" in " ".join(out.split())
        fetch = json.loads(run("audit", "HEAD~1", "HEAD", "--json")[1])["fetch"]
        assert fetch["unlisted"] == ["data/fidelity"]
        assert fetch["files"] == 0
        # Folders of the same hash in both are the same, wherever they are.
        assert "data/views" not in out
        status, _, error = run("history", "cup")
        assert status == FAILED
        assert "none of the 2 versions can be read here" in error
        assert error.count("\n") == 1
    finally:
        shutil.move(tmp_path / "cache", made.root / ".dvc/cache")


def test_committed_figures_are_compared_where_no_product_can_be(run, made, tmp_path):
    reports = made.root / "reports"
    reports.mkdir()

    def reported(revision, gain_db):
        """A commit of what a revision has, and a report of it."""
        table = f"id,audio.gain_error_db,vision.psnr_db\ncup,{gain_db},50\ndish,-40,\n"
        (reports / "per_object.csv").write_text(table)
        means = {"audio": {"gain_error_db": {"mean": gain_db}}, "objects": 2}
        (reports / "metrics.json").write_text(json.dumps(means))
        made.git("read-tree", revision)
        made.git("add", "reports")
        return made.git("commit-tree", made.git("write-tree"), "-m", f"gain {gain_db}")

    first, before, after = reported("HEAD~1", -45.0), reported("HEAD", -45.0), reported("HEAD", -44.8)
    shutil.rmtree(reports)
    made.git("reset", "-q")
    # The products are the same in both.
    status, out, _ = run("audit", before, after)
    assert status == FINE
    assert "2 objects: 1 changed, 1 unchanged" in out
    shutil.move(made.root / ".dvc/cache", tmp_path / "cache")
    try:
        status, out, _ = run("audit", first, after, "--max-loss", "audio.gain_error_db=0.1")
        assert status == FAILED
        assert "2 objects: 1 changed, 1 not compared" in out
        assert "cup     audio.gain_error_db (dB)  -45.00  -44.80  worse by 0.20" in out
        assert "mean    audio.gain_error_db (dB)  -45.00  -44.80  worse by 0.20" in out
        assert "too much: cup" in out
    finally:
        shutil.move(tmp_path / "cache", made.root / ".dvc/cache")


def test_damaged_measures_are_judged_by_no_threshold(run, made):
    path = FIDELITY.path(made.root, "dish")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    try:
        status, out, error = run("audit", "HEAD", "--max-loss", "vision.psnr_db=100")
        assert status == FAILED
        assert "corrupted" in out
        assert "incomplete: data/fidelity/dish.zarr.zip" in out
        assert "limits were judged by what was read" in error
        assert run("audit", "HEAD")[0] == FAILED
    finally:
        path.write_bytes(whole)


def test_object_that_is_removed_lost_all_its_measures(run, made):
    records = made.root / "data" / "records.json"
    text, path = records.read_text(), FIDELITY.path(made.root, "dish")
    whole = path.read_bytes()
    without = json.loads(text)
    del without["objects"]["dish"]
    records.write_text(json.dumps(without))
    path.unlink()
    try:
        status, out, _ = run("audit", "HEAD", "--max-loss", "vision.psnr_db=100")
        assert "removed: dish" in out
        assert "too much: dish: vision.psnr_db lost" in out
        assert status == FAILED
    finally:
        records.write_text(text)
        path.write_bytes(whole)


def test_history_of_an_object(run):
    status, out, _ = run("history", "dish")
    assert status == FINE
    lines = out.splitlines()
    assert lines[0] == "dish: 2 versions"
    assert "appeared: first" in lines[2]
    assert "second <b>bold</b>" in out
    _, out, _ = run("history", "dish", "--json")
    first, second = json.loads(out)["versions"]
    assert first["stages"] == ["objects", "views", "modes", "touches", "collision", "encode", "fidelity"]
    assert second["stages"] == ["fidelity"]
    assert second["fidelity"]["vision.psnr_db"] == pytest.approx(first["fidelity"]["vision.psnr_db"] - 1.5)
    _, out, _ = run("history", "cup")
    assert out.startswith("cup: 1 version\n")


def test_history_of_an_object_that_never_was(run):
    status, _, error = run("history", "teapot")
    assert status == FAILED
    assert "no version behind HEAD has it" in error


def test_verify_says_what_is_wrong_by_its_status(run, made):
    assert run("verify")[0] == FINE
    assert run("verify", "HEAD~1")[0] == FINE
    path = VIEWS.path(made.root, "cup")
    whole = path.read_bytes()
    path.write_bytes(whole[:-3])
    status, out, _ = run("verify")
    assert status == FAILED
    assert "damaged: data/views/cup.zarr.zip" in out
    path.write_bytes(whole)


def test_measure_that_is_lost_is_an_infinite_loss():
    (change,) = changes("cup", {"vision": {"psnr_db": 40.0}}, {"vision": {}})
    assert math.isinf(change.loss)
    assert exceeded([change], {"vision.psnr_db": 100.0}) == [change]
    (gone,) = changes("cup", {"vision": {"psnr_db": 40.0}}, None)
    assert math.isinf(gone.loss)


def test_worst_first_compares_what_people_notice():
    before = {"vision": {"psnr_db": 40.0, "ssim": 0.99}, "audio": {"gain_error_db": -40.0}}
    after = {"vision": {"psnr_db": 39.5, "ssim": 0.97}, "audio": {"gain_error_db": -45.0}}
    measures = [change.measure for change in worst_first(changes("cup", before, after))]
    assert measures == ["vision.ssim", "vision.psnr_db", "audio.gain_error_db"]


def test_every_measure_has_a_weight():
    values = {key: 1.0 for key in MEASURES}
    assert thresholds([f"{key}={value}" for key, value in values.items()]) == values


@pytest.mark.parametrize("name", ["../../etc/passwd", "/etc/passwd", "a/../../b"])
def test_folder_that_leads_out_of_itself(name):
    with pytest.raises(Exception, match="leads out"):
        read_folder("data/views", json.dumps([{"md5": "0" * 32, "relpath": name}]).encode())


def test_lock_of_other_formats():
    assert read_lock("dvc.lock", b"schema: '2.0'\nstages: {}\n").outs == {}
    old = b"views:\n  cmd: x\n  outs:\n  - path: data/views\n    md5: 0123456789abcdef0123456789abcdef.dir\n"
    assert is_folder(read_lock("dvc.lock", old).outs["data/views"])
    cloud = b"schema: '2.0'\nstages:\n  a:\n    cmd: x\n    outs:\n    - path: s3://b/k\n      etag: abc\n"
    assert read_lock("dvc.lock", cloud).outs == {}
    with pytest.raises(Exception, match="not a lock file"):
        read_lock("dvc.lock", b"- 1\n")


def test_unicode_in_ids_and_in_names_of_files():
    text = json.dumps([{"md5": "0" * 32, "relpath": "Å-杯.zarr.zip"}], ensure_ascii=False).encode()
    assert list(read_folder("data/views", text)) == ["Å-杯.zarr.zip"]


def test_thresholds_of_nothing():
    assert thresholds([]) == {}
    with pytest.raises(InputError, match="nearest"):
        thresholds(["touch.psnr_contact=1"])
