"""What a report of a thousand objects takes, and how its first page behaves in a browser.

The data set is the objects of a finished one repeated under other ids (hard links; the fidelity products
carry the new id), so every page is made, each with a player. ``python -m bench dashboard DATA_SET``
from the root.
"""

import csv
import json
import os
import shutil
import statistics
import tempfile
import time
import zipfile
from pathlib import Path
from typing import Any

from bench.record import arguments, conclude, cpu_seconds
from pipeline.publish.report.report import write_report

OBJECTS = 1000
# Held-out queries a sense without loss; the last is what a report shows by default.
PAIRS = (2, 4)
SUFFIXES = (".zarr.zip", ".safetensors")
REPETITIONS = 7
# Chromium reports the duration of an event up to the next paint, in steps of 8 ms.
OBSERVE = """() => {
    window.entries = [];
    new PerformanceObserver(list => entries.push(...list.getEntries().map(
        entry => ({name: entry.name, duration: entry.duration, id: entry.interactionId}))))
        .observe({type: 'event', durationThreshold: 16, buffered: false});
}"""


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("data_set", type=Path, help="root of a data set with fidelity products")
    parser.add_argument("--objects", type=int, default=OBJECTS)
    parser.add_argument("--pairs", type=int, nargs="+", default=PAIRS)
    parser.add_argument("--scratch", type=Path, help="folder for the repeated data set and its report")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.scratch) as folder:
        root = Path(folder)
        kinds = repeat(options.data_set, root, options.objects)
        players = players_alone(root)
        figures: dict[str, Any] = {"players": players}
        figures["whole"] = {str(pairs): make_report(root, pairs) for pairs in options.pairs}
        figures["again"] = make_report(root, options.pairs[-1], keep=True)
        figures["one_changed"] = one_changed(root, options.pairs[-1])
        figures["sizes"] = sizes(root / "reports")
        figures["browser"] = behaviour(root / "reports" / "index.html")
    conclude(
        "dashboard",
        figures,
        {
            "objects": options.objects,
            "distinct_objects": len(kinds),
            "pairs_by_sense": options.pairs,
            "seconds": "CPU seconds of the process and its children, one thread of BLAS",
            "browser": "headless Chromium without a graphics card, opened from disk, machine with other work",
        },
        "Making a report of repeated objects with all pages against the same with unchanged pages kept, by "
        "held-out queries a sense without loss; first paint, sort, search and filter by the browser's own "
        "entries",
    )


def repeat(source: Path, root: Path, count: int) -> list[str]:
    """Write `count` objects that repeat those of `source`; return the ids of the originals."""
    originals = sorted(path.name.removesuffix(SUFFIXES[0]) for path in (source / "data/fidelity").iterdir())
    (root / "data/fidelity").mkdir(parents=True)
    for index in range(count):
        name, object_id = originals[index % len(originals)], f"{originals[index % len(originals)]}_{index:04}"
        for stage in sorted((source / "data").iterdir()):
            for suffix in SUFFIXES:
                file = stage / f"{name}{suffix}"
                if file.is_file() and stage.name != "fidelity":
                    (root / "data" / stage.name).mkdir(parents=True, exist_ok=True)
                    os.link(file, root / "data" / stage.name / f"{object_id}{suffix}")
        renamed(source / "data/fidelity" / f"{name}.zarr.zip", root / "data/fidelity", object_id, index)
    repeat_costs(source / ".objectfolder/costs.csv", root / "costs.csv", originals, count)
    return originals


def renamed(source: Path, folder: Path, object_id: str, index: int) -> None:
    """Write a fidelity product of another id, a little better or worse: its entries, but the attributes."""
    target = folder / f"{object_id}.zarr.zip"
    with zipfile.ZipFile(source) as original, zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as copy:
        for entry in original.infolist():
            content = original.read(entry)
            if entry.filename == "zarr.json":
                group = json.loads(content)
                group["attributes"]["object"]["id"] = object_id
                group["attributes"]["vision"]["psnr_foreground_db"] += (index * 0.618 % 1) * 6 - 3
                content = json.dumps(group).encode()
            copy.writestr(entry.filename, content)


def repeat_costs(source: Path, target: Path, originals: list[str], count: int) -> None:
    with source.open(newline="") as file:
        rows = list(csv.DictReader(file))
    own: dict[str, list[dict[str, str]]] = {name: [] for name in originals}
    for row in rows:
        own.setdefault(row["object"], []).append(row)
    with target.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        for index in range(count):
            name = originals[index % len(originals)]
            writer.writerows({**row, "object": f"{name}_{index:04}"} for row in own[name])


