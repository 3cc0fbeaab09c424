"""Sight: seconds against error, and bytes, of VisionNet, Cycles, the paper's network and lit textures.

    python -m bench vision --only ID ID ID --folder FOLDER [--objects CATALOGUE.csv] [--material known]

All renderers answer the same held-out cameras and lights and are compared with the same truth. Views, fitted
networks and finished rows are kept in FOLDER and not made again, and the result is of all rows there: delete
``*.row.json`` to measure again, and ``*.visionnet.safetensors`` too to fit again.
"""

import argparse
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import REPOSITORY, conclude, cpu_seconds, measure_once
from bench.rivals.vision.scattering_training import fit_scattering_function
from bench.rivals.vision.textures import SHADINGS, TexturedSurface
from bench.senses.catalogue import Scans, scan_arguments
from bench.senses.subject import Subject, ViewCounts
from bench.senses.vision_outcome import COMPARED, figures_of
from objectfolder.fidelity.sight import FOREGROUND_ALPHA, measure_sight, trivial_answer
from objectfolder.making.views.render_request import Shots, save_request, unit_scene
from objectfolder.making.visionnet.fitting import MATERIALS
from objectfolder.vision.cameras import CAMERA_RADIUS, LIGHT_RADIUS, look_at, uniform_on_sphere
from objectfolder.vision.compositing import composite_on_white, on_white
from objectfolder.vision.visionnet.visionnet import VisionNet

SIZES = (128, 256)
SUB_RAYS = (1, 2, 4, 16, 64, 128)
CYCLES_SAMPLES = (1, 4, 16, 64, 256)
TRAINING_SAMPLES, TRUTH_SAMPLES = 32, 512
# Rays on which the paper's network is judged, for whole images would take minutes each, and those of a step.
NETWORK_RAYS, NETWORK_BATCH_RAYS = 3072, 32
# Views of a query by which queries of many views are compared with as many queries.
BATCH = 48
# Seeds of the views are below 2^30; this bit makes those of Cycles as a rival of its own truth.
OWN_SEED = 1 << 29
# Share by which the lamp of each render is further away than that of the one before: bounced light is
# remembered by the lamp, and a render that found it would be too cheap.
NUDGE = 1e-9

Answer = Callable[[int], np.ndarray]


def main() -> None:
    parser = scan_arguments("sight: seconds, error and bytes", "views, networks and rows", only=())
    parser.add_argument("--sizes", type=int, nargs="+", default=list(SIZES), help="pixels a side")
    parser.add_argument("--training-views", type=int, default=100)
    parser.add_argument("--held-out-views", type=int, default=6)
    parser.add_argument("--material", choices=MATERIALS, default="learned", help="as of fit_visionnet")
    parser.add_argument("--cycles-samples", type=int, nargs="+", default=list(CYCLES_SAMPLES))
    parser.add_argument("--rounds", type=int, default=3, help="renders of each view by each way")
    parser.add_argument("--network-cpu-s", type=float, default=120.0, help="training of the paper's network")
    parser.add_argument("--network-objects", type=int, default=1, help="for how many of the objects")
    options = parser.parse_args()
    if not options.only:
        parser.error("name the objects to measure by --only")
    scans = Scans(options.objects)
    os.environ["NUMBA_NUM_THREADS"] = "1"
    import torch

    torch.set_num_threads(1)
    for size in options.sizes:
        for index, name in enumerate(options.only):
            network = index < options.network_objects
            measure_once(
                options.folder / f"{name}_{size}.row.json",
                lambda at=name, of=size, network=network: Case(options, scans, at, of).measure(network),
            )
    # Of earlier runs too, so that sizes and objects can be measured in parts.
    rows = [
        json.loads(path.read_text(encoding="utf-8")) for path in sorted(options.folder.glob("*.row.json"))
    ]
    record = "vision_known" if options.material == "known" else "vision"
    conclude(record, figures_of(rows), settings(options, rows), COMPARED)


def settings(options: argparse.Namespace, rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "objects": sorted({row["object"] for row in rows}),
        "sizes": sorted({row["size"] for row in rows}),
        "training": f"{options.training_views} views at {TRAINING_SAMPLES} samples",
        "material": options.material,
        "held_out": f"{options.held_out_views} views at {TRUTH_SAMPLES} samples, cameras and lights unseen",
        "times": "CPU seconds of one view, one thread, medians over views and rounds, ways interleaved",
        "cycles_times": "within its process after the first view, the scene kept; and with the process, "
        "the scene's set-up and Blender's start, as a view asked for alone costs",
        "rounds": options.rounds,
        "paper_network": {
            "training": f"{options.network_cpu_s} CPU s of views of {min(options.sizes)} pixels a side",
            "rays_a_step": NETWORK_BATCH_RAYS,
            "time": f"of {NETWORK_RAYS} rays spread over the held-out views, scaled to a whole image",
            "error": "of those pixels, squared errors pooled; no SSIM",
        },
        "bytes": "VisionNet: its tensors and the compressed surface; paper's network: single precision; "
        "Cycles and textures: the source mesh and texture as files",
    }


