"""The report, on products made by code: two objects, one of them silent, and one that failed."""

import csv
import json
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from objectfolder.errors import InputError
from objectfolder.store import Array, Product, write_product
from pipeline.report import write_report
from pipeline.report.charts import bytes_text, seconds_text, speed_error_chart
from pipeline.report.formats import MINUS, NOTHING, TIMES, digits, licence_link, megabytes, number, web_link
from pipeline.report.measures import HEADLINE, number_at
from pipeline.report.pictures import difference_picture
from pipeline.report.sounds import sound_pair

HOSTILE = "<script>alert('x')</script> & \"mug\""
COST_COLUMNS = [
    "object",
    "stage",
    "fingerprint",
    "cpu_seconds",
    "wall_seconds",
    "peak_memory_mb",
    "key",
    "seconds_per_query",
]


def views(count: int, height: int, width: int, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Shaded balls on white, and the same with noise."""
    generator = np.random.default_rng(seed)
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    truth = np.full((count, height, width, 3), 255, np.uint8)
    for image, light in zip(truth, generator.normal(size=(count, 3)), strict=True):
        z = np.sqrt(np.maximum(0.5 - x * x - y * y, 0))
        shade = 40 + 180 * np.clip(np.stack([x, -y, z], -1) @ (light / np.linalg.norm(light)), 0, 1)
        image[z > 0] = (shade[..., None] * [1.0, 0.8, 0.6])[z > 0]
    answer = np.clip(truth + noise * generator.normal(size=truth.shape) * (truth != 255), 0, 255)
    return truth, answer.astype(np.uint8)


def fidelity(
    object_id: str,
    *,
    name: str | None = None,
    audible: bool = True,
    shift: float = 0.0,
    size: int = 32,
    kept: int = 4,
) -> Product:
    """A fidelity product; `shift` makes every measure worse by as many dB."""
    view_truth, view_answer = views(kept, size, size, 2 + shift, 1)
    touch_truth, touch_answer = views(kept, size * 5 // 4, size * 15 // 16, 1 + shift, 2)
    time = np.arange(66150 if audible else 0) / 44100
    partials = [(561.6 * 1.7**index, 2.0 + 6.0 * index**1.5) for index in range(7)]
    truth = np.stack([sum(np.exp(-c * time) * np.sin(2 * np.pi * f * time) * 1e-6 for f, c in partials)] * 2)
    strikes = truth if audible else np.zeros((0, 0))
    attributes = {
        "object": {
            "id": object_id,
            "name": name or object_id,
            "material": "ceramic",
            "licence": "CC BY 4.0",
            "attribution": "A. Maker",
            "source": "https://example.org/scan",
            "length_m": 0.16,
        },
        "vision": {
            "psnr_db": 43.0 - shift,
            "psnr_foreground_db": 35.0 - shift,
            "ssim": 0.993 - shift / 1000,
            "noise_floor_db": 57.0,
            "trivial_psnr_db": 21.0,
            "trivial_psnr_foreground_db": 13.0,
            "trivial_ssim": 0.8,
            "held_out_views": 8,
            "training_views": 60,
            "resolution": size,
            "sub_rays": 16,
            "per_view": [],
        },
        "audio": {
            "audible": audible,
            "modes": 73 if audible else 0,
            "first_frequency_hz": 561.6 if audible else None,
            "frequency_limit_hz": 20000,
            "frequency_error_cents": 0.001 + shift if audible else None,
            "damping_error_relative": 1e-7 if audible else None,
            "gain_error_db": -30.0 + shift if audible else None,
            "gain_error_by_mode_median_db": -31.0 + shift if audible else None,
            "stft_distance": 1e-6 if audible else None,
            "envelope_distance": 1e-3 if audible else None,
            "solver_error_estimate_cents": 12.0 if audible else None,
            "count_certificate": {},
            "held_out_points": 64,
            "modes_table": [
                {"frequency_hz": f, "damping_per_s": c, "t60_s": 3 * math.log(10) / c}
                for f, c in partials * 4
            ]
            if audible
            else [],
        },
        "touch": {
            "psnr_db": 52.0 - shift,
            "psnr_contact_db": 47.0 - shift,
            "ssim": 0.999,
            "empty_psnr_db": 29.6,
            "empty_psnr_contact_db": 20.0,
            "empty_ssim": 0.94,
            "held_out_touches": 24,
            "unreachable_share": 0.13,
            "surface_bytes": 60_000,
        },
        "bytes": {
            "total": 1_500_000 + round(1000 * shift),
            "surface": 60_000,
            "vision": 900_000,
            "audio": 500_000,
            "touch": 0,
            "metadata": 40_000,
        },
        "speed_error": [
            {
                "sense": sense,
                "setting": f"{unit} {value}",
                "value": value,
                "error": error + shift,
                "error_unit": "PSNR, dB" if sense != "audio" else "gain error, dB",
                "bytes": size_bytes,
                "key": f"{sense}-{value}",
            }
            for sense, unit, value, error, size_bytes in (
                ("vision", "sub-rays", 1, 29.0, 900_000),
                ("vision", "sub-rays", 4, 36.5, 900_000),
                ("vision", "sub-rays", 16, 40.9, 900_000),
                ("vision", "sub-rays", 64, 43.5, 900_000),
                ("audio", "modes", 10, -12.0, 70_000),
                ("audio", "modes", 30, -21.0, 210_000),
                ("audio", "modes", 73, -30.0, 500_000),
                ("touch", "samples", 1, 44.0, 60_000),
                ("touch", "samples", 4, 49.0, 60_000),
                ("touch", "samples", 16, 52.0, 60_000),
            )
            if audible or sense != "audio"
        ],
        "definitions": {"vision.psnr_db": "Own words of the product."},
        "provenance": {"fingerprints": {"views": "new"}},
    }
    images = ("query", "y", "x", "channel")
    return Product(
        {
            "vision_truth": Array(view_truth, images, "1", "simulated view"),
            "vision_answer": Array(view_answer, images, "1", "view of the Object File"),
            "touch_truth": Array(touch_truth, images, "1", "simulated touch"),
            "touch_answer": Array(touch_answer, images, "1", "touch of the Object File"),
            "strike_truth": Array(strikes.astype(np.float32), ("strike", "sample"), "1", "sound"),
            "strike_answer": Array((0.98 * strikes).astype(np.float32), ("strike", "sample"), "1", "sound"),
        },
        attributes,
    )


FAILURE = {"object": "broken", "stage": "objects", "error": "model.obj: no faces <b>", "remedy": "Repair it."}


def write_costs(path: Path, objects: list[str]) -> Path:
    rows: list[dict[str, object]] = []
    for object_id in objects:
        for stage, seconds in zip(
            ["objects", "views", "modes", "touches", "encode", "fidelity"], (2, 40, 60, 5, 50, 9), strict=True
        ):
            cost = {"object": object_id, "stage": stage, "cpu_seconds": seconds, "wall_seconds": seconds}
            rows.append(cost | {"fingerprint": "new", "peak_memory_mb": 400})
        rows.append({"object": object_id, "stage": "views", "fingerprint": "old", "cpu_seconds": 999})
        for key, seconds in (("vision-1", 0.01), ("vision-4", 0.04), ("vision-16", 0.15), ("vision-64", 0.6)):
            rows.append({"object": object_id, "stage": "query", "key": key, "seconds_per_query": seconds})
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COST_COLUMNS, restval="")
        writer.writeheader()
        writer.writerows(rows)
    return path


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


class Page(HTMLParser):
    """References and text of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.references: list[tuple[str, str]] = []
        self.text = ""
        self.tags: list[str] = []
        self.source = path.read_text(encoding="utf-8")
        self.feed(self.source)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        names = {"src", "href", "srcset", "xlink:href", "data", "poster", "action", "background"}
        self.references += [(tag, value or "") for name, value in attributes if name in names]

    def handle_data(self, data: str) -> None:
        self.text += data


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


def test_every_headline_measure_knows_its_direction() -> None:
    worse_when_lower = {measure.key for measure in HEADLINE if measure.higher_is_better}
    assert worse_when_lower == {
        "vision.psnr_db",
        "vision.psnr_foreground_db",
        "vision.ssim",
        "touch.psnr_db",
        "touch.psnr_contact_db",
    }
    for measure in HEADLINE:
        assert measure.worst([1.0, 2.0]) == (1.0 if measure.higher_is_better else 2.0)
        if measure.target is not None:
            better = measure.target + (1 if measure.higher_is_better else -1)
            assert measure.margin(better) == pytest.approx(1.0)


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
    seconds = {(row["object"], row["setting"]): row["seconds_per_query"] for row in rows}
    assert seconds["mug", "sub-rays 16"] == "0.15"
    assert seconds["die", "sub-rays 16"] == ""
    assert seconds["mug", "modes 30"] == ""


def test_page_makes_no_request(report: Path) -> None:
    page = Page(report / "reports" / "index.html")
    assert page.references
    for tag, reference in page.references:
        if tag == "a":
            assert reference.startswith(("#", "https://creativecommons.org/", "https://example.org/"))
        else:
            assert reference.startswith("data:"), (tag, reference[:60])
    assert not {"script", "iframe", "object", "embed", "form"} & set(page.tags)
    assert "@import" not in page.source
    assert "url(" not in page.source
    # Addresses stand in links and in their text, nowhere else.
    rest = re.sub(r'<a href="[^"]*"[^>]*>[^<]*</a>', "", page.source)
    assert not re.search(r"https?://", rest)


def test_page_shows_examples_failures_and_silence(report: Path) -> None:
    page = Page(report / "reports" / "index.html")
    assert page.tags.count("audio") == 4
    assert page.source.count("data:image/webp;base64,") == 2 * 2 * 3 * 3 + 2 * 2
    for text in (
        "model.obj: no faces <b>",
        "Repair it.",
        "A. Maker",
        "CC BY 4.0",
        "Own words of the product.",
    ):
        assert text in page.text
    assert "Silent: the solver finds no mode below" in page.text
    assert "First 20 of 73 modes" in page.text
    assert "not measured here" in page.text
    assert page.text.index("1 silent object") > 0
    worst, best = (page.source.index(f'id="object-{place}"') for place in (1, 2))
    assert "die" in page.source[best : best + 200]
    assert worst < best


def test_hostile_names_are_text(report: Path) -> None:
    page = Page(report / "reports" / "index.html")
    assert "script" not in page.tags
    assert "b" not in page.tags
    assert HOSTILE in page.text


def test_equal_inputs_give_equal_bytes_and_no_rests(report: Path, tmp_path: Path) -> None:
    write_report(report / "fidelity", report / "costs.csv", tmp_path / "again", [FAILURE])
    names = sorted(path.name for path in (tmp_path / "again").iterdir())
    assert names == ["index.html", "metrics.json", "per_object.csv", "speed_error.csv"]
    for name in names:
        assert (tmp_path / "again" / name).read_bytes() == (report / "reports" / name).read_bytes()


def test_without_costs_nothing_is_measured_here(report: Path, tmp_path: Path) -> None:
    write_report(report / "fidelity", tmp_path / "absent.csv", tmp_path / "reports")
    page = Page(tmp_path / "reports" / "index.html")
    assert page.text.count("not measured here") >= 6 + 2 + 3
    rows = read_csv(tmp_path / "reports" / "per_object.csv")
    assert {row["cpu_seconds.encode"] for row in rows} == {""}
    assert "No object failed." in page.text


@pytest.mark.parametrize("folder", ["empty", "absent"])
def test_no_objects_still_make_a_report(tmp_path: Path, folder: str) -> None:
    (tmp_path / "empty").mkdir()
    write_report(tmp_path / folder, tmp_path / "costs.csv", tmp_path / "reports", [])
    text = (tmp_path / "reports" / "metrics.json").read_text()
    metrics = json.loads(text)
    assert "NaN" not in text
    assert metrics["objects"] == 0
    assert metrics["vision"]["psnr_db"] == {"mean": None, "worst": None}
    assert read_csv(tmp_path / "reports" / "per_object.csv") == []
    assert "There is no object." in Page(tmp_path / "reports" / "index.html").text


def test_a_damaged_product_is_a_failure_and_the_others_are_reported(tmp_path: Path) -> None:
    folder = tmp_path / "fidelity"
    write_product(folder / "die.zarr.zip", fidelity("die", audible=False))
    whole = (folder / "die.zarr.zip").read_bytes()
    (folder / "cut.zarr.zip").write_bytes(whole[: len(whole) // 2])
    write_report(folder, tmp_path / "costs.csv", tmp_path / "reports", [])
    metrics = json.loads((tmp_path / "reports" / "metrics.json").read_text())
    assert (metrics["objects"], metrics["failed"]) == (1, 1)
    assert "cut.zarr.zip: not a readable product" in Page(tmp_path / "reports" / "index.html").text


def test_a_product_with_missing_parts_is_still_an_object(tmp_path: Path) -> None:
    write_product(tmp_path / "fidelity" / "bare.zarr.zip", Product({}, {"object": {"id": "bare"}}))
    write_report(tmp_path / "fidelity", tmp_path / "costs.csv", tmp_path / "reports", [])
    assert read_csv(tmp_path / "reports" / "per_object.csv")[0]["vision.psnr_db"] == ""
    assert "bare" in Page(tmp_path / "reports" / "index.html").text


@pytest.mark.parametrize(
    ("text", "finding"),
    [
        ("object,stage,cpu_seconds\nmug,views,fast\n", "line 2.*'fast', not a number"),
        ("id,seconds\nmug,1\n", "no column"),
    ],
)
def test_a_cost_table_that_is_none_is_refused(tmp_path: Path, text: str, finding: str) -> None:
    (tmp_path / "costs.csv").write_text(text)
    with pytest.raises(InputError, match=finding):
        write_report(tmp_path, tmp_path / "costs.csv", tmp_path / "reports", [])
    assert not (tmp_path / "reports").exists()


def test_difference_is_amplified_around_grey() -> None:
    truth = np.array([[[10, 100, 200]]], np.uint8)
    answer = np.array([[[12, 99, 255]]], np.uint8)
    assert difference_picture(truth, answer).tolist() == [[[144, 120, 255]]]
    assert np.all(difference_picture(truth, truth) == 128)


def test_a_pair_of_sounds_keeps_its_ratio_and_drops_what_is_not_heard() -> None:
    time = np.arange(44100) / 44100
    truth = 1e-6 * np.exp(-100 * time) * np.sin(2 * np.pi * 1000 * time)
    pair = sound_pair(truth, 0.5 * truth)
    assert pair.factor == pytest.approx(0.9 / np.abs(truth).max())
    assert pair.difference_db == pytest.approx(20 * np.log10(0.5))
    assert pair.seconds < 0.12
    assert len(pair.truth) == len(pair.answer)
    assert sound_pair(np.zeros(100), np.zeros(100)).factor == 1.0


def test_a_chart_needs_two_settings_that_differ() -> None:
    rows = [
        {
            "object": "mug",
            "setting": f"{n}",
            "error": 30.0 + n,
            "error_unit": "dB",
            "bytes": 100.0 * n,
            "seconds_per_query": 1.0,
        }
        for n in (1, 2, 3)
    ]
    assert speed_error_chart([], "bytes") is None
    assert speed_error_chart(rows[:1], "bytes") is None
    assert speed_error_chart(rows, "seconds_per_query") is None
    chart = speed_error_chart(rows, "bytes")
    assert chart is not None
    assert [marker.label for marker in chart.markers] == ["1", "2", "3"]
    assert all(chart.left <= marker.x <= chart.right for marker in chart.markers)
    assert all(chart.top <= tick.position <= chart.bottom for tick in chart.y_ticks)


def test_numbers_and_links_are_printed_for_people() -> None:
    assert (number(-0.04, 1), number(-26.04, 1), number(None), number(20000, 0)) == (
        "0.0",
        f"{MINUS}26.0",
        NOTHING,
        "20\u202f000",
    )
    assert (digits(0.00123), digits(1.5e-7), digits(0.0)) == ("0.00123", f"1.50 {TIMES} 10⁻⁷", "0")
    assert (megabytes(60_000), megabytes(1_504_000), megabytes(None)) == ("60.0 kB", "1.50 MB", NOTHING)
    assert (seconds_text(0.15), seconds_text(2e-5), bytes_text(2000)) == ("150 ms", "20 µs", "2 kB")
    assert licence_link("cc-by-4.0") == "https://creativecommons.org/licenses/by/4.0/"
    assert licence_link("all rights reserved") is None
    assert web_link("javascript:alert(1)") is None
    assert web_link("https://example.org/a") == "https://example.org/a"
