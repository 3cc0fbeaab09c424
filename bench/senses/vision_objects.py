"""VisionNet on ten scans: error on held-out cameras and lights, within budgets of CPU seconds.

    python -m bench vision_objects --folder FOLDER [--objects CATALOGUE.csv] [--part 1/2]
        [--only ID ...] [--cases within_120 finer lights metal gloss within_600]

Views, fitted networks and rows are kept in FOLDER and not
made again, so that a run can be stopped, taken up and shared between processes; remove ``nets`` and ``rows``
to fit again without rendering. The result is written from the rows at hand and names those that are missing.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import conclude, cpu_seconds, kept
from bench.senses.catalogue import Scans, scan_arguments
from objectfolder.audio.materials import Material
from objectfolder.fidelity.sight import FOREGROUND_ALPHA, measure_sight, trivial_answer
from objectfolder.products.store import Array, Product, read_product, write_product
from objectfolder.products.tensor_file import TensorFile, read_tensor_file, write_tensor_file
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import CAMERA_RADIUS, FIELD_OF_VIEW_DEG, look_at, uniform_on_sphere
from objectfolder.vision.compositing import on_white
from objectfolder.vision.truth.cycles_process import render_in_children
from objectfolder.vision.truth.render_request import Shots, unit_scene
from objectfolder.vision.truth.views import simulate_views
from objectfolder.vision.visionnet.fitting import fit_visionnet
from objectfolder.vision.visionnet.map_sampling import sample_maps, stored_mesh
from objectfolder.vision.visionnet.visionnet import VisionNet

# Seven materials; metals: mug, spoon, bell, scissors, hammer; gloss: teapot, marble; thin: spoon, scissors;
# self-shadowing: stool, bell, mug.
OBJECTS = (
    "Threshold_Porcelain_Teapot_White",
    "025_mug",
    "painted_wooden_stool",
    "031_spoon",
    "Diamond_Visions_Scissors_Red",
    "Cole_Hardware_School_Bell_Solid_Brass_38",
    "011_banana",
    "062_dice",
    "063-b_marbles",
    "048_hammer",
)
RESOLUTION, HELD_OUT_VIEWS, HELD_OUT_SAMPLES = 128, 8, 256
# Paths a pixel of the truth of cases with highlights: with fewer its noise is what is measured.
SHINY_SAMPLES = 1024
# Bit that sets the seeds of that truth apart from those of the views, which are below 2^30.
TRUTH_SEED = 1 << 29
# Views of the other tests, and paths a pixel there.
OTHER_VIEWS, OTHER_SAMPLES = 4, 128
# Lights for which training views do not prepare a VisionNet.
LIGHTS = ("radius_0.8", "radius_2", "grazing", "behind")
GRAZING_DEG, BEHIND_DEG = 100.0, 160.0


def light_positions(light: str, cameras: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return (n, 3) lights: on a sphere about the origin, or at an angle from the camera's direction."""
    if light.startswith("radius_"):
        return uniform_on_sphere(len(cameras), float(light.removeprefix("radius_")), random)
    around = uniform_on_sphere(len(cameras), 1.0, random)
    if light == "sphere":
        return around
    towards = cameras[:, :3, 2]
    around -= np.einsum("ij,ij->i", around, towards)[:, None] * towards
    around /= np.linalg.norm(around, axis=1, keepdims=True)
    angle = np.deg2rad({"grazing": GRAZING_DEG, "behind": BEHIND_DEG}[light])
    result: np.ndarray = np.cos(angle) * towards + np.sin(angle) * around
    return result


@dataclass(frozen=True)
class Case:
    """What one network is trained on, and what it is asked.

    Parameters
    ----------
    views, samples
        Training views, and paths a pixel of them.
    roughness, metallic
        In place of the material's; None keeps that.
    fit
        Keyword arguments of `fit_visionnet`.
    """

    views: int = 100
    samples: int = 32
    roughness: float | None = None
    metallic: float | None = None
    fit: Mapping[str, Any] = field(default_factory=dict)

    @property
    def shiny(self) -> bool:
        """Whether it is judged by a truth of its own of `SHINY_SAMPLES`."""
        return self.roughness is not None

    def appearance(self, material: Material) -> Appearance:
        return Appearance(
            roughness=material.roughness if self.roughness is None else self.roughness,
            metallic=material.metallic if self.metallic is None else self.metallic,
        )


