"""Exports of one object: views as NeRF or COLMAP data, its surface as textured glTF."""

import json
from pathlib import Path
from typing import Any

import objectfolder
from objectfolder.errors import InputError
from objectfolder.export.files import new_folder
from objectfolder.export.posed_views import PosedViews
from objectfolder.export.textured_surface import ColourOf, write_mesh, write_surface
from objectfolder.making.materials import find_material, read_materials
from objectfolder.products.store import read_attributes, read_product
from objectfolder.products.tensor_file import read_metadata
from objectfolder.surface.surface import Surface
from objectfolder.vision.appearance import Appearance
from pipeline.dataset.counts import counted
from pipeline.publish.export.base_colour import nearest_texture_colour, network_colour
from pipeline.publish.export.colmap import write_colmap
from pipeline.publish.export.object_products import ObjectProducts
from pipeline.publish.export.summaries import ExportSummary
from pipeline.publish.export.transforms import write_transforms
from pipeline.publish.queries.requests import Exporting


def write_export(products: ObjectProducts, options: Exporting, output: Path) -> ExportSummary:
    """Write an export.

    Raises
    ------
    InputError
        What is asked for is not there, or a folder that cannot be written.
    """
    write = _write_gltf if options.format == "gltf" else _write_views
    figures, words = write(products, options, output)
    return ExportSummary(folder=str(output), licence=products.credit().licence, figures=figures, words=words)


def _write_views(products: ObjectProducts, options: Exporting, output: Path) -> tuple[dict[str, Any], str]:
    if products.views is None:
        finding = f"has no views, and {options.format} is made of them"
        remedy = "Name a product of views, or run the stage `views`; glTF needs none."
        raise InputError(products.object_id, finding, remedy)
    views = PosedViews.of_product(read_product(products.views), options.frame, str(products.views))
    held_out = int(views.held_out.sum())
    figures: dict[str, Any] = {"views": len(views), "held_out": held_out, "pixels": list(views.size)}
    with new_folder(output, overwrite=options.overwrite) as folder:
        if options.format == "nerf":
            figures["cameras"] = write_transforms(folder, views, products.credit(), exr=options.exr)
        else:
            surface = products.source_mesh().surface if products.objects is not None else None
            if surface is None and products.object_file is not None:
                surface = objectfolder.load(products.object_file).surface
            figures["points"] = write_colmap(
                folder,
                views,
                products.credit(),
                surface,
                points=options.points,
                seed=options.seed,
                exr=options.exr,
            )
        figures["frame"] = views.described_frame()
        products.write_manifest(folder, options.format, figures)
    extra = f", {figures['points']} points" if "points" in figures else ""
    size = f"{views.size[1]} x {views.size[0]} pixels ({held_out} held out)"
    return figures, f"{counted(len(views), 'view')} of {size}{extra}, {views.frame} frame"


def _write_gltf(products: ObjectProducts, options: Exporting, output: Path) -> tuple[dict[str, Any], str]:
    surface = options.surface or ("stored" if products.object_file is not None else "source")
    appearance, credit = appearance_of(products, options), products.credit()
    name = f"{products.object_id}.glb"
    if surface == "source" and options.vertex_colours:
        raise InputError("--vertex-colours", "the source mesh has its own textures", "Leave one of them out.")
    with new_folder(output, overwrite=options.overwrite) as folder:
        if surface == "source":
            mesh = write_mesh(folder / name, products.source_mesh(), appearance, credit)
        else:
            colours, colour_of, colour, finest_m = stored_colours(products, options, appearance)
            mesh = write_surface(
                folder / name,
                colours,
                colour_of,
                appearance,
                credit,
                colour=colour,
                side=options.texture_side,
                finest_m=finest_m,
                vertex_colours=options.vertex_colours,
            )
        figures = {"surface": surface, "file": name, **mesh}
        products.write_manifest(folder, options.format, figures)
    pitch = f", a texel each {mesh['texel_pitch_m'] * 1e3:.3g} mm" if "texel_pitch_m" in mesh else ""
    size = f"{mesh['bytes'] / 1e6:.2f} MB"
    return figures, f"{name}, {mesh['triangles']} triangles of the {surface} surface{pitch}, {size}"


def stored_colours(
    products: ObjectProducts, options: Exporting, appearance: Appearance
) -> tuple[Surface, ColourOf, str, float]:
    """Return the stored surface, its colours, a description of them, and the sufficient texel pitch (m)."""
    if products.object_file is None:
        remedy = "Give one, or --surface source."
        raise InputError(products.object_id, "has no Object File, so no stored surface", remedy)
    file = objectfolder.load(products.object_file)
    surface = file.surface
    if (options.colour or ("network" if products.objects is None else "source")) == "source":
        mesh = products.source_mesh()
        return (
            surface,
            lambda face, at: nearest_texture_colour(
                mesh, surface.points_at(face, at), surface.face_normals[face]
            ),
            "the source's texture at the nearest point",
            0.0,
        )
    sight, words = (
        file.description["vision"],
        "VisionNet's reflectance along the normal, without the clear coat",
    )
    # A quarter of a cell of the network's grid: between, its colours are nearly linear.
    finest = sight["maps"]["albedo"]["pitch"] if file.vision.computed else 0.25 / sight["grid_resolution"]
    return (
        surface,
        lambda face, at: network_colour(file.vision, surface, file.frame, face, at, appearance.metallic),
        "the albedo that the file states" if file.vision.computed else words,
        file.frame.scale * finest,
    )


def appearance_of(products: ObjectProducts, options: Exporting) -> Appearance:
    """Return roughness and metallic from the options, else the views, else the materials table."""
    appearance: dict[str, Any] = {}
    if products.views is not None:
        appearance = dict(read_attributes(products.views)["appearance"])
    elif products.record is not None:
        appearance = dict(products.record["appearance"])
    elif products.object_file is not None:
        material = json.loads(read_metadata(products.object_file)["material"])
        row = find_material(read_materials(options.materials), material["name"], str(options.materials))
        appearance = {"roughness": row.roughness, "metallic": row.metallic}
    overrides = {"roughness": options.roughness, "metallic": options.metallic}
    appearance |= {name: value for name, value in overrides.items() if value is not None}
    for name in overrides:
        if name not in appearance:
            raise InputError(products.object_id, f"its {name} is not known", f"Give --{name}.")
    return Appearance(**appearance)
