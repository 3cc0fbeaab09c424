"""How soon the pages of an object answer: images, blows, and what a static player costs.

``python -m bench viewer FOLDER`` takes every Object File of a folder, by a headless Chromium.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import psutil

import objectfolder
from bench.record import arguments, conclude
from objectfolder.object_file import ObjectFile
from pipeline.publish.viewer.live import IMAGE_THREADS
from pipeline.publish.viewer.static import write_player, write_player_assets

IMAGES = 30
CLICKS = 24
PLACES = 60
RESOLUTION = 128
# Pixels a side, sub-rays (None: the file's own), and studio (None: one lamp). The page opens in the studio,
# and its first image of 512 pixels at rest has 4 sub-rays. The last number: parts asked for side by side.
SHOWN = {
    "image": (RESOLUTION, 16, None, 1),
    "image_as_stored": (RESOLUTION, None, None, 1),
    "image_large": (512, 16, None, 8),
    "image_in_studio": (RESOLUTION, 4, "studio", 1),
    "image_large_in_studio": (512, 4, "studio", 8),
}
LATENCY = "async () => (await import(`${location.origin}/listening.js`)).audioContext().baseLatency"
PANEL = "document.querySelector('.player').objectfolderPanel"
ARGUMENTS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--autoplay-policy=no-user-gesture-required",
]
DRAW = f"""async ([count, side, sub_rays, studio, parts]) => {{
  const panel = {PANEL}, waits = [];
  panel.orbit.studio = studio;
  for (let index = 0; index < count; index += 1) {{
    panel.orbit.turn(37, index % 2 ? 11 : -7);
    const [camera_to_world, light_position] = [panel.orbit.cameraToWorld(), panel.orbit.lightPosition()];
    const view = {{ camera_to_world, light_position, studio }};
    const start = performance.now();
    await panel.object._image(view, {{ resolution: side, sub_rays, parts }}, () => {{}});
    waits.push(performance.now() - start);
  }}
  panel._home();
  return waits; }}"""
LISTEN = """() => { window.waits = []; document.addEventListener(
  'player:struck', ({ detail }) => window.waits.push(detail.waited)); }"""
EXPECT = """() => { const said = document.querySelector('.player-said');
  said.textContent = '';
  window.said = new Promise((done) => new MutationObserver(done).observe(said, { childList: true })); }"""
AMPLITUDES = f"""([faces, weights, forces, normals]) => faces.map(
  (face, index) => {PANEL}.object.modes.amplitudes(face, weights[index], forces[index], normals[index]))"""


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("folder", type=Path, help="of Object Files")
    files = sorted(parser.parse_args().folder.glob("*.safetensors"))
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        rows = []
        for path in files:
            rows.append({"object": path.stem} | live(browser, path) | static(browser, path))
            print(rows[-1], flush=True)
        browser.close()
    figures = {"objects": rows, "over_objects": summary(rows)}
    settings = {
        "images": IMAGES,
        "clicks": CLICKS,
        "places_of_gains": PLACES,
        "images_shown": SHOWN,
        "threads": f"one for each part of an image, at most {IMAGE_THREADS}; {os.cpu_count()} processors",
        "load_average": os.getloadavg(),
        "wall": "measured in the page; other work was running on both cores",
        "render_cpu": "CPU seconds of the package's render of the data set's views, in this run",
        "image_distance": "the page's: the object fills the image, which costs more",
        "image_wall": "from the question to pixels in the canvas, transfer and decoding included",
        "image_cpu": "CPU seconds of the whole server process an image, all its threads",
        "strike_cpu": "CPU seconds of the server a blow, its partials included",
        "strike": "from the time stamp of the click's last event to the return of start() of the source: "
        "picking, modes, synthesis of 2 s, transfer, buffer; the device's own output latency is not in it",
        "static_bake": "CPU seconds to open the file and write its script; cached: its digest was known",
    }
    conclude(
        "viewer",
        figures,
        settings,
        "Time from view to image and from click to sound on the live page, and from click to sound, bytes, "
        "write time and gain error of the static player, object by object",
    )


def live(browser: Any, path: Path) -> dict[str, Any]:
    """Measure the live page of one file."""
    command = [sys.executable, "-c", "from pipeline.cli import main; main()"]
    server = subprocess.Popen(
        [*command, "view", str(path), "--no-browser"], stdout=subprocess.PIPE, text=True
    )
    try:
        address = announced(server)
        page = browser.new_page(viewport={"width": 1100, "height": 900})
        page.set_default_timeout(120_000)
        page.goto(address)
        page.wait_for_selector(".player-image[data-state=rest]")
        process = psutil.Process(server.pid)
        images: dict[str, Any] = {}
        for name, (side, sub_rays, studio, parts) in SHOWN.items():
            before = sum(process.cpu_times()[:2])
            waits = page.evaluate(DRAW, [IMAGES, side, sub_rays, studio, parts])
            cpu = (sum(process.cpu_times()[:2]) - before) / IMAGES
            images |= {f"{name}_cpu_ms": 1e3 * cpu, **spread(f"{name}_wall_ms", waits)}
            page.wait_for_selector(".player-image[data-state=rest]")
        before = sum(process.cpu_times()[:2])
        strikes = clicked(page)
        strike_cpu = (sum(process.cpu_times()[:2]) - before) / max(1, len(strikes))
        latency = page.evaluate(LATENCY)
        page.close()
    finally:
        server.terminate()
        server.wait()
    file = objectfolder.load(path)
    cameras, lights = file.sample_views(IMAGES, seed=0)
    file.render(cameras[:2], lights[:2], RESOLUTION)
    start = time.process_time()
    file.render(cameras, lights, RESOLUTION)
    return {
        "render_cpu_ms": 1e3 * (time.process_time() - start) / IMAGES,
        **images,
        "strike_cpu_ms": 1e3 * strike_cpu,
        **spread("strike_ms", strikes),
        "audio_base_latency_ms": 1e3 * latency,
    }


def announced(server: "subprocess.Popen[str]") -> str:
    """Return the address that a live page's command prints first."""
    line = server.stdout.readline() if server.stdout else ""
    address = re.search(r"http://\S+", line)
    if address is None:
        raise RuntimeError(f"no address in what the command printed: {line!r}")
    return address[0]


