"""Give the page of learning results its tables, from the files that `dvc repro learning/dvc.yaml` writes."""

import json
import re
import subprocess
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "learning" / "results"
MARK = re.compile(r"<!-- learning ((?:\w+/)?)(\w+) -->")
SENSE_NAMES = {"V": "sight", "A": "sound", "T": "touch"}
METHODS = {"end_to_end": "networks trained for retrieval alone",
           "ours": "triplet and cross-entropy", "contrastive": "contrastive",
           "CCA": "ridge CCA on the same features", "CCA of averaged inputs": "ridge CCA on averaged inputs",
           "PLS": "PLS", "classify, then look up": "classify, then look up",
           "classify by neighbours too, then look up": "classify by neighbours too, look up"}  # fmt: skip
CASES = {"seen": "seen objects", "at_vertices": "seen objects, touched at vertices",
         "unseen": "unseen objects", "end_to_end": "unseen objects of the first folds"}  # fmt: skip
PRETRAINED = {"pretrained": "a network of ImageNet", "with_own": "that and our own",
              "with_own_and_neighbours": "both with nearest neighbours",
              "with_own_and_touch": "both and a touch (VT)"}  # fmt: skip
TRUTH, FILE = "truth to truth", "object_file to truth"
TOUCH_PLACES = {"vertex": "any vertex", "vertex region": "vertices of regions where none is trained on"}
LIKENESSES = {"iou": "IoU", "chamfer": "Chamfer-L1", "normal_consistency": "normal consistency"}
GRASP_SENSES = {"V": "image", "T": "both gels", "VT": "both senses, one network",
                "majority": "the commoner outcome", "majority of the object": "that of the object",
                "trees on force and pose": "boosted trees that know force and pose"}  # fmt: skip
SAMPLES = (
    "{data[training][vision]} images, {data[training][audio]} strikes and {data[training][touch]} touches"
)
AMOUNTS = {"grasping": "{grasping[grasps]} grasps of each",
           "regrasping": "{regrasping[rollouts]} rollouts",
           "stand_in": f"at most {SAMPLES} of those that each stores for training",
           "reconstruction": f"{{reconstruction[steps]:,}} steps, {SAMPLES} of each for training",
           "touch": "up to {touch_at_vertices[training]:,} touches of each for training"}  # fmt: skip
