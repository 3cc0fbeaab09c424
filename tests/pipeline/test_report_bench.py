"""What the timing of reports asks for."""

from pathlib import Path
from typing import Any

import pytest
from fidelity_products import write_costs
from report_data_sets import write_object

from bench.factory import dashboard


def test_unchanged_pages_are_timed_with_as_many_queries_as_they_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_object(tmp_path / "data", "mug")
    (tmp_path / ".objectfolder").mkdir()
    write_costs(tmp_path / ".objectfolder" / "costs.csv", ["mug"])
    pair_counts: list[int] = []
    pages: list[set[int]] = []

    def write_report(fidelity: Path, costs: Path, reports: Path, *, pairs: int) -> None:
        pair_counts.append(pairs)
        real(fidelity, costs, reports, pairs=pairs)
        pages.append({path.stat().st_mtime_ns for path in (reports / "objects").glob("*.html")})

    real = dashboard.write_report
    monkeypatch.setattr(dashboard, "write_report", write_report)
    for name in ("players_alone", "behaviour", "conclude"):
        monkeypatch.setattr(dashboard, name, lambda *_: {})
    arguments: list[Any] = [tmp_path, "--objects", 3, "--pairs", 4, 2, "--scratch", tmp_path]
    monkeypatch.setattr("sys.argv", ["dashboard", *map(str, arguments)])
    dashboard.main()
    assert pair_counts == [4, 2, 2, 2]
    assert pages[1] == pages[2], "all are kept"
    assert len(pages[2] - pages[3]) == 1