def clicked(page: Any) -> list[float]:
    """Click over the image; return the waits of the blows that met the object."""
    page.evaluate(LISTEN)
    image = page.locator(".player-image")
    image.scroll_into_view_if_needed()
    box = image.bounding_box()
    random = np.random.default_rng(0)
    for x, y in 0.5 + 0.22 * (random.random((CLICKS, 2)) - 0.5):
        page.evaluate(EXPECT)
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        page.evaluate("() => window.said.then(() => null)")
    waits: list[float] = page.evaluate("() => window.waits")
    return waits


def static(browser: Any, path: Path) -> dict[str, Any]:
    """Measure the static player of one file."""
    file = objectfolder.load(path)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_player_assets(folder)
        start = time.process_time()
        script = write_player(path, folder, "object", cache=folder / "cache")
        fresh = time.process_time() - start
        size = script.stat().st_size
        start = time.process_time()
        write_player(path, folder, "object", cache=folder / "cache")
        cached = time.process_time() - start
        (folder / "index.html").write_text(
            '<!doctype html><meta charset="utf-8"><link rel="stylesheet" href="player.css">'
            '<script src="player.js" defer></script>'
            '<div class="player" data-object="object" data-script="object.player.js"></div>'
        )
        page = browser.new_page(viewport={"width": 1100, "height": 900})
        page.set_default_timeout(120_000)
        page.goto((folder / "index.html").as_uri())
        page.wait_for_selector(".player-side")
        strikes = clicked(page)
        error = gain_error_db(page, file)
        page.close()
    return {
        "static_bytes": size,
        "static_bake_cpu_ms": 1e3 * fresh,
        "static_cached_cpu_ms": 1e3 * cached,
        **spread("static_strike_ms", strikes),
        "static_gain_error_db": error,
    }


def gain_error_db(page: Any, file: ObjectFile) -> float | None:
    """Relative rms error of modal amplitudes of blows into the surface, the page's against the package's."""
    if not len(file.modes.eigenvalues):
        return None
    samples = file.surface.sample(PLACES, seed=1)
    blows = (samples.face, samples.barycentric, -samples.normals, samples.normals)
    amplitudes = np.array(page.evaluate(AMPLITUDES, [array.tolist() for array in blows]))
    truth = file.mode_velocities(samples.points, -samples.normals)
    return float(10 * np.log10(((amplitudes - truth) ** 2).sum() / (truth**2).sum()))


def spread(name: str, values: Sequence[float]) -> dict[str, Any]:
    """Median and worst; None for nothing."""
    if not len(values):
        return {f"{name}_median": None, f"{name}_worst": None}
    return {f"{name}_median": float(np.median(values)), f"{name}_worst": float(np.max(values))}


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Median and worst object of each figure."""
    names = [name for name in rows[0] if name != "object"]
    columns = {name: [row[name] for row in rows if row[name] is not None] for name in names}
    return {
        name: {"median": float(np.median(v)), "worst": float(np.max(v))} for name, v in columns.items() if v
    }
