"""Objects for simulators: an asset each, and scenes of them."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import objectfolder
from objectfolder.audio.materials import find_material, read_materials
from objectfolder.errors import InputError
from objectfolder.object_file.object_file import ObjectFile
from objectfolder.products.store import read_product
from objectfolder.products.tensor_file import read_metadata
from objectfolder.simulators.asset import Asset, Contact, RigidBody
from objectfolder.simulators.collision import ConvexParts, convex_parts
from objectfolder.simulators.formats import FORMATS, write_asset
from objectfolder.simulators.parts_product import parts_of
from objectfolder.simulators.scene import format_of_scene, write_scene
from objectfolder.simulators.stable_poses import lay_out
from objectfolder.vision.export.files import new_folder
from objectfolder.vision.export.gltf import Part
from objectfolder.vision.export.textured_surface import baked_part, mesh_parts
from pipeline.dataset.product_kinds import OBJECT_FILES
from pipeline.publish.export.exports import appearance_of, stored_colours
from pipeline.publish.export.found_products import FoundProducts, find_products
from pipeline.publish.export.summaries import ExportSummary, SceneSummary
from pipeline.publish.queries.requests import Exporting

ALL_FORMATS = tuple(FORMATS)
DENSEST_KG_M3 = 22_600.0  # osmium


def write_assets(
    names: Sequence[str], root: Path, wanted: Exporting, output: Path
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
        found = find_products(name, root)
        folder = output / found.object_id if len(names) > 1 else output
        formats = ALL_FORMATS if wanted.format == "all" else (wanted.format,)
        described = _write(found, _asset(found, wanted), wanted, folder, formats)
        collision = described["collision"]
        words = (
            f"{described['mass_kg']:.4g} kg, {collision['parts']} convex parts, "
            f"union {collision['union_iou']:.3f} of the solid, at most {collision['outward_m'] * 1e3:.2f} mm "
            "outside"
        )
        yield ExportSummary(
            folder=str(folder), licence=found.credit().licence, figures=described, words=words
        )


def compose_scene(
    names: Sequence[str], root: Path, wanted: Exporting, output: Path, *, table_m: float, height_m: float
) -> SceneSummary:
    """Write a scene file, and the asset of each object in a folder beside it."""
    kind = format_of_scene(output)
    found = {name: find_products(name, root) for name in names}
    assets = {name: _asset(one, wanted) for name, one in found.items()}
    ids = [asset.name for asset in assets.values()]
    if len(set(ids)) < len(ids):
        raise InputError(
            str(output), f"two of its objects are called {max(ids, key=ids.count)}", "Rename one."
        )
    laid = [assets[name] for name in names]
    poses = lay_out(laid, table_m, height_m=height_m, seed=wanted.seed)
    for name, asset in assets.items():
        _write(found[name], asset, wanted, output.parent / asset.name, (kind,))
    write_scene(output, [asset.name for asset in laid], poses, table_m, height_m=height_m)
    objects = tuple(asset.name for asset in laid)
    return SceneSummary(file=str(output), objects=objects, table_m=table_m)


def all_objects(root: Path) -> tuple[str, ...]:
    """Return the ids of all Object Files of a data set."""
    ids = tuple(OBJECT_FILES.object_ids(root))
    if not ids:
        raise InputError(str(root), "has no Object Files", "Run `dvc repro` there, or name objects.")
    return ids


def _write(
    found: FoundProducts, asset: Asset, wanted: Exporting, folder: Path, formats: tuple[str, ...]
) -> dict[str, Any]:
    """Write the folder of an asset with its Object File; return its description."""
    assert found.object_file is not None
    stored = found.object_file.read_bytes()
    provenance = json.loads(read_metadata(found.object_file).get("provenance", "null"))
    with new_folder(folder, overwrite=wanted.overwrite) as new:
        described = write_asset(new, asset, formats)
        (new / f"{found.object_id}{OBJECT_FILES.suffix}").write_bytes(stored)
        found.write_manifest(new, wanted.format, {**described, "provenance": provenance})
    return described


def _asset(found: FoundProducts, wanted: Exporting) -> Asset:
    if found.object_file is None:
        raise InputError(
            found.object_id, "has no Object File, which has its mass and inertia", "Make or name one."
        )
    file = objectfolder.load(found.object_file)
    (body, mass_of), contact = _body(file, found, wanted), _contact(file, wanted)
    collision = _collision(file, found, wanted)
    appearance = appearance_of(found, wanted)
    if found.objects is not None and wanted.surface != "stored":
        visual: list[Part] = mesh_parts(found.source_mesh(), appearance)
    else:
        surface, colour_of, _, finest_m = stored_colours(found, wanted, appearance)
        visual = [baked_part(surface, colour_of, wanted.texture_side, finest_m)[0]]
    credit = found.credit()
    return Asset(found.object_id, visual, file.surface, appearance, collision, body, mass_of, contact, credit)


def _collision(file: ObjectFile, found: FoundProducts, wanted: Exporting) -> ConvexParts:
    """Return the convex parts of the data set, or those of the Object File where it has none or asked so."""
    given = {"threshold_m": wanted.threshold_m, "most_parts": wanted.most_parts}
    asked: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if found.collision is not None and not asked:
        return parts_of(read_product(found.collision), found.object_id)
    return convex_parts(file.surface, **asked, seed=wanted.seed, name=found.object_id)


def _body(file: ObjectFile, found: FoundProducts, wanted: Exporting) -> tuple[RigidBody, str]:
    """Return the body, and whose its mass is."""
    stated = file.description["body"] or {}
    solid, whose = ("", "solid") if stated.get("mass_kg") is not None else ("filled_", "solid that sounds")
    if stated.get(f"{solid}inertia_kg_m2") is None:
        finding = "its surface is open or torn and it has no sound, so its mass and inertia are not known"
        raise InputError(found.object_id, finding, "Mend the mesh, and make the object again.")
    values = (stated[f"{solid}{name}"] for name in ("mass_kg", "centre_of_mass_m", "inertia_kg_m2"))
    mass_kg, centre_m, inertia = values
    body = RigidBody(mass_kg, np.array(centre_m), np.array(inertia))
    if wanted.mass_kg is not None:
        volume_m3 = body.mass_kg / file.description["material"]["density_kg_m3"]
        if not wanted.mass_kg <= volume_m3 * DENSEST_KG_M3:
            finding = f"a mass of {wanted.mass_kg:g} kg in {volume_m3 * 1e6:.4g} cm3 is denser than any solid"
            raise InputError(found.object_id, finding, "Give --mass in kilograms.")
        return body.of_mass(wanted.mass_kg), "given"
    measured_kg = (file.description["object"] or {}).get("mass_kg")
    return (body, whose) if measured_kg is None else (body.of_mass(measured_kg), "measured")


def _contact(file: ObjectFile, wanted: Exporting) -> Contact:
    name = file.description["material"]["name"]
    material = find_material(read_materials(wanted.materials), name, str(wanted.materials))
    friction = material.friction if wanted.friction is None else wanted.friction
    restitution = material.restitution if wanted.restitution is None else wanted.restitution
    if friction is None or restitution is None:
        absent = "friction" if friction is None else "restitution"
        raise InputError(
            str(wanted.materials), f"{material.name} has no {absent}", f"Fill the column, or give --{absent}."
        )
    return Contact(friction, restitution)
