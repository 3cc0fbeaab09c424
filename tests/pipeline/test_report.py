"""The report, on products made by code: two objects, one of them silent, and one that failed."""

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fidelity_products import COST_COLUMNS, FAILURE, fidelity, write_costs
from scipy.signal import lfilter

from objectfolder.audio.synthesis import mode_bank
from objectfolder.errors import InputError
from objectfolder.fidelity.sound import SAMPLE_RATE_HZ
from objectfolder.products.store import Product, write_product
from pipeline.dataset.measures import IN_CONDITIONS, REPORTED, Measure, number_at
from pipeline.publish.report.charts import WIDTH, histogram, setting_medians, speed_error_chart
from pipeline.publish.report.measured_objects import MeasuredObject, MeasureSummary, summaries
from pipeline.publish.report.report import write_report
from pipeline.publish.report.summary import object_table
from pipeline.publish.report.templates import (
    MINUS,
    NOTHING,
    TIMES,
    digits,
    licence_link,
    megabytes,
    number,
    seconds,
    web_link,
)
from pipeline.publish.viewer.recursions import recursions

HOSTILE = "<script>alert('x')</script> & \"mug\""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    write_product(folder / "fidelity" / "mug.zarr.zip", fidelity("mug", name=HOSTILE, shift=4.0))
    write_product(folder / "fidelity" / "die.zarr.zip", fidelity("die", audible=False))
    costs = write_costs(folder / "costs.csv", ["mug"])
    write_report(folder / "fidelity", costs, folder / "reports", [FAILURE])
    return folder


def read_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_metrics_take_the_worst_in_the_direction_of_each_measure(report: Path) -> None:
    metrics = json.loads((report / "reports" / "metrics.json").read_text())
    assert metrics["vision"]["psnr_db"] == {"mean": 41.0, "worst": 39.0}
    assert metrics["vision"]["psnr_foreground_db"] == {"mean": 33.0, "worst": 31.0}
    assert metrics["vision"]["ssim"] == {"mean": 0.991, "worst": 0.989}
    assert metrics["touch"]["psnr_db"] == {"mean": 50.0, "worst": 48.0}
    assert metrics["touch"]["psnr_contact_db"] == {"mean": 45.0, "worst": 43.0}
    assert metrics["bytes"] == {"mean": 1_502_000, "worst": 1_504_000}
    assert metrics["audio"]["gain_error_db"] == {"mean": -26.0, "worst": -26.0}
    assert metrics["audio"]["frequency_error_cents"] == {"mean": 4.001, "worst": 4.001}
    assert metrics["audio"]["silent_objects"] == 1
    assert (metrics["objects"], metrics["failed"]) == (2, 1)


def test_every_reported_measure_knows_its_direction() -> None:
    worse_when_lower = {measure.key for measure in REPORTED if measure.higher_is_better}
    assert worse_when_lower == {
        "vision.psnr_db",
        "vision.psnr_foreground_db",
        "vision.ssim",
        *(measure.key for measure in IN_CONDITIONS),
        "touch.psnr_db",
        "touch.psnr_contact_db",
        "touch.pyrender_psnr_contact_db",
    }
    for measure in REPORTED:
        assert measure.worst([1.0, 2.0]) == (1.0 if measure.higher_is_better else 2.0)
        if measure.target is not None:
            better = measure.target + (1 if measure.higher_is_better else -1)
            assert measure.margin(better) == pytest.approx(1.0)


def test_the_agreement_of_renderers_is_a_row_and_a_column_where_an_object_has_it() -> None:
    key = "touch.pyrender_psnr_contact_db"
    for score in ({}, {"pyrender_psnr_contact_db": 50.0}):
        objects = [MeasuredObject("mug", {"touch": {"psnr_db": 40.0, **score}})]
        rows = {row.measure.key: row.mean for row in summaries(objects)}
        assert rows.get(key) == score.get("pyrender_psnr_contact_db")
        assert (key in rows) == (key in object_table(objects).partition("\n")[0].split(",")) == bool(score)


def test_numbers_that_are_none_are_not_numbers() -> None:
    attributes = {"audio": {"audible": True, "nan": float("nan"), "text": "1", "null": None, "one": 1}}
    assert number_at(attributes, "audio.one") == 1.0
    for key in ("audio.audible", "audio.nan", "audio.text", "audio.null", "audio.absent", "absent.absent"):
        assert number_at(attributes, key) is None


