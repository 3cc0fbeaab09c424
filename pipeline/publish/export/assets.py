"""Objects for simulators: an asset each, and scenes of them."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import objectfolder
from objectfolder.errors import InputError
from objectfolder.export.files import new_folder
from objectfolder.export.gltf import Part
from objectfolder.export.textured_surface import baked_part, mesh_parts
from objectfolder.making.materials import find_material, read_materials
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import read_product
from objectfolder.products.tensor_file import read_metadata
from objectfolder.simulators.asset import Asset, Contact, RigidBody
from objectfolder.simulators.collision import convex_parts
from objectfolder.simulators.formats import FORMATS, write_asset
from objectfolder.simulators.parts_product import parts_of
from objectfolder.surface.convex_parts import ConvexParts
from pipeline.dataset.product_kinds import OBJECT_FILES
from pipeline.publish.export.exports import appearance_of, stored_colours
from pipeline.publish.export.object_products import ObjectProducts, find_products
from pipeline.publish.export.summaries import ExportSummary, SceneSummary
from pipeline.publish.queries.requests import Exporting
from pipeline.publish.scenes.scene import format_of_scene, write_scene
from pipeline.publish.scenes.stable_poses import lay_out, table_side

ALL_FORMATS = tuple(FORMATS)
DENSEST_KG_M3 = 22_600.0  # osmium


def write_assets(
    names: Sequence[str], root: Path, options: Exporting, output: Path
) -> Iterator[ExportSummary]:
    """Write each object as an asset, into `output`, or where there are several into a folder each there.

    Yields
    ------
    ExportSummary
        One for each object, when it is written.

    Raises
    ------
    InputError
        What is asked for is not there, cannot be written, or is no rigid body.
    """
    for name in names:
        products = find_products(name, root)
        folder = output / products.object_id if len(names) > 1 else output
        formats = ALL_FORMATS if options.format == "all" else (options.format,)
        summary = _write(products, _asset(products, options), options, folder, formats)
        collision = summary["collision"]
        words = (
            f"{summary['mass_kg']:.4g} kg, {collision['parts']} convex parts, "
            f"union {collision['union_iou']:.3f} of the solid, at most {collision['outward_m'] * 1e3:.2f} mm "
            "outside"
        )
        yield ExportSummary(
            folder=str(folder), licence=products.credit().licence, figures=summary, words=words
        )


def compose_scene(
    names: Sequence[str],
    root: Path,
    options: Exporting,
    output: Path,
    *,
    table_m: float | None,
    height_m: float,
    upright: bool = False,
    looks: bool = True,
) -> SceneSummary:
    """Write a scene file, and the asset of each object in a folder beside it.

    Without a `table_m` objects stand close together, and the table is as large as they need. Without
    `looks` assets have nothing that is seen: what plays the scene draws Object Files.
    """
    kind = format_of_scene(output)
    products = {name: find_products(name, root) for name in names}
    assets = {name: _asset(product, options, looks) for name, product in products.items()}
    ids = [asset.name for asset in assets.values()]
    if len(set(ids)) < len(ids):
        raise InputError(
            str(output), f"two of its objects are called {max(ids, key=ids.count)}", "Rename one."
        )
    row = [assets[name] for name in names]
    poses = lay_out(row, table_m, height_m=height_m, seed=options.seed, upright=upright)
    side_m = table_side(row, poses) if table_m is None else table_m
    for name, asset in assets.items():
        _write(products[name], asset, options, output.parent / asset.name, (kind,))
    write_scene(output, [asset.name for asset in row], poses, side_m, height_m=height_m)
    objects = tuple(asset.name for asset in row)
    return SceneSummary(file=str(output), objects=objects, table_m=side_m)


def all_objects(root: Path) -> tuple[str, ...]:
    """Return the ids of all Object Files of a data set."""
    ids = tuple(OBJECT_FILES.object_ids(root))
    if not ids:
        raise InputError(str(root), "has no Object Files", "Run `dvc repro` there, or name objects.")
    return ids


def _write(
    products: ObjectProducts, asset: Asset, options: Exporting, folder: Path, formats: tuple[str, ...]
) -> dict[str, Any]:
    """Write the folder of an asset with its Object File; return its description."""
    assert products.object_file is not None
    content = products.object_file.read_bytes()
    provenance = json.loads(read_metadata(products.object_file).get("provenance", "null"))
    with new_folder(folder, overwrite=options.overwrite) as new:
        summary = write_asset(new, asset, formats)
        (new / f"{products.object_id}{OBJECT_FILES.suffix}").write_bytes(content)
        products.write_manifest(new, options.format, {**summary, "provenance": provenance})
    return summary


def _asset(products: ObjectProducts, options: Exporting, looks: bool = True) -> Asset:
    if products.object_file is None:
        raise InputError(
            products.object_id, "has no Object File, which has its mass and inertia", "Make or name one."
        )
    file = objectfolder.load(products.object_file)
    (body, mass_of), contact = _body(file, products, options), _contact(file, options)
    collision = _collision(file, products, options)
    appearance = appearance_of(products, options)
    visual: list[Part] = []
    if looks and products.objects is not None and options.surface != "stored":
        visual = mesh_parts(products.source_mesh(), appearance)
    elif looks:
        surface, colour_of, _, finest_m = stored_colours(products, options, appearance)
        visual = [baked_part(surface, colour_of, options.texture_side, finest_m)[0]]
    credit = products.credit()
    return Asset(
        products.object_id, visual, file.surface, appearance, collision, body, mass_of, contact, credit
    )


def _collision(file: ObjectFile, products: ObjectProducts, options: Exporting) -> ConvexParts:
    """Return the convex parts of the data set or the Object File; new ones where asked, or where none are."""
    limits = {"threshold_m": options.threshold_m, "most_parts": options.most_parts}
    numbers: dict[str, Any] = {name: value for name, value in limits.items() if value is not None}
    if products.collision is not None and not numbers:
        return parts_of(read_product(products.collision), products.object_id)
    if file.collision is not None and not numbers:
        return file.collision
    return convex_parts(file.surface, **numbers, seed=options.seed, name=products.object_id)


def _body(file: ObjectFile, products: ObjectProducts, options: Exporting) -> tuple[RigidBody, str]:
    """Return the body, and whose its mass is."""
    numbers = file.description["body"] or {}
    solid, whose = ("", "solid") if numbers.get("mass_kg") is not None else ("filled_", "solid that sounds")
    if numbers.get(f"{solid}inertia_kg_m2") is None:
        finding = "its surface is open or torn and it has no sound, so its mass and inertia are not known"
        raise InputError(products.object_id, finding, "Mend the mesh, and make the object again.")
    values = (numbers[f"{solid}{name}"] for name in ("mass_kg", "centre_of_mass_m", "inertia_kg_m2"))
    mass_kg, centre_m, inertia = values
    body = RigidBody(mass_kg, np.array(centre_m), np.array(inertia))
    if options.mass_kg is not None:
        volume_m3 = body.mass_kg / file.description["material"]["density_kg_m3"]
        if not options.mass_kg <= volume_m3 * DENSEST_KG_M3:
            finding = (
                f"a mass of {options.mass_kg:g} kg in {volume_m3 * 1e6:.4g} cm3 is denser than any solid"
            )
            raise InputError(products.object_id, finding, "Give --mass in kilograms.")
        return body.of_mass(options.mass_kg), "given"
    measured_kg = (file.description["object"] or {}).get("mass_kg")
    return (body, whose) if measured_kg is None else (body.of_mass(measured_kg), "measured")


def _contact(file: ObjectFile, options: Exporting) -> Contact:
    name = file.description["material"]["name"]
    material = find_material(read_materials(options.materials), name, str(options.materials))
    friction = material.friction if options.friction is None else options.friction
    restitution = material.restitution if options.restitution is None else options.restitution
    if friction is None or restitution is None:
        absent = "friction" if friction is None else "restitution"
        raise InputError(
            str(options.materials),
            f"{material.name} has no {absent}",
            f"Fill the column, or give --{absent}.",
        )
    return Contact(friction, restitution)