@dataclass
class CyclesRenders:
    """Images at one sample count, and CPU seconds of views in a running process and of processes for one."""

    images: np.ndarray = field(default_factory=lambda: np.zeros(0))
    view_cpu_s: list[float] = field(default_factory=list)
    process_cpu_s: list[float] = field(default_factory=list)


def counts(options: argparse.Namespace, size: int) -> ViewCounts:
    """Return how many views of a size there are."""
    return ViewCounts(size, options.training_views, TRAINING_SAMPLES, options.held_out_views, TRUTH_SAMPLES)


class Case:
    """One object at one size."""

    def __init__(self, options: argparse.Namespace, scans: Scans, name: str, size: int) -> None:
        self.options, self.name, self.size = options, name, size
        self.subjects = {
            pixels: Subject(scans, name, options.folder, counts(options, pixels), options.material)
            for pixels in {size, min(options.sizes)}
        }
        self.subject = subject = self.subjects[size]
        self.source_bytes = sum(path.stat().st_size for path in scans.folder(name).iterdir())
        self.cameras, self.lights = subject.held_out("camera_to_world"), subject.held_out("light_position")
        self.rgba = subject.held_out("rgba").astype(np.float32)
        self.attributes = subject.views.attributes
        self.field_of_view_deg = float(self.attributes["field_of_view_deg"])
        self.nudges = (1 + NUDGE * index for index in itertools.count())

    def measure(self, with_network: bool) -> dict[str, Any]:
        """Return the case's row."""
        net, costs = self.subject.sight
        answers: dict[tuple[str, int | None], Answer] = {}
        for count in SUB_RAYS:
            answers["VisionNet, compiled", count] = self._answer(net.render, sub_rays=count)
        for shading in SHADINGS:
            power = float(self.attributes["light_power_w"])
            textured = TexturedSurface(self.subject.mesh, self.subject.frame, shading, power)
            answers[f"{shading} texture", None] = self._answer(textured.render)
        images, seconds, ways = self._timed(answers)
        for (way_name, setting), image in images.items():
            ours = way_name.startswith("VisionNet")
            ways.append(
                {
                    "way": way_name,
                    "setting": setting,
                    **self._error(on_white(image)),
                    "cpu_s": float(np.median(seconds[way_name, setting])),
                    "bytes": costs["bytes"] if ours else self.source_bytes,
                }
            )
        ways.append(
            {
                "way": "mean colour",
                "setting": None,
                **self._error(trivial_answer(self.subject.views)),
                "bytes": 12,
            }
        )
        if with_network:
            ways.append(self._paper_network())
        return {
            "object": self.name,
            "size": self.size,
            "roughness": self.subject.appearance.roughness,
            "metallic": self.subject.appearance.metallic,
            "training_views": self.options.training_views,
            "rounds": self.options.rounds,
            "covered_share": float((self.rgba[..., 3] > 0).mean()),
            "truth_noise_floor_db": self.attributes["noise_floor_db"],
            "truth_noise_floor_foreground_db": self.attributes["noise_floor_foreground_db"],
            "views_cpu_s_held_out_included": self.subject.views_cpu_s,
            "visionnet_fit_cpu_s": costs["fit_cpu_s"],
            "batch": self._batch(net),
            "ways": ways,
        }

    def _batch(self, net: VisionNet) -> dict[str, float]:
        """Return wall seconds of `BATCH` queries of a view over those of one query, on all processors."""
        from numba import config

        random = np.random.default_rng(0)
        cameras = look_at(uniform_on_sphere(BATCH, CAMERA_RADIUS, random))
        lights = uniform_on_sphere(BATCH, LIGHT_RADIUS, random)
        threads, config.NUMBA_NUM_THREADS = config.NUMBA_NUM_THREADS, len(os.sched_getaffinity(0))
        ratios = []
        for _ in range(self.options.rounds):
            single, many = (next(self.nudges) * lights for _ in range(2))
            start = time.perf_counter()
            for view in range(BATCH):
                net.render(cameras[view], single[view], self.size, self.field_of_view_deg)
            middle = time.perf_counter()
            net.render(cameras, many, self.size, self.field_of_view_deg)
            ratios.append((middle - start) / (time.perf_counter() - middle))
        processors, config.NUMBA_NUM_THREADS = config.NUMBA_NUM_THREADS, threads
        times = {"median": float(np.median(ratios)), "least": min(ratios)}
        return {"views": BATCH, "processors": processors, **times}

    def _answer(self, render: Callable[..., Any], **more: int) -> Answer:
        def answer(view: int) -> np.ndarray:
            light = next(self.nudges) * self.lights[view]
            image: np.ndarray = render(self.cameras[view], light, self.size, self.field_of_view_deg, **more)
            return image[0]

        return answer

    def _timed(
        self, answers: dict[tuple[str, int | None], Answer]
    ) -> tuple[
        dict[tuple[str, int | None], np.ndarray],
        dict[tuple[str, int | None], list[float]],
        list[dict[str, Any]],
    ]:
        """Render every view in every way, the ways in an order that turns; the first render warms up.

        Cycles' processes, one a sample count, take their turn after each round of the others.
        """
        cycles = {samples: CyclesRenders() for samples in self.options.cycles_samples}
        images = {key: np.zeros(self.rgba.shape, dtype=np.float32) for key in answers}
        seconds: dict[tuple[str, int | None], list[float]] = {key: [] for key in answers}
        keys = list(answers)
        for key in keys:
            answers[key](0)
        for turn in range(self.options.rounds):
            for view in range(len(self.cameras)):
                shift = (turn * len(self.cameras) + view) % len(keys)
                for key in keys[shift:] + keys[:shift]:
                    start = time.process_time()
                    images[key][view] = answers[key](view)
                    seconds[key].append(time.process_time() - start)
            for samples, renders in cycles.items():
                self._render_by_cycles(samples, turn, renders)
        rows = [
            {
                "way": "Cycles",
                "setting": samples,
                **self._error(on_white(renders.images)),
                "cpu_s": float(np.median(renders.view_cpu_s)),
                "cpu_s_alone": float(np.median(renders.process_cpu_s)),
                "bytes": self.source_bytes,
            }
            for samples, renders in cycles.items()
        ]
        return images, seconds, rows

    def _error(self, answer: np.ndarray) -> dict[str, Any]:
        scores = measure_sight(on_white(self.rgba), self.rgba[..., 3] >= FOREGROUND_ALPHA, answer)
        return {key: scores[key] for key in ("psnr_db", "psnr_foreground_db", "ssim")}

    def _render_by_cycles(self, samples: int, turn: int, renders: "CyclesRenders") -> None:
        """Render one view alone, then all in one process, and add the seconds to `renders`."""
        seeds = self.subject.held_out("seed") ^ OWN_SEED
        view = turn % len(self.cameras)
        for views in (slice(view, view + 1), slice(None)):
            shots = Shots(
                self.cameras[views], self.lights[views], seeds[views], samples, self.size, self.size,
                self.field_of_view_deg, float(self.attributes["light_power_w"]),
            )  # fmt: skip
            images, within, whole = self._in_child(shots)
            if views == slice(None):
                renders.images = images
                renders.view_cpu_s.extend(within[1:])
            else:
                renders.process_cpu_s.append(whole)

    def _in_child(self, shots: Shots) -> tuple[np.ndarray, np.ndarray, float]:
        """Return images, CPU seconds of each view, and those of the whole process."""
        with tempfile.TemporaryDirectory(prefix="bench-vision-") as folder:
            request, result = Path(folder, "request.npz"), Path(folder, "result.npz")
            subject = self.subject
            save_request(request, unit_scene(subject.mesh, subject.appearance, subject.frame), shots)
            start = cpu_seconds()
            subprocess.run(
                [sys.executable, "-m", "bench.rivals.vision.cycles", str(request), str(result)],
                cwd=REPOSITORY,
                check=True,
            )
            whole = cpu_seconds() - start
            with np.load(result) as arrays:
                return arrays["images"], arrays["cpu_s"], whole

    def _paper_network(self) -> dict[str, Any]:
        views = self.subjects[min(self.options.sizes)].views
        fitted = fit_scattering_function(
            views, budget_cpu_s=self.options.network_cpu_s, batch_rays=NETWORK_BATCH_RAYS
        )
        generator = np.random.default_rng(0)
        errors, covered, seconds = [], [], []
        for camera, light, truth in zip(self.cameras, self.lights, self.rgba, strict=True):
            count = NETWORK_RAYS // len(self.cameras)
            pixels = generator.choice(self.size**2, count, replace=False)
            start = time.process_time()
            answer = fitted.pixels(camera, light, pixels, self.size, self.field_of_view_deg)
            seconds.append((time.process_time() - start) / count * self.size**2)
            colours = truth.reshape(-1, 4)[pixels]
            errors.append((composite_on_white(colours) - composite_on_white(answer)) ** 2)
            covered.append(colours[:, 3] >= FOREGROUND_ALPHA)
        squares, foreground = np.concatenate(errors), np.concatenate(covered)
        assert fitted.training is not None
        return {
            "way": "ObjectFolder 1.0 network",
            "setting": None,
            "psnr_db": float(-10 * np.log10(squares.mean())),
            "psnr_foreground_db": float(-10 * np.log10(squares[foreground].mean())),
            "ssim": None,
            "cpu_s": float(np.median(seconds)),
            "bytes": fitted.bytes,
            "steps": fitted.training.steps,
            "training_cpu_s": fitted.training.cpu_s,
        }