def test_object_table_round_trips(report: Path) -> None:
    die, mug = read_csv(report / "reports" / "per_object.csv")
    assert (die["id"], mug["id"], mug["name"]) == ("die", "mug", HOSTILE)
    assert float(mug["vision.psnr_db"]) == 39.0
    assert float(mug["audio.gain_error_db"]) == -26.0
    assert (die["audio.audible"], die["audio.gain_error_db"], mug["audio.audible"]) == ("0", "", "1")
    assert int(mug["bytes.total"]) == 1_504_000
    assert [mug[f"bytes.{part}"] for part in ("surface", "vision", "audio")] == ["60000", "900000", "500000"]
    assert float(mug["cpu_seconds.views"]) == 40.0, "the seconds of the product in use, not of an older one"
    assert die["cpu_seconds.views"] == ""


def test_speed_error_table_joins_the_seconds(report: Path) -> None:
    rows = read_csv(report / "reports" / "speed_error.csv")
    assert list(rows[0]) == [
        "object",
        "sense",
        "setting",
        "value",
        "seconds_per_query",
        "bytes",
        "error",
        "error_unit",
    ]
    assert [row["object"] for row in rows] == ["die"] * 7 + ["mug"] * 10
    seconds = {(row["object"], row["setting"], row["value"]): row["seconds_per_query"] for row in rows}
    assert seconds["mug", "sub_rays", "16"] == "0.15"
    assert seconds["die", "sub_rays", "16"] == ""
    assert seconds["mug", "modes", "30"] == ""


def test_equal_inputs_give_equal_bytes_and_no_rests(report: Path, tmp_path: Path) -> None:
    write_report(report / "fidelity", report / "costs.csv", tmp_path / "again", [FAILURE])
    again = {path.relative_to(tmp_path / "again"): path for path in (tmp_path / "again").rglob("*.*")}
    first = {path.relative_to(report / "reports"): path for path in (report / "reports").rglob("*.*")}
    assert again.keys() == first.keys()
    names = {"index.html", "metrics.json", "per_object.csv", "speed_error.csv"}
    assert {str(name) for name in again if name.parent == Path()} == names
    for name, path in again.items():
        assert path.read_bytes() == first[name].read_bytes(), name


def test_without_costs_nothing_is_measured_here(report: Path, tmp_path: Path) -> None:
    write_report(report / "fidelity", tmp_path / "absent.csv", tmp_path / "reports")
    text = (tmp_path / "reports" / "index.html").read_text()
    assert text.count("not measured here") >= 6 + 1 + 3
    rows = read_csv(tmp_path / "reports" / "per_object.csv")
    assert {row["cpu_seconds.encode"] for row in rows} == {""}
    assert "No object failed." in text


def test_no_objects_still_make_a_report(tmp_path: Path) -> None:
    write_report(tmp_path / "absent", tmp_path / "costs.csv", tmp_path / "reports", [])
    text = (tmp_path / "reports" / "metrics.json").read_text()
    metrics = json.loads(text)
    assert "NaN" not in text
    assert metrics["objects"] == 0
    assert metrics["vision"]["psnr_db"] == {"mean": None, "worst": None}
    assert read_csv(tmp_path / "reports" / "per_object.csv") == []
    assert "There is no object." in (tmp_path / "reports" / "index.html").read_text()