NETWORKS = {
    "within_120": Case(),
    "within_600": Case(views=400, fit={"steps": 6000, "training_pixels": 1_500_000}),
    "metal": Case(roughness=0.25, metallic=1.0),
    "gloss": Case(roughness=0.1, metallic=1.0),
    "glaze": Case(roughness=0.1, metallic=0.0),
    # Computed sight asks no training views; `simulate_views` makes one at least.
    "known": Case(views=1, fit={"material": "known"}),
}
CASES = ("within_120", "finer", "lights", "metal", "gloss", "glaze", "within_600")


def main() -> None:
    parser = scan_arguments("VisionNet on ten scans", "views, networks and rows")
    parser.add_argument("--part", default="1/1", help="which share of the objects, as 1/2")
    parser.add_argument("--only", nargs="+", default=OBJECTS, choices=OBJECTS, metavar="ID")
    parser.add_argument("--cases", nargs="+", default=CASES, choices=CASES)
    given = parser.parse_args()
    scans = Scans(given.objects)
    share, shares = map(int, given.part.split("/"))
    rows = given.folder / "rows"
    for case in given.cases:
        for name in given.only[share - 1 :: shares]:
            kept(
                rows / f"{name}-{case}.json",
                lambda at=name, of=case: Subject(scans, at, given.folder).answer(of),
            )
    found = {
        case: {name: kept(path, dict) for name in OBJECTS if (path := rows / f"{name}-{case}.json").exists()}
        for case in CASES
    }
    materials = {name: scans.material(name).name for name in OBJECTS}
    conclude("vision_objects", figures(found), settings(materials), COMPARED)


COMPARED = (
    "8-bit sRGB on white of VisionNet against Cycles (PSNR and SSIM, means of held-out views; foreground: "
    "pixels covered by half), beside two trivial answers with the true silhouette: the mean colour of the "
    "training views, and the unlit texture scaled to it; perceptual distance is left out for want of weights"
)


def settings(materials: Mapping[str, str]) -> dict[str, Any]:
    return {
        "materials": dict(materials),
        "resolution_px": RESOLUTION,
        "held_out": f"{HELD_OUT_VIEWS} views at {HELD_OUT_SAMPLES} samples, others {OTHER_VIEWS} "
        f"at {OTHER_SAMPLES}",
        "networks": {
            name: {
                "training_views": case.views,
                "training_samples": case.samples,
                "roughness": case.roughness,
                "metallic": case.metallic,
                **case.fit,
            }
            for name, case in NETWORKS.items()
            if name in CASES
        },
        "finer": f"the network of within_120, images of {2 * RESOLUTION} pixels a side",
        "lights": f"the same network; grazing: {GRAZING_DEG} degrees between light and camera seen from the "
        f"centre, behind: {BEHIND_DEG}",
        "threads": os.environ.get("OMP_NUM_THREADS", "all"),
        "metal, gloss, glaze": f"the same held-out cameras and lights at {SHINY_SAMPLES} samples; the noise "
        "floor is that of the 256 samples all the same, a bound from below",
        "times": "CPU seconds, child processes included; rendering: the training views alone",
    }


