"""Direct light in closed form against Cycles without bounces, and the price of each of its terms.

    python -m bench direct_light --folder FOLDER [--objects CATALOGUE.csv] [--only ID ...]

Objects without a catalogue are the starter set's. Truths are kept in FOLDER and not made again.
"""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import arguments, conclude, measure_once
from bench.senses.air import starter_set
from bench.senses.catalogue import Scans
from objectfolder.fidelity.sight import FOREGROUND_ALPHA
from objectfolder.making.views.cycles_process import render_in_children
from objectfolder.making.views.render_request import Scene, Shots, unit_scene
from objectfolder.surface.frames import UnitFrame
from objectfolder.surface.surface import Surface
from objectfolder.surface.texture_lookup import bilinear
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import (
    CAMERA_RADIUS,
    FIELD_OF_VIEW_DEG,
    LIGHT_RADIUS,
    look_at,
    pixel_rays,
    sub_ray_offsets,
    uniform_on_sphere,
)
from objectfolder.vision.compiled.lighting import LitSurface, Points
from objectfolder.vision.compiled.principled import Principled
from objectfolder.vision.compositing import composite_on_white, srgb_decode
from objectfolder.vision.lamps import LIGHT_POWER_W
from objectfolder.vision.network.incidence import UnitSurface

OBJECTS = ("mug", "bell")
RESOLUTION, VIEWS, SAMPLES, SUB_RAYS = 128, 4, 512, 64
# Lamps stand at these distances from the centre in turn.
DISTANCES = (LIGHT_RADIUS, 0.7, 1.5, 3.0)
COMPARED = (
    "unrounded sRGB on white of direct light in closed form, under the truth's alpha, against Cycles without "
    "bounces (PSNR of the foreground, pixels covered by half, of all views together), each term switched off"
)


def main() -> None:
    """Measure everything that is not in the folder yet."""
    parser = arguments(__doc__)
    parser.add_argument("--objects", type=Path, help="catalogue of meshes, CSV; the starter set if none")
    parser.add_argument("--only", nargs="+", default=list(OBJECTS), help="ids of the objects to measure")
    parser.add_argument("--folder", type=Path, required=True, help="where truths and rows are kept")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scans = Scans(options.objects) if options.objects else starter_set(Path(folder))
        rows = {
            name: measure_once(
                options.folder / f"{name}.json",
                lambda at=name: Case(scans, at, options.folder / f"{at}.truth.npy").prices(),
            )
            for name in options.only
        }
    settings = {
        "resolution_px": RESOLUTION,
        "views": VIEWS,
        "lamp_distances": DISTANCES,
        "truth": f"Cycles, {SAMPLES} samples, no bounces",
        "sub_rays": SUB_RAYS,
    }
    conclude("direct_light", rows, settings, COMPARED)


@dataclass(frozen=True)
class ViewPoints:
    """Points that the sub-rays of a view meet: their pixels (n,), base colours (n, 3) and terms."""

    pixel: np.ndarray
    points: Points
    base: np.ndarray
    terms: np.ndarray


