"""Maps of a source in sight: what normals, holes and albedo bring, and their bytes.

    python -m bench.senses.maps --folder FOLDER [--objects CATALOGUE.csv] [--chair CHAIR.gltf]

Views and rows are kept in FOLDER and not made again.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.record import conclude, cpu_seconds, kept
from bench.senses.catalogue import FOLDER, Scans, scan_arguments
from bench.senses.vision_objects import HELD_OUT_SAMPLES, HELD_OUT_VIEWS, RESOLUTION, means
from objectfolder.fidelity.images import psnr_db
from objectfolder.mesh.ingest import ingest_object
from objectfolder.mesh.mesh import TexturedMesh, textured_mesh_of
from objectfolder.products.store import Product, read_product, write_product
from objectfolder.surface.codec import decode_surface, encode_surface
from objectfolder.surface.frames import UnitFrame
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.cameras import CAMERA_RADIUS, FIELD_OF_VIEW_DEG, look_at, uniform_on_sphere
from objectfolder.vision.compositing import on_white, srgb_encode
from objectfolder.vision.network.incidence import UnitSurface
from objectfolder.vision.network.surface_maps import SurfaceMaps
from objectfolder.vision.rendering.pixel_centres import cast_pixel_centres
from objectfolder.vision.truth.cycles_process import render_in_children
from objectfolder.vision.truth.passes import cast_passes
from objectfolder.vision.truth.render_request import Shots, unit_scene
from objectfolder.vision.truth.views import simulate_views
from objectfolder.vision.visionnet.fitting import fit_visionnet
from objectfolder.vision.visionnet.map_sampling import sample_maps, stored_mesh

CHAIR = "plastic_monobloc_chair_01_1k"
"""A glTF with all maps, beside the catalogue's folder."""

PUNCHED = "025_mug"
"""Gets round holes by the alpha of its texture: no scan of the catalogue has any."""

HOLES_ACROSS = 24
ALBEDO = (
    "Threshold_Porcelain_Teapot_White",
    "011_banana",
    "050_medium_clamp",
    "wooden_table_02",
    "Television_01",
    "Womens_Multi_13",
    "Dino_5",
    "ACE_Coffee_Mug_Kristen_16_oz_cup",
    "painted_wooden_cabinet",
)
ALBEDO_VIEWS = 6
COMPARED = (
    "8-bit sRGB on white of VisionNet with and without a map, both fitted to the same views, and of Cycles "
    "without it, against Cycles with it (means of held-out views; foreground: pixels covered by half); the "
    "stored albedo (8-bit sRGB), roughness and metallic against the source's at pixel centres, views pooled"
)


def main() -> None:
    """Measure everything that is not in the folder yet."""
    parser = scan_arguments(__doc__, "views and rows")
    default = FOLDER.parent / "objects-as-downloaded" / CHAIR / f"{CHAIR}.gltf"
    parser.add_argument("--chair", type=Path, default=default, help="glTF with a map of normals")
    given = parser.parse_args()
    scans, rows = Scans(given.objects), given.folder / "rows"
    chair = textured_mesh_of(ingest_object(given.chair, object_id="chair"))
    plastic = Appearance(scans.material("plastic_monobloc_chair_01").roughness, 0.0)
    steel = Appearance(scans.material(PUNCHED).roughness, scans.material(PUNCHED).metallic)
    mug = scans.mesh(PUNCHED)
    fits = {
        "normals": (chair, replace(chair, normal_maps={}), plastic),
        "holes": (punched(mug), mug, steel),
    }
    found = {
        name: kept(rows / f"{name}.json", partial(fitted, given.folder / f"{name}.zarr.zip", *case))
        for name, case in fits.items()
    }
    found["reflectance"] = {
        name: kept(rows / f"stated-{name}.json", partial(stated, mesh, plastic))
        for name, mesh in [("chair", chair), *((name, scans.mesh(name)) for name in ALBEDO)]
    }
    settings = {
        "resolution_px": RESOLUTION,
        "held_out": f"{HELD_OUT_VIEWS} views at {HELD_OUT_SAMPLES} samples",
        "normals": f"{CHAIR}, all its maps, with and without that of normals",
        "holes": f"{PUNCHED}, about {HOLES_ACROSS} holes across its texture",
        "reflectance_views": ALBEDO_VIEWS,
    }
    conclude("maps", found, settings, COMPARED)