class Subject:
    """One object: its mesh, the surface as its file stores it, and what is kept of it in a folder."""

    def __init__(self, scans: Scans, name: str, folder: Path) -> None:
        self.name, self.material, self.folder = name, scans.material(name), folder
        self.mesh = scans.mesh(name)
        tensors = encode_surface(self.mesh.surface)
        self.surface = decode_surface(tensors)
        self.surface_bytes = sum(tensor.nbytes for tensor in tensors.values())
        self.frame = UnitFrame.of_points(self.mesh.vertices[np.unique(self.mesh.faces)])

    def answer(self, case: str) -> dict[str, Any]:
        """Return the row of one case."""
        if case == "lights":
            net, _ = self.network("within_120")
            return {light: self.asked(net, self.other_views(light, RESOLUTION)) for light in LIGHTS}
        if case == "finer":
            net, _ = self.network("within_120")
            return self.asked(net, self.other_views("sphere", 2 * RESOLUTION))
        net, costs = self.network(case)
        views, _ = self.views(case)
        if NETWORKS[case].shiny:
            views = self.with_truth(case, views)
        trivial = {"mean_colour": means(views, trivial_answer(views))}
        if "albedo" in views.arrays:
            trivial["unlit_texture"] = means(views, unlit(views))
        return {
            **self.asked(net, views),
            **costs,
            "noise_floor_db": views.attributes["noise_floor_db"],
            "noise_floor_foreground_db": views.attributes["noise_floor_foreground_db"],
            "trivial": trivial,
        }

    def with_truth(self, case: str, views: Product) -> Product:
        """Return the views, the held-out ones at `SHINY_SAMPLES` paths a pixel."""
        path = self.folder / "views" / f"{self.name}-{case}-truth.npy"
        held_out = views["held_out"]
        if not path.exists():
            shots = Shots(
                views["camera_to_world"][held_out], views["light_position"][held_out],
                views["seed"][held_out] ^ TRUTH_SEED, SHINY_SAMPLES, RESOLUTION, RESOLUTION,
                FIELD_OF_VIEW_DEG,
            )  # fmt: skip
            appearance = NETWORKS[case].appearance(self.material)
            np.save(path, render_in_children(unit_scene(self.mesh, appearance, self.frame), shots))
        rgba = views["rgba"].copy()
        rgba[held_out] = np.load(path)
        array = replace(views.arrays["rgba"], data=rgba)
        return Product({**views.arrays, "rgba": array}, views.attributes)

    def views(self, case: str) -> tuple[Product, float]:
        """Return training and held-out views, and the CPU seconds of the training views."""
        network = NETWORKS[case]
        path = self.folder / "views" / f"{self.name}-{case}.zarr.zip"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            start = cpu_seconds()
            product = simulate_views(
                self.mesh, network.appearance(self.material), resolution=RESOLUTION,
                training_views=network.views, training_samples=network.samples,
                held_out_views=HELD_OUT_VIEWS, held_out_samples=HELD_OUT_SAMPLES, seed=0,
            )  # fmt: skip
            both = cpu_seconds() - start
            write_product(path, product)
            # By samples: the held-out views and their two repeats cost as much a path.
            training = network.views * network.samples
            held_out = (HELD_OUT_VIEWS + 2) * HELD_OUT_SAMPLES
            path.with_suffix(".json").write_text(json.dumps(both * training / (training + held_out)))
        return read_product(path), json.loads(path.with_suffix(".json").read_text())

    def network(self, case: str) -> tuple[VisionNet, dict[str, float]]:
        """Return the fitted network, and what it cost."""
        path = self.folder / "nets" / f"{self.name}-{case}.safetensors"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            views, rendering = self.views(case)
            start = cpu_seconds()
            fit, maps = NETWORKS[case].fit, None
            if fit.get("material") == "known":
                appearance = NETWORKS[case].appearance(self.material)
                maps = sample_maps(stored_mesh(self.mesh, self.surface), self.frame, appearance, "known")
            net = fit_visionnet(self.surface, self.frame, views, maps=maps, seed=0, **fit)
            fitting = cpu_seconds() - start
            costs = {
                "render_cpu_s": rendering,
                "fit_cpu_s": fitting,
                "cpu_s": rendering + fitting,
                "bytes": self.surface_bytes + sum(tensor.nbytes for tensor in net.tensors().values()),
            }
            write_tensor_file(
                path,
                TensorFile(net.tensors(), {"net": json.dumps(net.metadata()), "costs": json.dumps(costs)}),
            )
        kept = read_tensor_file(path)
        net = VisionNet.from_tensors(kept.tensors, json.loads(kept.metadata["net"]), self.surface, self.frame)
        return net, json.loads(kept.metadata["costs"])

    def asked(self, net: VisionNet, views: Product) -> dict[str, Any]:
        """Return the error of the network on the held-out views, and the CPU seconds of an image."""
        held_out = views["held_out"]
        height, width = views["rgba"].shape[1:3]
        # The first query compiles.
        net.render(views["camera_to_world"][held_out][:1], views["light_position"][held_out][:1], 8, 20.0)
        start = cpu_seconds()
        image = net.render(
            views["camera_to_world"][held_out],
            views["light_position"][held_out],
            (height, width),
            FIELD_OF_VIEW_DEG,
        )
        seconds = (cpu_seconds() - start) / len(image)
        return {**means(views, on_white(image)), "image_cpu_s": seconds}

    def other_views(self, light: str, resolution: int) -> Product:
        """Return views, all held out, with lights unlike those of training: see `light_positions`."""
        path = self.folder / "views" / f"{self.name}-{light}-{resolution}.zarr.zip"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            random = np.random.default_rng(2)
            cameras = look_at(uniform_on_sphere(OTHER_VIEWS, CAMERA_RADIUS, random))
            lights = light_positions(light, cameras, random)
            seeds = random.integers(0, 2**30, OTHER_VIEWS, dtype=np.int32)
            shots = Shots(cameras, lights, seeds, OTHER_SAMPLES, resolution, resolution, FIELD_OF_VIEW_DEG)
            appearance = NETWORKS["within_120"].appearance(self.material)
            rgba = render_in_children(unit_scene(self.mesh, appearance, self.frame), shots)
            product = Product(
                {
                    "rgba": Array(rgba, ("view", "y", "x", "channel"), "1", "scene-linear RGBA"),
                    "camera_to_world": Array(cameras, ("view", "row", "column"), "1", "pose"),
                    "light_position": Array(lights, ("view", "axis"), "1", "point light"),
                    "held_out": Array(np.ones(OTHER_VIEWS, dtype=bool), ("view",), "1", "all"),
                },
                {},
            )
            write_product(path, product)
        return read_product(path)


