"""The page: one self-contained HTML text from records, costs and failures."""

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.store import read_product
from pipeline.report import formats
from pipeline.report.charts import seconds_text, speed_error_chart
from pipeline.report.costs import Costs
from pipeline.report.measures import BYTE_PARTS, BYTES, HEADLINE, RANKING, SENSES, Measure, number_at
from pipeline.report.pictures import DIFFERENCE_FACTOR, PicturePair, picture_pairs
from pipeline.report.records import Failure, Record, worst_first
from pipeline.report.sounds import SoundPair, sound_pair, spectrogram_share
from pipeline.report.tables import speed_error_rows

TEMPLATES = Path(__file__).parent / "template"
TARGET_CPU_SECONDS = 240.0
MODES_SHOWN = 20
# Objects on the page, pictures a sense and sounds: a page of eight objects stays near 6 MB.
EXAMPLES = ((8, 3, 2), (24, 2, 1))
ARRAYS = ("vision_truth", "vision_answer", "touch_truth", "touch_answer", "strike_truth", "strike_answer")


@dataclass(frozen=True)
class SummaryRow:
    """A measure over the data set."""

    measure: Measure
    mean: float | None
    worst: float | None
    worst_object: str
    trivial: float | None

    @property
    def met(self) -> bool | None:
        """Whether the mean reaches the target; None where there is no target or no mean."""
        if self.mean is None or self.measure.target is None:
            return None
        return self.measure.margin(self.mean) >= 0


@dataclass(frozen=True)
class StageRow:
    """CPU seconds of a stage over the objects it was measured for."""

    stage: str
    objects: int
    median: float | None
    largest: float | None
    share: float | None
    peak_memory_mb: float | None


@dataclass(frozen=True)
class Illustrated:
    """An object with examples to look at and to listen to."""

    record: Record
    views: list[PicturePair]
    touches: list[PicturePair]
    sounds: list[SoundPair]


def render_page(
    records: Sequence[Record], failures: Sequence[Failure], costs: Costs
) -> tuple[str, list[Failure]]:
    """Return the page, and failures of products whose arrays could not be read."""
    import jinja2

    ordered = worst_first(records)
    illustrated, unreadable = _illustrate(ordered)
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": formats.number,
        "digits": formats.digits,
        "megabytes": formats.megabytes,
        "percent": formats.percent,
        "licence_link": formats.licence_link,
        "web_link": formats.web_link,
        "seconds": seconds_text,
    }
    environment.globals["spectrogram_share"] = spectrogram_share
    page = environment.get_template("index.html.j2").render(
        records=ordered,
        anchors={item.record.object_id: f"object-{index}" for index, item in enumerate(illustrated, 1)},
        illustrated=illustrated,
        failures=[*failures, *unreadable],
        failed=len({failure.object_id for failure in [*failures, *unreadable]}),
        summary=[_summary_row(measure, ordered) for measure in (*HEADLINE, BYTES)],
        noise_floor_db=_mean([number_at(record.attributes, "vision.noise_floor_db") for record in records]),
        silent=sum(record.silent for record in records),
        ranking=RANKING,
        targets={measure.key: measure.target for measure in (*HEADLINE, BYTES)},
        charts=_charts(records, costs),
        stages=_stage_rows(records, costs),
        cpu_seconds={record.object_id: _total_cpu_seconds(record, costs) for record in records},
        target_cpu_seconds=TARGET_CPU_SECONDS,
        definitions=_definitions(records),
        byte_parts=BYTE_PARTS[1:],
        split=_split(records),
        difference_factor=DIFFERENCE_FACTOR,
        modes_shown=MODES_SHOWN,
        value=number_at,
    )
    return page, unreadable


def _illustrate(ordered: Sequence[Record]) -> tuple[list[Illustrated], list[Failure]]:
    most, pictures, sounds = next((plan for plan in EXAMPLES if len(ordered) <= plan[0]), EXAMPLES[-1])
    illustrated, failures = [], []
    for record in ordered[:most]:
        try:
            product = read_product(record.path)
            arrays = {name: product[name] if name in product else np.zeros((0, 1, 1, 3)) for name in ARRAYS}
            illustrated.append(
                Illustrated(
                    record,
                    picture_pairs(arrays["vision_truth"], arrays["vision_answer"], pictures),
                    picture_pairs(arrays["touch_truth"], arrays["touch_answer"], pictures),
                    [
                        sound_pair(truth, answer)
                        for truth, answer in zip(
                            arrays["strike_truth"][:sounds], arrays["strike_answer"][:sounds], strict=True
                        )
                    ],
                )
            )
        except FormatError as error:
            finding = f"{record.path.name}: {error.finding}"
            failures.append(Failure(record.object_id, "report", finding, error.remedy))
    return illustrated, failures