HELD = ("objects held, %", "regrasps")
Figures = dict[str, Any]


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Put a table where the page has a mark, as ``<!-- learning hundred/recognition -->``."""
    return MARK.sub(lambda mark: table(mark[2], RESULTS / mark[1]), markdown)


def table(task: str, results: Path = RESULTS) -> str:
    """Return the figures of a task in Markdown, and what they were made with."""
    path = results / f"{task}.json"
    figures, made_with = (
        json.loads(file.read_text(encoding="utf-8")) for file in (path, results / "settings" / path.name)
    )
    return f"{TABLES[task](figures)}\n\n{_setting(task, made_with, path)}"


def _setting(task: str, made_with: Figures, path: Path) -> str:
    settings, count = made_with["settings"], len(made_with["objects"])
    task_settings = settings.get(task, {})
    seeds = task_settings.get("seeds", settings["seeds"])
    amount = AMOUNTS.get(task, f"{SAMPLES} of each for training").format(**settings)
    return f"{count} objects, {amount}, seeds {', '.join(map(str, seeds))}. {_recorded(path)}"


def _recorded(path: Path) -> str:
    """Return when a file was recorded, as git knows it."""
    name = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name
    command = ["git", "log", "-1", "--format=%cs, `%h`", "--", name]
    try:
        when = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        when = ""
    return f"`{name}`, recorded {when}." if when else f"`{name}`."


def _rows(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [list(heading), ["---"] * len(heading), *map(list, rows)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _interval(value: float, interval: Sequence[float] | None, form: str) -> str:
    """Return a value with its interval of 95 %; without it where none was taken."""
    if not interval:
        return format(value, form)
    low, high = (format(end, form) for end in interval)
    return f"{value:{form}} ({low} to {high})"


def recognition(figures: Figures) -> str:
    """Return top-1 accuracies by split and senses."""
    senses = ["V", "A", "T", "VA", "VT", "AT", "VAT"]
    protocols = [protocol for protocol in ("sample", "region", "vertex") if protocol in figures]

    def cells(cell: Callable[[Figures], str], rows: Figures) -> list[str]:
        return [cell(rows[name]) if name in rows else "" for name in senses]

    heading = [f"recognition, top-1 %, chance {figures['chance_percent']:.0f}", *senses]
    rows = [
        *([f"split by {name}", *cells(_accuracy, figures[name])] for name in protocols),
        *(
            [f"by {name}, with nearest neighbours", *cells(_accuracy, figures[name]["with_neighbours"])]
            for name in protocols
            if "with_neighbours" in figures[name]
        ),
        *(
            [f"the worst object, by {name}", *cells(_worst, figures[name])]
            for name in protocols
            if "worst" in figures[name].get("V", figures[name].get("T", {}))
        ),
        *(
            [f"five together, by {name}", *cells(lambda row: f"{row['5']:.1f}", figures[name]["several"])]
            for name in protocols
        ),
        *(
            [
                f"standard deviation over seeds, by {name}",
                *cells(lambda row: format(row["sd_percent"], ".1f"), figures[name]),
            ]
            for name in protocols
            if figures[name]["T"]["sd_percent"] is not None
        ),
        *(
            [
                f"nearest training place, by {name}",
                *cells(lambda share: f"{share:.3f}", figures[name]["nearest_training_place"]),
            ]
            for name in protocols
        ),
    ]
    lines = [_rows(heading, rows)]
    if "pretrained" in figures:
        lines.append(_pretrained(figures))
    lines += [f"Images with one lamp anywhere: {_accuracy(figures['one lamp']['V'])}."]
    if "vertex" in figures:
        lines.append(_vertices(figures["vertex"]))
    return "\n\n".join(lines)


def _pretrained(figures: Figures) -> str:
    """Return accuracies of images with and without a network that ImageNet trained, by split."""
    by_protocol = figures["pretrained"]
    rows = [
        ["our own", *(_accuracy(figures[protocol]["V"]) for protocol in by_protocol)],
        *(
            [label, *(_accuracy(row[way]) for row in by_protocol.values())]
            for way, label in PRETRAINED.items()
        ),
    ]
    return _rows(["images, top-1 %", *(f"split by {protocol}" for protocol in by_protocol)], rows)


def _accuracy(row: Figures) -> str:
    return _interval(row["accuracy_percent"], row["interval_percent"], ".1f")


def _worst(row: Figures) -> str:
    return f"{row['worst']['accuracy_percent']:.0f}"


def _vertices(row: Figures) -> str:
    least, most = row["training_touches"]
    text = f"By vertex each object has {least:,} to {most:,} training touches."
    if "finer" in row:
        finer = row["finer"]
        gained = _interval(finer["points_gained"], finer["interval_points"], "+.1f")
        text += f" Images of {finer['pixels']} pixels gain {gained} points there, of the first seed's tests."
    return text


def touch(figures: Figures) -> str:
    """Return accuracies of one touch and of several at vertices, of networks and with their neighbours."""
    rows = []
    for protocol, place in TOUCH_PLACES.items():
        ways = {
            "the network": figures[protocol],
            "with its nearest neighbours": figures[protocol]["with_neighbours"],
        }
        for way, row in ways.items():
            spread = row["T"]["sd_percent"]
            rows.append([
                f"{place}, {way}",
                _accuracy(row["T"]),
                *(_accuracy(row["several"][count]) for count in ("3", "5")),
                _worst(row),
                "" if spread is None else f"{spread:.1f}",
            ])  # fmt: skip
    heading = [
        f"percent, chance {figures['chance_percent']:.1f}, test touches at", "one touch", "three", "five",
        "one touch of the worst object", "standard deviation over seeds",
    ]  # fmt: skip
    touches = ", ".join(
        f"{least:,} to {most:,} at {TOUCH_PLACES[protocol]}"
        for protocol in TOUCH_PLACES
        for least, most in [figures[protocol]["training_touches"]]
    )
    return f"{_rows(heading, rows)}\n\nTraining touches of an object: {touches}."


def retrieval(figures: Figures) -> str:
    """Return mAP of seen and of unseen objects by direction and method."""
    parts = []
    for case, label_of_case in CASES.items():
        directions = figures.get(case)
        if not directions:
            continue
        chance = next(iter(directions.values()))["ours"]["chance_one_positive"]
        heading = [f"{label_of_case}, mAP with one positive, chance {chance:.2f}", *directions]
        rows = []
        recorded = next(iter(directions.values()))
        for method, label in METHODS.items():
            if method not in recorded:
                continue
            figures_of_method = [row[method] for row in directions.values()]
            single = [
                _interval(row["map_one_positive"], row.get("map_one_positive_interval"), ".2f")
                for row in figures_of_method
            ]
            rows.append([label, *single])
        ahead = [row["CCA"] for row in directions.values()]
        if "ours_ahead" in ahead[0]:
            cells = [_interval(row["ours_ahead"], row["ours_ahead_interval"], "+.3f") for row in ahead]
            rows.append(["first row less CCA", *cells])
        parts.append(_rows(heading, rows))
    return "\n\n".join(parts)


def reconstruction(figures: Figures) -> str:
    """Return likenesses of seen and of unseen objects, and what they are compared with."""
    floor = figures["floor"]
    parts = []
    for case in ("seen", "unseen"):
        variants = figures[case]
        if not variants:
            continue
        cases = {name: row if case == "seen" else row[0] for name, row in variants.items()}
        looked_up = f"looking up the named mesh: {', '.join(cases)}"
        heading = [f"{case} objects", *cases, looked_up, "nearest known"]
        rows = []
        for measure, label in LIKENESSES.items():
            form = ".4f" if measure == "chamfer" else ".3f"
            interval = "iou_interval" if measure == "iou" else ""
            rows.append([
                f"{label} (floor: {floor[measure]:{form}})",
                *(_interval(row["ours"][measure], row.get(interval), form) for row in cases.values()),
                ", ".join(format(row["look_up"][measure], form) for row in cases.values()),
                format(next(iter(cases.values()))["nearest_known"][measure], form),
            ])  # fmt: skip
        sizes = [f"{100 * row['size_error_share']:.1f} %" for row in cases.values()]
        parts.append(_rows(heading, [*rows, ["error of the size", *sizes, "", ""]]))
    return "\n\n".join(parts)


def stand_in(figures: Figures) -> str:
    """Return recognition with training and test on either source, and what a detector tells apart."""
    ways = list(next(iter(figures["recognition"].values())))
    labels = [way.replace("object_file", "file").replace(" to ", " -> ") for way in ways]
    heading = [
        "trained on -> tested on, %", *labels, "points of truth lost by training on files",
        "told apart by a detector, %",
    ]  # fmt: skip
    lost = figures.get("lost_on_truth", {})
    rows = []
    for sense, row in figures["recognition"].items():
        detector = figures["detector"][sense]
        loss = lost.get(sense, {"points": row[TRUTH] - row[FILE], "interval_points": None})
        rows.append([
            SENSE_NAMES[sense],
            *(f"{row[way]:.1f}" for way in ways),
            _interval(loss["points"], loss["interval_points"], ".1f"),
            _interval(detector["right_percent"], detector["interval_percent"], ".0f"),
        ])  # fmt: skip
        for share, fewer in figures.get("fewer_queries", {}).get(sense, {}).items():
            accuracies = {
                TRUTH: fewer["accuracy_percent"]["truth"],
                FILE: fewer["accuracy_percent"]["object_file"],
            }
            rows.append([
                f"{SENSE_NAMES[sense]}, {share} of the training queries",
                *(f"{accuracies[way]:.1f}" if way in accuracies else "" for way in ways),
                _interval(fewer["points"], fewer["interval_points"], ".1f"),
                "",
            ])  # fmt: skip
    return _rows(heading, rows)


def grasping(figures: Figures) -> str:
    """Return accuracies by how many grasps were trained on, and on objects left out."""
    sizes = sorted(figures["accuracy_percent"], key=int)
    counts = [f"{int(size):,} grasps" for size in sizes]
    heading = ["will it hold, accuracy in % after", *counts, "on an object left out"]
    left_out = figures["unseen_object"].values()
    rows = [
        [label, *(f"{figures['accuracy_percent'][size][name]:.0f}" for size in sizes),
         f"{sum(row[name] for row in left_out) / len(left_out):.0f}"]
        for name, label in GRASP_SENSES.items()
    ]  # fmt: skip
    left_out_grasps = f"{figures['left_out_unseen']} were left out as the gels could not show them"
    return f"{_rows(heading, rows)}\n\n{figures['grasps']:,} grasps; {left_out_grasps}."


def regrasping(figures: Figures) -> str:
    """Return how many objects are held by who moves, and of objects that were left out of the training."""
    lines = [
        _rows(["who moves", *HELD], [_held_row(who, row) for who, row in sorted(figures["held"].items())])
    ]
    if "unseen" in figures:
        lines.append(_unseen_held(figures))
    return "\n\n".join(lines)


def _unseen_held(figures: Figures) -> str:
    unseen = figures["unseen"]
    lost, ahead = unseen["lost"], unseen["touch_ahead"]
    rates = {who: figures["held"][who] for who in ahead if who not in unseen["held"]} | unseen["held"]
    heading = [
        f"the same episodes, objects left out of the training, {len(unseen['folds'])} folds",
        *HELD,
        "points lost by that",
        "touch is ahead by",
    ]
    rows = [
        [*_held_row(who, row), _points(lost.get(who)), _points(ahead.get(who))]
        for who, row in sorted(rates.items())
    ]
    return _rows(heading, rows)


def _held_row(who: str, row: Figures) -> list[str]:
    return [who, _interval(row["percent"], row["interval_percent"], ".1f"), f"{row['regrasps']:.1f}"]


def _points(row: Figures | None) -> str:
    return _interval(row["points"], row["interval_points"], "+.1f") if row else ""


TABLES: dict[str, Callable[[Figures], str]] = {
    "recognition": recognition,
    "touch": touch,
    "retrieval": retrieval,
    "reconstruction": reconstruction,
    "stand_in": stand_in,
    "grasping": grasping,
    "regrasping": regrasping,
}
