"""Touch against TACTO 0.0.3: its own renderer's DIGIT images of the same meshes, poses and depths.

    python -m bench.senses.touch_tacto --objects CATALOGUE.csv --python PYTHON --cache FOLDER

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

from bench.record import REPOSITORY, arguments, write
from bench.senses.touch_objects import OBJECTS, surface_of
from bench.senses.touch_outcome import draw_tacto
from bench.senses.touch_tacto_measure import ONE_LEVEL, edge_share, over_poses, psnr_db
from objectfolder.fidelity.images import ssim
from objectfolder.surface.surface import Surface
from objectfolder.touch.contact.patch import FacePatches
from objectfolder.touch.sensor.calibrated import calibrated
from objectfolder.touch.sensor.camera import no_contact_image
from objectfolder.touch.sensor.sensor import Sensor
from objectfolder.touch.truth.press import press, render_poses
from objectfolder.touch.truth.touches import Press

SAMPLES = (1, 2, 3, 4)
NORMALS = ("vertex", "crease")
MIXED = "vertex, ours crease"
DEPTH_M = (0.0005, 0.002)
TILT_DEG = 15.0
BARS = {
    "raw_psnr_mean_db": 52.0,
    "raw_psnr_worst_db": 43.0,
    "calibrated_psnr_worst_db": 60.0,
    "calibrated_ssim_worst": 0.9995,
}
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
    parser = arguments("touch against TACTO 0.0.3")
    parser.add_argument("--objects", type=Path, required=True, help="catalogue of meshes, CSV")
    parser.add_argument("--python", type=Path, required=True, help="of the environment that has TACTO")
    parser.add_argument("--cache", type=Path, required=True, help="where TACTO's images are kept")
    parser.add_argument("--only", nargs="+", default=list(OBJECTS[:10]), help="ids of the objects")
    parser.add_argument("--poses", type=int, default=8, help="of each object")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if not given.objects.is_file():
        print(f"skipped: no catalogue of objects at {given.objects}")
        return
    given.cache.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    pictures: list[tuple[float, np.ndarray, np.ndarray]] = []
    driver = ""
    for index, name in enumerate(given.only):
        surface = surface_of(given.objects, name, given.cache)
        for normals in NORMALS:
            shaded = surface if normals == "crease" else VertexShaded(surface.vertices, surface.faces)
            request = _request(given, name, index, shaded)
            truth = _truth(given, f"{name}_{normals}_{given.poses}_{given.seed}", shaded, request["poses"])
            driver = str(truth["driver"])
            found, images = _measured(name, normals, shaded, request, truth)
            rows += found
            pictures += images if normals == "vertex" else []
            if normals == "vertex":
                rows += _measured(name, MIXED, surface, request, truth)[0]
            print(name, normals, *(f"{row['samples']}: {row['raw_psnr_db']:.1f}" for row in found[:4]))
    conclude(rows, pictures, given, driver)


def _request(given: argparse.Namespace, name: str, index: int, surface: Surface) -> dict[str, np.ndarray]:
    """Poses, depths and tilts of presses at points drawn evenly over the area, where the sensor can stand."""
    random = np.random.default_rng([given.seed, index])
    count = 4 * given.poses
    depth = random.uniform(*DEPTH_M, count)
    # Every other press leans.
    tilt = np.where(np.arange(count) % 2 == 1, random.uniform(0, TILT_DEG, count), 0.0)
    azimuth = random.uniform(0, 360, count)
    points = surface.sample(count, given.seed).points
    touches = press(
        surface, Sensor(), points, Press(depth_m=depth, tilt_deg=tilt, azimuth_deg=azimuth, samples=1)
    )
    standing = np.flatnonzero(touches.penetration_m > 0)[: given.poses]
    return {
        "poses": touches.sensor_to_object[standing],
        "depth_m": depth[standing],
        "tilt_deg": tilt[standing],
        "reachable": touches.reachable[standing],
    }


def _truth(given: argparse.Namespace, key: str, surface: Surface, poses: np.ndarray) -> dict[str, np.ndarray]:
    """Return what TACTO draws; see `touch_tacto_renderer`."""
    request, result = given.cache / f"{key}.request.npz", given.cache / f"{key}.tacto.npz"
    if result.exists():
        with np.load(request) as asked:
            fresh = not np.array_equal(asked["poses"], poses)
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
        subprocess.run([str(given.python), str(script), str(request), str(result)], check=True)
    with np.load(result) as found:
        truth = {name: found[name] for name in found.files}
    drawn = truth["normals"] if isinstance(surface, VertexShaded) else truth["normals"].reshape(-1, 3, 3)
    ours = surface.vertex_normals if isinstance(surface, VertexShaded) else surface.corner_normals
    used = np.unique(surface.faces) if isinstance(surface, VertexShaded) else slice(None)
    if not np.allclose(drawn[used], ours[used], atol=1e-4):
        raise RuntimeError(f"{key}: TACTO drew other normals than were compared")
    return truth


def _measured(
    name: str, normals: str, surface: Surface, request: dict[str, np.ndarray], truth: dict[str, np.ndarray]
) -> tuple[list[dict[str, Any]], list[tuple[float, np.ndarray, np.ndarray]]]:
    """Rows of every pose and number of samples, and pairs of images at 2x2 with their PSNR."""
    sensor, patches = Sensor(), FacePatches(surface)
    if patches.surface is not surface:
        raise RuntimeError(f"{name}: its vertices or faces are not those that TACTO drew")
    rows: list[dict[str, Any]] = []
    pictures: list[tuple[float, np.ndarray, np.ndarray]] = []
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
                    "error_at_edges": edge_share(theirs, ours.rgb, ours.mask),
                    "empty_raw_psnr_db": psnr_db(theirs, truth["no_contact"]),
                    "empty_raw_ssim": ssim(theirs, truth["no_contact"]),
                    "empty_contact_psnr_db": psnr_db(theirs, truth["no_contact"], region)
                    if region.any()
                    else None,
                    "empty_calibrated_psnr_db": psnr_db(right, background, least=ONE_LEVEL),
                    "empty_calibrated_ssim": ssim(right, background),
                    "tacto_cpu_s": float(truth["cpu_s"][pose]),
                }
            )
            if samples == 2 and region.any():
                pictures.append((rows[-1]["raw_psnr_db"], theirs, ours.rgb))
    return rows, pictures


def conclude(
    rows: list[dict[str, Any]],
    pictures: list[tuple[float, np.ndarray, np.ndarray]],
    given: argparse.Namespace,
    driver: str,
) -> None:
    """Write and draw."""
    seen = [row for row in rows if row["share_in_contact"] > 0]
    summary = {
        normals: {
            str(samples): over_poses(
                [row for row in seen if row["normals"] == normals and row["samples"] == samples]
            )
            for samples in SAMPLES
        }
        for normals in (*NORMALS, MIXED)
    }
    at_two = {normals: found["2"] for normals, found in summary.items()}
    met = {
        normals: {key: bool(found[key] >= bar) for key, bar in BARS.items()}
        for normals, found in at_two.items()
    }
    figures = {"summary": summary, "bars": BARS, "bars_met_at_2x2": met, "poses": rows}
    settings = {
        "objects": given.only,
        "poses_an_object": given.poses,
        "points": "drawn evenly over the area; every other press leans by up to 15 degrees; where the "
        "sensor cannot stand it is left out; the summary is of presses in which either sees the object",
        "depth_m": DEPTH_M,
        "seed": given.seed,
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
    write("touch_tacto", figures, settings, COMPARED)
    draw_tacto(summary, rows, sorted(pictures, key=lambda item: item[0]))
    for normals, found in at_two.items():
        print(normals, {key: round(value, 4) for key, value in found.items() if isinstance(value, float)})
        print("  met", met[normals])


if __name__ == "__main__":
    main()