def _summary_row(measure: Measure, records: Sequence[Record]) -> SummaryRow:
    known = [
        (value, record.object_id)
        for record in records
        if (value := measure.of(record.attributes)) is not None
        and not (measure.sense == "audio" and record.silent)
    ]
    if not known:
        return SummaryRow(measure, None, None, "", None)
    worst = measure.worst([value for value, _ in known])
    return SummaryRow(
        measure,
        statistics.fmean(value for value, _ in known),
        worst,
        next(object_id for value, object_id in known if value == worst),
        _mean([measure.trivial_of(record.attributes) for record in records]),
    )


def _stage_rows(records: Sequence[Record], costs: Costs) -> list[StageRow]:
    rows, medians = [], {}
    for stage in costs.stage_names({record.object_id for record in records}):
        found = [costs.stage(record.object_id, stage, record.fingerprints) for record in records]
        cpu = [cost.cpu_seconds for cost in found if cost and cost.cpu_seconds is not None]
        memory = [cost.peak_memory_mb for cost in found if cost and cost.peak_memory_mb is not None]
        medians[stage] = statistics.median(cpu) if cpu else None
        rows.append(
            StageRow(stage, len(cpu), medians[stage], max(cpu, default=None), None, max(memory, default=None))
        )
    whole = sum(median for median in medians.values() if median is not None)
    return [
        StageRow(
            row.stage,
            row.objects,
            row.median,
            row.largest,
            row.median / whole if row.median is not None and whole > 0 else None,
            row.peak_memory_mb,
        )
        for row in rows
    ]


def _total_cpu_seconds(record: Record, costs: Costs) -> float | None:
    """Return the CPU seconds of every stage of an object, None unless all were measured."""
    stages = costs.stage_names({record.object_id})
    found = [costs.stage(record.object_id, stage, record.fingerprints) for stage in stages]
    seconds = [cost.cpu_seconds if cost else None for cost in found]
    known = [value for value in seconds if value is not None]
    return sum(known) if len(known) == len(seconds) else None


def _charts(records: Sequence[Record], costs: Costs) -> list[dict[str, Any]]:
    rows = speed_error_rows(records, costs)
    charts = []
    for sense in SENSES:
        of_sense = [row for row in rows if row["sense"] == sense]
        charts.append(
            {
                "sense": sense,
                "settings": list(dict.fromkeys(row["setting"] for row in of_sense)),
                "timed": any(row["seconds_per_query"] is not None for row in of_sense),
                "seconds": speed_error_chart(of_sense, "seconds_per_query"),
                "bytes": speed_error_chart(of_sense, "bytes"),
            }
        )
    return charts


def _definitions(records: Sequence[Record]) -> dict[str, str]:
    """Return measure to definition: the products' own words, ours for a headline without."""
    own: dict[str, str] = {}
    for record in records:
        own |= {str(name): str(text) for name, text in record.sense("definitions").items()}
    for measure in HEADLINE:
        if measure.key not in own and measure.name not in own:
            own[measure.key] = measure.definition
    return dict(sorted(own.items()))


def _split(records: Sequence[Record]) -> list[tuple[str, str, list[float], list[float]]]:
    """Return sense, unit, and the distinct counts of training and of held-out queries."""

    def counts(key: str) -> list[float]:
        return sorted(
            {value for record in records if (value := number_at(record.attributes, key)) is not None}
        )

    return [
        (
            "vision",
            "views, each with its own light",
            counts("vision.training_views"),
            counts("vision.held_out_views"),
        ),
        ("audio", "surface points", counts("audio.training_points"), counts("audio.held_out_points")),
        ("touch", "touches", counts("touch.training_touches"), counts("touch.held_out_touches")),
    ]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return statistics.fmean(known) if known else None