def players_alone(root: Path) -> dict[str, Any]:
    """CPU seconds of the data of one player that no cache knows, by original."""
    from pipeline.publish.viewer.static import write_player

    files = sorted((root / "data/object_files").iterdir())
    first = {path.name.rpartition("_")[0]: path for path in reversed(files)}
    seconds = {}
    for name, path in first.items():
        write_player(path, root / "players", path.stem)  # what is loaded and compiled once is not counted
        begin = cpu_seconds()
        write_player(path, root / "players", path.stem)
        seconds[name] = cpu_seconds() - begin
    return {"baked_cpu_s": seconds}


def make_report(root: Path, pairs: int, *, keep: bool = False) -> dict[str, Any]:
    """Make the report, all pages anew unless `keep`."""
    if not keep:
        for path in (root / "reports/objects").glob("*"):
            path.unlink()
    begin, wall = cpu_seconds(), time.perf_counter()
    write_report(root / "data/fidelity", root / "costs.csv", root / "reports", pairs=pairs)
    return {"cpu_s": cpu_seconds() - begin, "wall_s": time.perf_counter() - wall}


def one_changed(root: Path, pairs: int) -> dict[str, Any]:
    path = sorted((root / "data/fidelity").iterdir())[0]
    renamed(path, root / "data", path.name.partition(".")[0], 7)
    (root / "data" / path.name).replace(path)
    return make_report(root, pairs, keep=True)


def sizes(reports: Path) -> dict[str, Any]:
    pages = [path.stat().st_size for path in (reports / "objects").glob("*.html")]
    players = [path.stat().st_size for path in (reports / "objects").glob("*.player.js")]
    return {
        "index_bytes": (reports / "index.html").stat().st_size,
        "pages": len(pages),
        "page_bytes_mean": sum(pages) / len(pages),
        "player_bytes_mean": sum(players) / max(len(players), 1),
    }


def behaviour(index: Path) -> dict[str, Any]:
    """Return milliseconds: medians and worst of several visits, and what was asked for beyond the disk."""
    from playwright.sync_api import sync_playwright

    executable = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        visits = [_visit(browser, index) for _ in range(REPETITIONS)]
        browser.close()
    figures: dict[str, Any] = {"beyond_the_disk": sum(visit.pop("beyond_the_disk") for visit in visits)}
    for name in visits[0]:
        values = [visit[name] for visit in visits]
        figures[name] = {"median": statistics.median(values), "worst": max(values)}
    return figures


def _visit(browser: Any, index: Path) -> dict[str, float]:
    context = browser.new_context(viewport={"width": 1280, "height": 900})
    page = context.new_page()
    requests: list[str] = []
    page.on("request", lambda request: requests.append(request.url))
    page.goto(index.resolve().as_uri())
    paints = page.evaluate("""() => new Promise(done => {
        const paint = () => performance.getEntriesByName('first-contentful-paint')[0];
        const wait = () => paint() ? done(paint().startTime) : setTimeout(wait, 20);
        wait();
    })""")
    navigation = page.evaluate("performance.getEntriesByType('navigation')[0].toJSON()")
    page.evaluate(OBSERVE)
    actions = {
        "as_table": lambda: page.click("#view"),
        "sort": lambda: page.click("#table th:nth-child(6) button"),
        "sort_by_name": lambda: page.click("#table th:nth-child(1) button"),
        "search": lambda: page.locator("#search").press("g"),
        "search_cleared": lambda: page.locator("#search").press("Backspace"),
        "next_rows": lambda: page.click("#after"),
    }
    figures = {"first_contentful_paint_ms": paints, "loaded_ms": navigation["loadEventEnd"]}
    for name, act in actions.items():
        page.evaluate("entries.length = 0")
        act()
        _painted(page)
        durations = page.evaluate("entries.map(entry => entry.duration)")
        figures[f"{name}_ms"] = max(durations, default=16.0)
    # A menu opened by the system is not the page's: its choice is timed from the change to the paint.
    figures["filter_ms"] = page.evaluate("""() => new Promise(done => {
        const select = document.getElementById('material');
        const begin = performance.now();
        select.value = 'steel';
        select.dispatchEvent(new Event('change', {bubbles: true}));
        requestAnimationFrame(() => setTimeout(() => done(performance.now() - begin)));
    })""")
    figures["beyond_the_disk"] = sum(not address.startswith(("file:", "data:")) for address in requests)
    context.close()
    return figures


def _painted(page: Any) -> None:
    """Wait until what was done is on the screen and reported."""
    page.evaluate("new Promise(done => requestAnimationFrame(() => setTimeout(done, 120)))")
