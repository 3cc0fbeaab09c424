"""Whether the sound of a played scene runs dry: a minute of the page in a headless Chromium.

    OMP_NUM_THREADS=1 python -m bench live_page

`objectfolder play` serves a table with two mugs and a bell on one core; Chromium has the others. A mug is
squeezed, the other objects are dropped in turn every second. The page counts how often a block of sound came
after the one before had ended, and how often it left something out to catch up. What comes first, while files
unpack what they need, is not counted.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

import objectfolder
from bench.factory.viewer import ARGUMENTS, announced
from bench.record import arguments, conclude

NAMES, WARM_S, SECONDS = ("mug", "bell", "mug"), 10, 60
TABLE = "document.querySelector('.player').objectfolderTable"
DROP = f"""(body) => {{ const table = {TABLE};
  return table.try(() => table.act('lift', {{ body, height: 0.1 }})); }}"""
COUNT = f"""() => {{ const {{ underruns, skips, behind, context: {{ state }} }} = {TABLE}.sound;
  performance.setResourceTimingBufferSize(1e6);
  const asked = performance.getEntriesByType("resource");
  const images = asked.filter(({{ name }}) => new URL(name).pathname === "/seen");
  return {{ gaps: underruns, skips, images: images.length, sound_waits_s: behind, device: state }}; }}"""
COMPARED = (
    "gaps in the sound of a page and parts left out to catch up, counted by its player, in wall seconds; "
    "images asked for; how long sound waits before it is played; CPU seconds of the server and of what draws "
    "for it on the one core that both have; load average of the machine at the beginning and the end"
)


def played(scene: Path) -> dict[str, Any]:
    """A minute of a scene's page."""
    from playwright.sync_api import sync_playwright

    cores = sorted(os.sched_getaffinity(0))
    command = [sys.executable, "-m", "pipeline.cli", "play", str(scene), "--no-browser"]
    os.sched_setaffinity(0, cores[:1])  # the child's, too
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    os.sched_setaffinity(0, cores[1:] or cores)
    try:
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
            page = browser.new_page(viewport={"width": 1100, "height": 900})
            page.set_default_timeout(120_000)
            page.goto(announced(server))
            page.wait_for_selector(".player-image[data-state]")
            page.get_by_role("button", name="Squeeze").click()
            watched(page, WARM_S)
            process, load = psutil.Process(server.pid), os.getloadavg()[0]
            before, began_s, before_s = page.evaluate(COUNT), time.monotonic(), cpu_s(process)
            watched(page, SECONDS)
            after, length_s = page.evaluate(COUNT), time.monotonic() - began_s
            spent_s = cpu_s(process) - before_s
            browser.close()
    finally:
        server.terminate()
        server.wait()
        os.sched_setaffinity(0, cores)
    counted = {name: after[name] - before[name] for name in ("gaps", "skips", "images")}
    return {
        "seconds": length_s,
        **(after | counted),
        "server_cpu_s_per_second": spent_s / length_s,
        "load_average": [load, os.getloadavg()[0]],
    }


def cpu_s(process: psutil.Process) -> float:
    """CPU seconds of a process and of those that it has begun."""
    return sum(sum(each.cpu_times()[:2]) for each in (process, *process.children()))


def watched(page: Any, seconds: int) -> None:
    """Drop the objects beside the first in turn, one a second."""
    bodies = [f"{place}_{name}" for place, name in enumerate(NAMES)][1:]
    for second in range(seconds):
        page.evaluate(DROP, bodies[second % len(bodies)])
        page.wait_for_timeout(1000)


def main() -> None:
    arguments(__doc__).parse_args()
    examples = Path(objectfolder.__file__).parent / "examples"
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "scene.xml"
        files = [str(examples / f"{name}.safetensors") for name in NAMES]
        subprocess.run([sys.executable, "-m", "pipeline.cli", "scene", *files, "-o", str(scene)], check=True)
        figures = played(scene)
    settings = {
        "objects": NAMES,
        "warm_s": WARM_S,
    }
    conclude("live_page", figures, settings, COMPARED)