class Case:
    """One object, its truth and the closed form."""

    def __init__(self, scans: Scans, name: str, path: Path) -> None:
        mesh, material = scans.mesh(name), scans.material(name)
        self.appearance = Appearance(material.roughness, material.metallic)
        frame = UnitFrame.of_points(mesh.vertices[np.unique(mesh.faces)])
        self.scene = unit_scene(mesh, self.appearance, frame)
        random = np.random.default_rng(5)
        self.cameras = look_at(uniform_on_sphere(VIEWS, CAMERA_RADIUS, random))
        self.lights = uniform_on_sphere(VIEWS, 1.0, random) * np.resize(DISTANCES, VIEWS)[:, None]
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            shots = Shots(
                self.cameras, self.lights, np.arange(VIEWS), SAMPLES, RESOLUTION, RESOLUTION,
                FIELD_OF_VIEW_DEG, bounces=0,
            )  # fmt: skip
            np.save(path, render_in_children(self.scene, shots))
        self.truth = np.load(path).astype(np.float64)
        surface = Surface(self.scene.vertices, self.scene.faces, normals=self.scene.corner_normals)
        self.surface = LitSurface(UnitSurface(surface, UnitFrame.of_points(self.scene.vertices)))
        roughness = (self.appearance.roughness,)
        self.principled = Principled(self.appearance.specular, roughness)
        self.views = [self._seen(camera) for camera in self.cameras]

    def _seen(self, camera: np.ndarray) -> ViewPoints:
        pixels = np.arange(RESOLUTION**2)
        origins, directions = pixel_rays(
            camera, pixels, sub_ray_offsets(SUB_RAYS), RESOLUTION, FIELD_OF_VIEW_DEG
        )
        face, barycentric = self.surface.volumes.first_hits(origins, directions)
        hit = np.flatnonzero(face >= 0)
        points = self.surface.points(face[hit], barycentric[hit], directions[hit])
        base = base_colour(self.scene, points)
        return ViewPoints(hit // SUB_RAYS, points, base, self._terms(self.principled, points, base))

    def _terms(self, principled: Principled, points: Points, base: np.ndarray) -> np.ndarray:
        constant = np.full((2, len(base)), [[self.appearance.roughness], [self.appearance.metallic]])
        return principled.terms(points, base, *constant)

    def prices(self) -> dict[str, Any]:
        """Return ``prices``: the error in dB of the closed form, whole and without each of its terms."""
        terms = [view_points.terms for view_points in self.views]
        metal = self.appearance.metallic > 0

        def without(*columns: int, value: float = 0.0) -> list[np.ndarray]:
            changed = [part.copy() for part in terms]
            for part in changed:
                part[:, list(columns)] = value
            return changed

        def even_lobe() -> list[np.ndarray]:
            once = Principled(self.appearance.specular, (self.appearance.roughness,))
            once._white, once._mean = np.ones_like(once._white), np.ones_like(once._mean)
            return [self._terms(once, view_points.points, view_points.base) for view_points in self.views]

        def schlick() -> list[np.ndarray]:
            """The coat as a metal of its upright reflection."""
            changed = without(3)
            for part, own in zip(changed, terms, strict=True):
                part[:, 4:7], part[:, 7:] = own[:, 3:4], 0.08 * self.appearance.specular
            return changed

        def upright() -> list[np.ndarray]:
            """A metal whose reflection is that of upright light from all sides."""
            changed = without(7, 8, 9, value=1.0)
            for part, own in zip(changed, terms, strict=True):
                part[:, 4:7] *= own[:, 7:]
            return changed

        rows = {
            "whole": self._error(terms),
            "without gloss": self._error(without(3, 4, 5, 6)),
            "one scattering": self._error(even_lobe()),
            "without shadows": self._error(terms, shadows=False),
            "without the terminator's lift": self._error(terms, lift=False),
        }
        if metal:
            return {"prices": rows | {"upright Fresnel": self._error(upright())}}
        return {
            "prices": rows
            | {
                "matt base unscaled": self._error(without(2, value=1.0)),
                "Schlick for the coat": self._error(schlick()),
            }
        }

    def _error(self, terms: list[np.ndarray], shadows: bool = True, lift: bool = True) -> Mapping[str, float]:
        squares, lit_squares = [], []
        for view, view_points in enumerate(self.views):
            colour = self._colour(replace(view_points, terms=terms[view]), self.lights[view], shadows, lift)
            truth = self.truth[view].reshape(-1, 4)
            count = np.maximum(np.bincount(view_points.pixel, minlength=len(truth)), 1)
            mean = np.stack([np.bincount(view_points.pixel, part, len(truth)) for part in colour.T], axis=1)
            answer = np.concatenate([mean / count[:, None] * truth[:, 3:], truth[:, 3:]], axis=1)
            shown = truth[:, 3] >= FOREGROUND_ALPHA
            square = (composite_on_white(truth[shown]) - composite_on_white(answer[shown])) ** 2
            squares.append(square)
            lit_squares.append(square[truth[shown, :3].max(axis=1) > 0])
        return {
            "foreground_db": _decibels(np.concatenate(squares)),
            "worst_view_db": min(_decibels(square) for square in squares),
            "lit_db": _decibels(np.concatenate(lit_squares)),
        }

    def _colour(self, view_points: ViewPoints, light: np.ndarray, shadows: bool, lift: bool) -> np.ndarray:
        points = view_points.points
        irradiance, hidden = self.surface.light_from(points, light)
        if not lift:
            facet = self.surface.facets[points.face] * points.side[:, None]
            hidden = self.surface.volumes.occluded(points.position + 1e-4 * facet, light, irradiance > 0)
        if shadows:
            irradiance[hidden] = 0.0
        lit = np.flatnonzero(irradiance)
        to_light = light - points.position[lit]
        to_light /= np.linalg.norm(to_light, axis=1, keepdims=True)
        even, gloss = self.principled.reflected(points, view_points.terms, lit, to_light)
        colour = np.zeros(view_points.base.shape)
        colour[lit] = irradiance[lit, None] * (view_points.base[lit] * even + gloss)
        return colour * (LIGHT_POWER_W / (4 * np.pi**2))


def base_colour(scene: Scene, points: Points) -> np.ndarray:
    """Return the scene-linear base colour (n, 3) of points."""
    coordinates = np.einsum("ij,ijk->ik", points.barycentric, scene.texture_coordinates[points.face])
    colour = np.zeros((len(coordinates), 3))
    for index, texture in enumerate(scene.textures):
        own = np.flatnonzero(scene.face_texture[points.face] == index)
        colour[own] = srgb_decode(bilinear(texture[..., :3], coordinates[own]))
    return colour


def _decibels(square: np.ndarray) -> float:
    return float(-10 * np.log10(max(float(square.mean()), 1e-12)))
