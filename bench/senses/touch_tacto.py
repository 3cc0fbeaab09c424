"""Touch against TACTO 0.0.3: its own renderer's DIGIT images of the same meshes, poses and depths.

    python -m bench touch_tacto --python PYTHON --folder FOLDER [--objects CATALOGUE.csv]

PYTHON is that of an environment with the packages tacto==0.0.3, pyrender, trimesh, omegaconf, scipy,
opencv-python-headless and numpy<2, and EGL (see `touch_tacto_renderer`). Noise is off and the force 0, which
TACTO would turn into a shift of the object. Two meshes are drawn by both: one with a normal at each vertex as
TACTO's loader makes them, averaged over all faces round it, and one whose corners carry the crease-aware
normals of this project; and TACTO's drawing of the first is compared with ours by crease-aware normals, which
is what an untold user would see. Images of TACTO are kept in FOLDER; what is measured on them is not.
"""

import argparse
import subprocess
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import REPOSITORY, conclude, spread
from bench.senses.catalogue import Scans, scan_arguments, scan_set
from objectfolder.fidelity.images import ssim
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.presses.press import press, render_poses
from objectfolder.touch.presses.touches import Press
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.reading import calibrated
from objectfolder.touch.sensor.sensor import Sensor

SAMPLES = (1, 2, 3, 4)
NORMALS = ("vertex", "crease")
MIXED = "vertex, ours crease"
DEPTH_M = (0.0005, 0.002)
TILT_DEG = 15.0
# Least mean squared error that counts: the rounding of 8 bits; one level in one value of 160 x 120 pixels.
ROUNDING, ONE_LEVEL = 1 / 12, 1 / (160 * 120 * 3)
# Columns of a pose's row whose spreads are given.
MEASURES = (
    "raw_psnr_db", "contact_psnr_db", "calibrated_psnr_db", "raw_ssim", "calibrated_ssim",
    "empty_raw_psnr_db", "tacto_cpu_s",
)  # fmt: skip
COMPARED = (
    "Images of a DIGIT pressed into objects, ours over samples along a pixel's side against TACTO 0.0.3's "
    "own: PSNR of the raw image, of the pixels that change or touch, and of the calibrated image; SSIM"
)


class VertexShaded(Surface):
    """A surface shaded by one normal a vertex, averaged over all faces round it as trimesh does."""

    @cached_property
    def vertex_normals(self) -> np.ndarray:
        """Unit normals (V, 3)."""
        import trimesh

        return np.asarray(trimesh.Trimesh(self.vertices, self.faces, process=False).vertex_normals)

    @cached_property
    def corner_normals(self) -> np.ndarray:
        """The same (F, 3, 3)."""
        return self.vertex_normals[self.faces]


def main() -> None:
    parser = scan_arguments("touch against TACTO 0.0.3", "TACTO's images", only=scan_set("varied")[:10])
    parser.add_argument("--python", type=Path, required=True, help="of the environment that has TACTO")
    parser.add_argument("--poses", type=int, default=8, help="of each object")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    scans = Scans(options.objects)
    rows: list[dict[str, Any]] = []
    driver = ""
    for index, name in enumerate(options.only):
        surface = scans.surface(name)
        for normals in NORMALS:
            shaded = surface if normals == "crease" else VertexShaded(surface.vertices, surface.faces)
            request = _request(options, index, shaded)
            truth = _truth(
                options, f"{name}_{normals}_{options.poses}_{options.seed}", shaded, request["poses"]
            )
            driver = str(truth["driver"])
            rows += _measured(name, normals, shaded, request, truth)
            if normals == "vertex":
                rows += _measured(name, MIXED, surface, request, truth)
            print(name, normals, "compared", flush=True)
    summary = summarised(rows)
    print(summary)
    conclude("touch_tacto", {"summary": summary}, _settings(options, driver), COMPARED)


def _request(options: argparse.Namespace, index: int, surface: Surface) -> dict[str, np.ndarray]:
    """Poses, depths and tilts of presses at points drawn evenly over the area, where the sensor can stand."""
    random = np.random.default_rng([options.seed, index])
    count = 4 * options.poses
    depth = random.uniform(*DEPTH_M, count)
    # Every other press leans.
    tilt = np.where(np.arange(count) % 2 == 1, random.uniform(0, TILT_DEG, count), 0.0)
    azimuth = random.uniform(0, 360, count)
    points = surface.sample(count, options.seed).points
    touches = press(
        surface, Sensor(), points, Press(depth_m=depth, tilt_deg=tilt, azimuth_deg=azimuth, samples=1)
    )
    standing = np.flatnonzero(touches.penetration_m > 0)[: options.poses]
    return {
        "poses": touches.sensor_to_object[standing],
        "depth_m": depth[standing],
        "tilt_deg": tilt[standing],
        "reachable": touches.reachable[standing],
    }


