"""Dask's report of a run: kept, readable offline, few, and never the reason that a run fails."""

import re
import time

import pytest

from pipeline.cluster.performance_report import MOST_REPORTS, excess, performance_report
from pipeline.dataset.run_id import RUN_ID


@pytest.fixture(scope="module")
def client():
    from distributed import Client, LocalCluster

    with (
        LocalCluster(
            n_workers=1,
            threads_per_worker=1,
            processes=False,
            host="127.0.0.1",
            protocol="tcp://",
            dashboard_address=None,
            memory_limit=0,
        ) as cluster,
        Client(cluster, set_as_default=False) as made,
    ):
        yield made


@pytest.mark.slow
def test_a_report_holds_its_scripts_and_the_tasks_of_the_run(client, tmp_path, monkeypatch):
    pytest.importorskip("bokeh")
    monkeypatch.setenv(RUN_ID, "20260102T000000Z-aa")
    with performance_report(client, tmp_path, least_s=0.0):
        for index in range(3):
            client.submit(time.sleep, 0.01, key=f"views-mug_{index}", pure=False).result()
    (path,) = (tmp_path / "runs").iterdir()
    assert path.name == "20260102T000000Z-aa-dask.html"
    page = path.read_text()
    assert "number of tasks: 3" in page
    assert "views-mug_2" in page
    # Nothing is fetched: no script, style, font or picture by address.
    tags = re.findall(r"<(?:script|link|img|iframe)\b[^>]*>", page)
    assert tags
    assert not [tag for tag in tags if re.search(r"(?:src|href)\s*=\s*[\"']?(?:https?:)?//", tag)]


def test_short_runs_get_none(client, tmp_path):
    with performance_report(client, tmp_path, least_s=3600.0):
        pass
    assert not (tmp_path / "runs").exists()


def test_a_scheduler_that_is_gone_is_a_warning(tmp_path):
    class Gone:
        def get_task_stream(self, **window: float) -> None:
            raise OSError("the scheduler went away")

    with (
        pytest.warns(UserWarning, match="the scheduler went away"),
        performance_report(Gone(), tmp_path),
    ):
        pass


def test_the_run_s_own_failure_passes_through(client, tmp_path):
    with pytest.raises(KeyError), performance_report(client, tmp_path):
        raise KeyError("its own")


def test_only_the_newest_are_kept(tmp_path):
    (tmp_path / "runs").mkdir()
    for index in range(MOST_REPORTS + 2):
        (tmp_path / "runs" / f"202601{index:02}T000000Z-aa-dask.html").write_text("x")
    assert [path.name[6:8] for path in excess(tmp_path)] == ["00", "01"]
