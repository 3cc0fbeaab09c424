"""The page: one self-contained HTML text from records, costs and failures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.errors import FormatError
from objectfolder.store import read_product
from pipeline.report import formats
from pipeline.report.charts import Chart, seconds_text, setting_medians, speed_error_chart
from pipeline.report.costs import Costs
from pipeline.report.measures import BYTE_PARTS, BYTES, HEADLINE, RANKING, SENSES, number_at
from pipeline.report.pictures import DIFFERENCE_FACTOR, PicturePair, picture_pairs
from pipeline.report.records import Failure, Record, worst_first
from pipeline.report.sounds import SoundPair, sound_pair, spectrogram_share
from pipeline.report.summary import (
    definitions_of,
    mean,
    split,
    stage_rows,
    summary_row,
    total_cpu_seconds,
)
from pipeline.report.tables import speed_error_rows

TEMPLATES = Path(__file__).parent / "template"
TARGET_CPU_SECONDS = 240.0
SENSE_NAMES = {"vision": "Sight", "audio": "Sound", "touch": "Touch"}
MODES_SHOWN = 20
# Objects on the page, pictures a sense and sounds: a page of eight objects stays near 6 MB.
EXAMPLES = ((8, 3, 2), (24, 2, 1))
ARRAYS = ("vision_truth", "vision_answer", "touch_truth", "touch_answer", "strike_truth", "strike_answer")


@dataclass(frozen=True)
class Effort:
    """What more or less effort of a sense costs and gives."""

    sense: str
    charts: list[Chart]
    medians: list[dict[str, Any]]


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
        summary=[summary_row(measure, ordered) for measure in (*HEADLINE, BYTES)],
        noise_floor_db=mean([number_at(record.attributes, "vision.noise_floor_db") for record in records]),
        silent=sum(record.silent for record in records),
        ranking=RANKING,
        targets={measure.key: measure.target for measure in (*HEADLINE, BYTES)},
        efforts=_efforts(records, costs),
        sense_names=SENSE_NAMES,
        stages=stage_rows(records, costs),
        cpu_seconds={record.object_id: total_cpu_seconds(record, costs) for record in records},
        target_cpu_seconds=TARGET_CPU_SECONDS,
        definitions=definitions_of(records),
        byte_parts=BYTE_PARTS[1:],
        split=split(records),
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


def _efforts(records: Sequence[Record], costs: Costs) -> list[Effort]:
    rows = speed_error_rows(records, costs)
    efforts = []
    for sense in SENSES:
        of_sense = [row for row in rows if row["sense"] == sense]
        drawn = [speed_error_chart(of_sense, column) for column in ("seconds_per_query", "bytes")]
        efforts.append(Effort(sense, [chart for chart in drawn if chart], setting_medians(of_sense)))
    return efforts