def punched(mesh: TexturedMesh) -> TexturedMesh:
    """Return a mesh whose first texture has round holes, a third of it in all."""
    texture = mesh.textures[0].copy()
    height, width = texture.shape[:2]
    y, x = (np.indices((height, width)) * HOLES_ACROSS / width) % 1.0 - 0.5
    texture[..., 3] = np.where(x**2 + y**2 < 1 / (3 * np.pi), 0, 255)
    return replace(mesh, textures=(texture, *mesh.textures[1:]), alpha_cutoffs={0: 0.5})


def fitted(path: Path, mesh: TexturedMesh, plain: TexturedMesh, appearance: Appearance) -> dict[str, Any]:
    """Return errors of a VisionNet with the maps of a mesh and of a plain one, and of Cycles with these."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        views = simulate_views(
            mesh, appearance, resolution=RESOLUTION, training_views=100, training_samples=32,
            held_out_views=HELD_OUT_VIEWS, held_out_samples=HELD_OUT_SAMPLES, seed=0,
        )  # fmt: skip
        write_product(path, views)
    views = read_product(path)
    held_out = views["held_out"]
    frame = UnitFrame.from_dict(views.attributes["frame"])
    shots = Shots(
        views["camera_to_world"][held_out], views["light_position"][held_out], views["seed"][held_out],
        HELD_OUT_SAMPLES, RESOLUTION, RESOLUTION, FIELD_OF_VIEW_DEG,
    )  # fmt: skip
    other = render_in_children(unit_scene(plain, appearance, frame), shots).astype(np.float32)
    return {
        "with": visionnet(mesh, views, appearance),
        "without": visionnet(plain, views, appearance),
        "cycles_without": means(views, on_white(other)),
        "noise_floor_foreground_db": views.attributes["noise_floor_foreground_db"],
    }


def visionnet(mesh: TexturedMesh, views: Product, appearance: Appearance) -> dict[str, Any]:
    """Return errors, bytes and CPU seconds of a VisionNet with the maps of a mesh."""
    start = cpu_seconds()
    stored = decode_surface(encode_surface(mesh.surface))
    frame = UnitFrame.from_dict(views.attributes["frame"])
    maps = sample_maps(stored_mesh(mesh, stored), frame, appearance)
    net = fit_visionnet(stored, frame, views, maps=maps, seed=0)
    fitting = cpu_seconds() - start
    held_out = views["held_out"]
    image = net.render(
        views["camera_to_world"][held_out], views["light_position"][held_out], RESOLUTION, FIELD_OF_VIEW_DEG
    )
    return {
        **means(views, on_white(image)),
        "fit_cpu_s": fitting,
        "bytes": sum(tensor.nbytes for tensor in net.tensors().values()),
        "map_bytes": map_bytes(maps),
    }


def map_bytes(maps: SurfaceMaps) -> dict[str, int]:
    """Return the bytes of each map in a file."""
    return {name: len(stream) for name, stream in maps.tensors().items()}


def stated(mesh: TexturedMesh, appearance: Appearance) -> dict[str, Any]:
    """Return bytes, pitch and error of the stored albedo, and of roughness and metallic where they vary."""
    stored = decode_surface(encode_surface(mesh.surface))
    frame = UnitFrame.of_points(mesh.vertices[np.unique(mesh.faces)])
    maps = sample_maps(stored_mesh(mesh, stored), frame, appearance)
    shown = UnitSurface(stored, frame, maps)
    cameras = look_at(uniform_on_sphere(ALBEDO_VIEWS, CAMERA_RADIUS, np.random.default_rng(0)))
    size = (RESOLUTION, RESOLUTION)
    truth = cast_passes(unit_scene(mesh, appearance, frame), cameras, size, FIELD_OF_VIEW_DEG)
    pairs: dict[str, list[np.ndarray]] = {name: [] for name in maps.levels if name != "alpha"}
    for index, camera in enumerate(cameras):
        seen = cast_pixel_centres(shown, camera, size, FIELD_OF_VIEW_DEG, (0, 0, *size))
        both = seen.mask & truth.mask[index]
        face, barycentric = shown.in_stored(seen.face, seen.barycentric)
        for name, pooled in pairs.items():
            if name != "normal":
                true = getattr(truth, name)[index][both].astype(np.float64).reshape(int(both.sum()), -1)
                true = srgb_encode(true) if name == "albedo" else true
                pooled.append(np.stack([true, maps.value(name, face, barycentric)[both[seen.mask]]]))
    return {
        name: {
            "db": psnr_db(*np.rint(255 * np.concatenate(pooled, axis=1))),
            "bytes": map_bytes(maps)[name],
            "pitch": maps.pitches[name],
        }
        for name, pooled in pairs.items()
        if pooled
    }


if __name__ == "__main__":
    main()