def means(views: Product, answer: np.ndarray) -> dict[str, float]:
    """Return errors of (n, h, w, 3) uint8 images of the held-out views: means, and the worst view."""
    rgba = views["rgba"][views["held_out"]].astype(np.float32)
    measured = measure_sight(on_white(rgba), rgba[..., 3] >= FOREGROUND_ALPHA, answer)
    worst = min(row["psnr_db"] for row in measured.pop("per_view"))
    return {**measured, "worst_view_db": worst}


def unlit(views: Product) -> np.ndarray:
    """Return the held-out base colours, scaled to the mean radiance of training, as 8-bit images on white."""
    training, held_out = ~views["held_out"], views["held_out"]
    scale = views["rgba"][training][..., :3].astype(np.float64).mean() / max(
        float(views["albedo"][training].astype(np.float64).mean()), 1e-9
    )
    alpha = views["rgba"][held_out][..., 3:].astype(np.float64)
    return on_white(np.concatenate([views["albedo"][held_out] * scale * alpha, alpha], axis=-1))


def figures(found: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    summaries: dict[str, Any] = {}
    for case, rows in found.items():
        if case == "lights":
            summaries |= {
                light: summary({name: row[light] for name, row in rows.items()}) for light in LIGHTS
            }
        else:
            summaries[case] = summary(rows)
    return {"means": summaries, "objects": found}


def summary(rows: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return means over the objects, the worst object, and which objects are missing."""
    missing = [name for name in OBJECTS if name not in rows]
    if not rows:
        return {"missing": missing}
    keys = ["psnr_db", "psnr_foreground_db", "ssim", "render_cpu_s", "fit_cpu_s", "cpu_s", "bytes"]
    table = list(rows.values())
    return {
        **{key: float(np.mean([row[key] for row in table])) for key in keys if key in table[0]},
        "worst_object_db": min(row["psnr_db"] for row in table),
        "worst_object_foreground_db": min(row["psnr_foreground_db"] for row in table),
        "missing": missing,
    }