def test_a_damaged_product_is_a_failure_and_the_others_are_reported(tmp_path: Path) -> None:
    folder = tmp_path / "fidelity"
    write_product(folder / "die.zarr.zip", fidelity("die", audible=False))
    whole = (folder / "die.zarr.zip").read_bytes()
    (folder / "cut.zarr.zip").write_bytes(whole[: len(whole) // 2])
    write_report(folder, tmp_path / "costs.csv", tmp_path / "reports", [])
    metrics = json.loads((tmp_path / "reports" / "metrics.json").read_text())
    assert (metrics["objects"], metrics["failed"]) == (1, 1)
    assert "cut.zarr.zip: not a readable product" in (tmp_path / "reports" / "index.html").read_text()


def test_a_product_with_missing_parts_is_still_an_object(tmp_path: Path) -> None:
    write_product(tmp_path / "fidelity" / "bare.zarr.zip", Product({}, {"object": {"id": "bare"}}))
    write_report(tmp_path / "fidelity", tmp_path / "costs.csv", tmp_path / "reports", [])
    assert read_csv(tmp_path / "reports" / "per_object.csv")[0]["vision.psnr_db"] == ""
    assert "bare" in (tmp_path / "reports" / "index.html").read_text()


@pytest.mark.parametrize(
    ("content", "finding"),
    [(b"id,seconds\nmug,1\n", "no column object and stage"), (b"\xff\xfe", "not a table")],
)
def test_a_cost_table_that_is_none_is_refused(tmp_path: Path, content: bytes, finding: str) -> None:
    (tmp_path / "costs.csv").write_bytes(content)
    with pytest.raises(InputError, match=finding):
        write_report(tmp_path, tmp_path / "costs.csv", tmp_path / "reports", [])
    assert not (tmp_path / "reports").exists()


def test_a_cost_line_cut_short_counts_as_not_measured(tmp_path: Path) -> None:
    write_product(tmp_path / "fidelity" / "mug.zarr.zip", Product({}, {"object": {"id": "mug"}}))
    rows = "mug,views,a,1.5,2,300,,\nmug,modes,b,7mug,modes,b,7.5,8,300,,\nmug,encode"
    (tmp_path / "costs.csv").write_text(",".join(COST_COLUMNS) + "\n" + rows)
    write_report(tmp_path / "fidelity", tmp_path / "costs.csv", tmp_path / "reports")
    (row,) = read_csv(tmp_path / "reports" / "per_object.csv")
    stages = ("views", "modes", "encode")
    assert [row[f"cpu_seconds.{stage}"] for stage in stages] == ["1.5", "", ""]


def test_settings_are_matched_step_by_step() -> None:
    def row(object_id: str, value: float, error: float | None) -> dict[str, object]:
        common = {"object": object_id, "setting": "mode_count", "error_unit": "dB", "seconds_per_query": None}
        return common | {"value": value, "error": error, "bytes": 100 * value}

    rows = [row("bell", 10, -5.0), row("bell", 40, -25.0), row("mug", 20, -15.0), row("mug", 80, None)]
    first, second = setting_medians(rows)
    assert (first["label"], first["error"], first["bytes"]) == ("mode count 10 to 20", -10.0, 1500)
    assert (second["label"], second["error"]) == ("mode count 40 to 80", -25.0)


def test_recursions_of_modes_are_what_the_mode_bank_gives() -> None:
    eigenvalues = np.array(
        [(2 * np.pi * 90) ** 2, (2 * np.pi * 19000) ** 2, 100.0, 0.999 * 400.0, (3e5) ** 2]
    )
    dampings = np.array([1.0, 80.0, 30.0, 20.0, 1.0])  # two over-damped, nearly critical; one above the rate
    sounds = mode_bank(eigenvalues, dampings, np.eye(5), duration_s=1.0, sample_rate_hz=SAMPLE_RATE_HZ)
    for (a, b, first, second), sound in zip(recursions(eigenvalues, dampings), sounds, strict=True):
        impulse = [first, second - a * first]
        response = lfilter(impulse, [1, -a, -b], np.eye(1, len(sound))[0])
        np.testing.assert_allclose(response, sound, atol=1e-7)


def speed_error_rows() -> list[dict[str, Any]]:
    own = {"object": "mug", "setting": "n", "error_unit": "dB", "seconds_per_query": 1.0}
    return [own | {"value": n, "error": 30.0 + n, "bytes": 100.0 * n} for n in (1, 2, 3)]


def test_a_chart_needs_two_settings_that_differ() -> None:
    rows = speed_error_rows()
    assert speed_error_chart("Sight", [], "bytes") is None
    assert speed_error_chart("Sight", rows[:1], "bytes") is None
    assert speed_error_chart("Sight", rows, "seconds_per_query") is None
    chart = speed_error_chart("Sight", rows, "bytes")
    assert chart is not None
    assert re.findall(r">(n \d)</text>", chart) == ["n 1", "n 2", "n 3"]
    assert 'aria-label="Sight: dB against size in the Object File"' in chart
    noise = [row | {"seconds_per_query": 1 + 0.02 * row["value"]} for row in rows]
    assert speed_error_chart("Sight", noise, "seconds_per_query") is None, "within the noise of the clock"


def test_a_chart_speaks_in_words_that_do_not_collide() -> None:
    places = [(4, 0.0248), (16, 0.0276), (64, 0.0300)]
    own = {"setting": "sub_rays", "error_unit": "PSNR dB", "bytes": 1.0, "error": 44.0}
    rows = [  # three objects far apart: the medians are close together
        own | {"object": str(factor), "value": n, "seconds_per_query": factor * place}
        for factor in (0.2, 1, 5)
        for n, place in places
    ]
    chart = speed_error_chart("Sight", rows, "seconds_per_query") or ""
    pattern = r'x="([\d.]+)" y="([\d.]+)"[^>]*text-anchor: (\w+)[^>]*>(\d+ rays a pixel)<'
    labels = re.findall(pattern, chart)
    assert [words for *_, words in labels] == ["4 rays a pixel", "16 rays a pixel", "64 rays a pixel"]
    boxes = []
    for x, y, anchor, words in labels:
        width = 0.53 * 7 * len(words)
        left = float(x) - {"start": 0.0, "middle": 0.5, "end": 1.0}[anchor] * width
        boxes.append((left, left + width, float(y) - 7, float(y)))
    for index, (left, right, top, bottom) in enumerate(boxes):
        assert 0 <= left < right <= WIDTH
        for box in boxes[:index]:
            assert right < box[0] or box[1] < left or bottom < box[2] or box[3] < top, words
    assert "likeness of views" in chart
    assert "sub" not in re.sub(r"<[^>]*>", "", chart)


def test_the_worst_object_is_named_by_one_look_at_all(monkeypatch):
    looks = []
    worst = Measure.worst
    monkeypatch.setattr(Measure, "worst", lambda *values: looks.append(1) or worst(*values))
    summary = MeasureSummary(REPORTED[0], [(30.0, "bell"), (31.0, "die"), (20.0, "mug"), (20.0, "plate")])
    assert summary.worst_object == "mug"
    assert len(looks) == 1  # else the cost of a page grows with the square of the objects


def test_charts_follow_the_colours_of_the_page_and_hold_text_of_any_kind() -> None:
    summary = MeasureSummary(Measure("a.b", HOSTILE, "$", target=3.0), [(1.0, "x"), (2.0, "y"), (4.0, "z")])
    chart, within = histogram(summary)
    assert within
    assert not re.search("#[0-9a-f]{6}", chart)
    assert {"var(--ink)", "var(--accent)"} <= set(re.findall(r"var\(--\w+\)", chart))
    assert "<script>" not in chart
    assert histogram(MeasureSummary(summary.measure, summary.values[:2]))[1] is False
    formula = [row | {"setting": "$\\frac{<b>$"} for row in speed_error_rows()]
    assert "$\\frac{&lt;b&gt;$ 1" in (speed_error_chart("Sight", formula, "bytes") or "")
    many = [
        {**row, "object": str(index), "error": row["error"] + index}
        for index in range(50)
        for row in speed_error_rows()
    ]
    band = speed_error_chart("Sight", many, "bytes")
    assert band is not None
    assert band.count("<path") < 50, "a band, not a curve for each object"


def test_numbers_and_links_are_printed_for_people() -> None:
    assert (number(-0.04, 1), number(-26.04, 1), number(None), number(20000, 0)) == (
        "0.0",
        f"{MINUS}26.0",
        NOTHING,
        "20\u202f000",
    )
    assert (digits(0.00123), digits(1.5e-7), digits(0.0)) == ("0.00123", f"1.50 {TIMES} 10⁻⁷", "0")
    assert (megabytes(60_000), megabytes(1_504_000), megabytes(None)) == ("60 kB", "1.50 MB", NOTHING)
    assert (seconds(0.15), seconds(2e-5)) == ("150 ms", "20 µs")
    assert licence_link("cc-by-4.0") == "https://spdx.org/licenses/CC-BY-4.0.html"
    assert licence_link("all rights reserved") is None
    assert web_link("javascript:alert(1)") is None
    assert web_link("https://example.org/a") == "https://example.org/a"