def _truth(
    options: argparse.Namespace, key: str, surface: Surface, poses: np.ndarray
) -> dict[str, np.ndarray]:
    """Return what TACTO draws; see `touch_tacto_renderer`."""
    request, result = options.folder / f"{key}.request.npz", options.folder / f"{key}.tacto.npz"
    if result.exists():
        with np.load(request) as archive:
            fresh = not np.array_equal(archive["poses"], poses)
        if fresh:
            result.unlink()
    if not result.exists():
        if isinstance(surface, VertexShaded):
            mesh = {"vertices": surface.vertices, "faces": surface.faces}
        else:
            mesh = {
                "vertices": surface.vertices[surface.faces].reshape(-1, 3),
                "faces": np.arange(surface.faces.size).reshape(-1, 3),
                "normals": surface.corner_normals.reshape(-1, 3),
            }
        np.savez(request, poses=poses, **mesh)
        script = REPOSITORY / "bench" / "rivals" / "touch" / "tacto_renderer.py"
        subprocess.run([str(options.python), str(script), str(request), str(result)], check=True)
    with np.load(result) as arrays:
        truth = {name: arrays[name] for name in arrays.files}
    normals = truth["normals"] if isinstance(surface, VertexShaded) else truth["normals"].reshape(-1, 3, 3)
    ours = surface.vertex_normals if isinstance(surface, VertexShaded) else surface.corner_normals
    used = np.unique(surface.faces) if isinstance(surface, VertexShaded) else slice(None)
    if not np.allclose(normals[used], ours[used], atol=1e-4):
        raise RuntimeError(f"{key}: TACTO drew other normals than were compared")
    return truth


def _measured(
    name: str, normals: str, surface: Surface, request: dict[str, np.ndarray], truth: dict[str, np.ndarray]
) -> list[dict[str, Any]]:
    """Rows of every pose and number of samples."""
    sensor, patches = Sensor(), FacePatches(surface)
    if patches.surface is not surface:
        raise RuntimeError(f"{name}: its vertices or faces are not those that TACTO drew")
    rows: list[dict[str, Any]] = []
    for samples in SAMPLES:
        untouched = no_contact_image(sensor, samples)
        for pose, ours in enumerate(render_poses(patches, sensor, request["poses"], samples)):
            theirs = truth["images"][pose]
            region = (theirs != truth["no_contact"]).any(axis=-1) | ours.mask
            background = truth["no_contact"]
            answer = calibrated(ours.rgb, untouched, background, sensor)
            right = truth["calibrated"][pose]
            rows.append(
                {
                    "object": name,
                    "normals": normals,
                    "samples": samples,
                    "pose": pose,
                    "depth_m": float(request["depth_m"][pose]),
                    "tilt_deg": float(request["tilt_deg"][pose]),
                    "reachable": bool(request["reachable"][pose]),
                    "share_in_contact": float(region.mean()),
                    "raw_psnr_db": psnr_db(theirs, ours.rgb),
                    "raw_ssim": ssim(theirs, ours.rgb),
                    "contact_psnr_db": psnr_db(theirs, ours.rgb, region) if region.any() else None,
                    "calibrated_psnr_db": psnr_db(right, answer, least=ONE_LEVEL),
                    "calibrated_ssim": ssim(right, answer),
                    "empty_raw_psnr_db": psnr_db(theirs, background),
                    "tacto_cpu_s": float(truth["cpu_s"][pose]),
                }
            )
    return rows


def psnr_db(
    truth: np.ndarray, answer: np.ndarray, mask: np.ndarray | None = None, least: float = ROUNDING
) -> float:
    """PSNR, dB, of 8-bit images (h, w, 3) over `mask`; the mean squared error counts as at least `least`."""
    difference = truth.astype(np.float64) - answer
    if mask is not None:
        difference = difference[mask]
    return float(10 * np.log10(255**2 / max(float(np.mean(difference**2)), least)))


def summarised(rows: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Spreads over poses in which either sees the object, by normals and samples."""
    spreads: dict[str, dict[str, Any]] = {}
    for normals in (*NORMALS, MIXED):
        for samples in SAMPLES:
            in_contact = [
                row
                for row in rows
                if (row["normals"], row["samples"]) == (normals, samples) and row["share_in_contact"] > 0
            ]
            entry = {key: spread(in_contact, key) for key in MEASURES}
            spreads.setdefault(normals, {})[str(samples)] = {"poses": len(in_contact), **entry}
    return spreads


def _settings(options: argparse.Namespace, driver: str) -> dict[str, Any]:
    return {
        "objects": options.only,
        "poses_an_object": options.poses,
        "points": "drawn evenly over the area; every other press leans by up to 15 degrees; where the "
        "sensor cannot stand it is left out; the summary is of presses in which either sees the object",
        "depth_m": DEPTH_M,
        "seed": options.seed,
        "normals": {
            "vertex": "one a vertex, averaged over all faces round it, as TACTO's loader makes them",
            "crease": "this project's, averages of faces within a crease, carried by the mesh TACTO draws",
            MIXED: "each its own: TACTO smooths over creases, and this project does not",
        },
        "calibrated": "TACTO's blend, background + blur(image - no contact) / 2, over its no contact image",
        "psnr": "255^2 over the mean squared error, which counts as at least 1/12, the rounding of 8 bits "
        "(58.9 dB), in raw images; not clipped in calibrated ones but at one level in one value (95.7 dB)",
        "opengl": driver,
    }
