"""Exports of one object: views as NeRF or COLMAP data, its surface as textured glTF."""

import json
from pathlib import Path
from typing import Any

import objectfolder
from objectfolder.audio.materials import find_material, read_materials
from objectfolder.errors import InputError
from objectfolder.products.store import read_attributes, read_product
from objectfolder.products.tensor_file import read_metadata
from objectfolder.surface.surface import Surface
from objectfolder.vision.appearance import Appearance
from objectfolder.vision.export.base_colour import nearest_texture_colour, network_colour
from objectfolder.vision.export.colmap import write_colmap
from objectfolder.vision.export.files import new_folder
from objectfolder.vision.export.posed_views import PosedViews
from objectfolder.vision.export.textured_surface import ColourOf, write_mesh, write_surface
from objectfolder.vision.export.transforms import write_transforms
from pipeline.publish.export.found_products import FoundProducts
from pipeline.publish.export.summaries import ExportSummary
from pipeline.publish.queries.requests import Exporting


def write_export(found: FoundProducts, wanted: Exporting, output: Path) -> ExportSummary:
    """Write an export.

    Raises
    ------
    InputError
        What is asked for is not there, or a folder that cannot be written.
    """
    write = _write_gltf if wanted.format == "gltf" else _write_views
    figures, words = write(found, wanted, output)
    return ExportSummary(folder=str(output), licence=found.credit().licence, figures=figures, words=words)


def _write_views(found: FoundProducts, wanted: Exporting, output: Path) -> tuple[dict[str, Any], str]:
    if found.views is None:
        finding = f"has no views, and {wanted.format} is made of them"
        remedy = "Name a product of views, or run the stage `views`; glTF needs none."
        raise InputError(found.object_id, finding, remedy)
    views = PosedViews.of_product(read_product(found.views), wanted.frame, str(found.views))
    held_out = int(views.held_out.sum())
    figures: dict[str, Any] = {"views": len(views), "held_out": held_out, "pixels": list(views.size)}
    with new_folder(output, overwrite=wanted.overwrite) as folder:
        if wanted.format == "nerf":
            figures["cameras"] = write_transforms(folder, views, found.credit(), exr=wanted.exr)
        else:
            surface = found.source_mesh().surface if found.objects is not None else None
            if surface is None and found.object_file is not None:
                surface = objectfolder.load(found.object_file).surface
            figures["points"] = write_colmap(
                folder,
                views,
                found.credit(),
                surface,
                points=wanted.points,
                seed=wanted.seed,
                exr=wanted.exr,
            )
        figures["frame"] = views.described_frame()
        found.write_manifest(folder, wanted.format, figures)
    extra = f", {figures['points']} points" if "points" in figures else ""
    size = f"{views.size[1]} x {views.size[0]} pixels ({held_out} held out)"
    return figures, f"{len(views)} views of {size}{extra}, {views.frame} frame"


def _write_gltf(found: FoundProducts, wanted: Exporting, output: Path) -> tuple[dict[str, Any], str]:
    surface = wanted.surface or ("stored" if found.object_file is not None else "source")
    appearance, credit = appearance_of(found, wanted), found.credit()
    name = f"{found.object_id}.glb"
    if surface == "source" and wanted.vertex_colours:
        raise InputError("--vertex-colours", "the source mesh has its own textures", "Leave one of them out.")
    with new_folder(output, overwrite=wanted.overwrite) as folder:
        if surface == "source":
            written = write_mesh(folder / name, found.source_mesh(), appearance, credit)
        else:
            stored, colour_of, colour, finest_m = stored_colours(found, wanted, appearance)
            written = write_surface(
                folder / name,
                stored,
                colour_of,
                appearance,
                credit,
                colour=colour,
                side=wanted.texture_side,
                finest_m=finest_m,
                vertex_colours=wanted.vertex_colours,
            )
        figures = {"surface": surface, "file": name, **written}
        found.write_manifest(folder, wanted.format, figures)
    pitch = f", a texel each {written['texel_pitch_m'] * 1e3:.3g} mm" if "texel_pitch_m" in written else ""
    size = f"{written['bytes'] / 1e6:.2f} MB"
    return figures, f"{name}, {written['triangles']} triangles of the {surface} surface{pitch}, {size}"


def stored_colours(
    found: FoundProducts, wanted: Exporting, appearance: Appearance
) -> tuple[Surface, ColourOf, str, float]:
    """Return the stored surface, its colours, these in words, and the texel pitch that suffices (metres)."""
    if found.object_file is None:
        remedy = "Give one, or --surface source."
        raise InputError(found.object_id, "has no Object File, so no stored surface", remedy)
    file = objectfolder.load(found.object_file)
    surface = file.surface
    if (wanted.colour or ("network" if found.objects is None else "source")) == "source":
        mesh = found.source_mesh()
        return (
            surface,
            lambda face, at: nearest_texture_colour(
                mesh, surface.points_at(face, at), surface.face_normals[face]
            ),
            "the source's texture at the nearest point",
            0.0,
        )
    # A quarter of a cell of the network's grid: between, its colours are nearly linear.
    finest_m = file.frame.scale / file.description["vision"]["grid_resolution"] / 4
    return (
        surface,
        lambda face, at: network_colour(file.vision, surface, file.frame, face, at, appearance.metallic),
        "VisionNet's reflectance along the normal, without the clear coat",
        finest_m,
    )


def appearance_of(found: FoundProducts, wanted: Exporting) -> Appearance:
    """Return roughness and metallic as asked, as rendered, or as the materials table has them."""
    known: dict[str, Any] = {}
    if found.views is not None:
        known = dict(read_attributes(found.views)["appearance"])
    elif found.record is not None:
        known = dict(found.record["appearance"])
    elif found.object_file is not None:
        material = json.loads(read_metadata(found.object_file)["material"])
        row = find_material(read_materials(wanted.materials), material["name"], str(wanted.materials))
        known = {"roughness": row.roughness, "metallic": row.metallic}
    asked = {"roughness": wanted.roughness, "metallic": wanted.metallic}
    known |= {name: value for name, value in asked.items() if value is not None}
    for name in asked:
        if name not in known:
            raise InputError(found.object_id, f"its {name} is not known", f"Give --{name}.")
    return Appearance(**known)
