"""The command `export`: views as NeRF or COLMAP data, surfaces as textured glTF."""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from objectfolder.errors import InputError
from pipeline.cli.build import REPOSITORY

if TYPE_CHECKING:
    from objectfolder.geometry.mesh import TexturedMesh
    from objectfolder.geometry.surface import Surface
    from objectfolder.vision.appearance import Appearance
    from objectfolder.vision.export.credit import Credit
    from objectfolder.vision.export.textured_surface import ColourOf

FORMATS = ("nerf", "colmap", "gltf")
VIEWS_SUFFIX = ".zarr.zip"
OBJECT_FILE_SUFFIX = ".safetensors"


@dataclass(frozen=True)
class Found:
    """Where the products of one object lie; None for what is not there."""

    object_id: str
    views: Path | None = None
    object_file: Path | None = None
    objects: Path | None = None
    mesh: Path | None = None
    record: Mapping[str, Any] | None = field(default=None)


def add_commands(commands: Any) -> None:
    """Add the command of this module to a parser's sub-commands."""
    text = "write views as NeRF or COLMAP data, or a surface as textured glTF"
    command = commands.add_parser("export", help=text, description=text)
    command.add_argument(
        "object",
        metavar="OBJECT",
        help="an id of the data set, a product of views or objects (.zarr.zip), an Object File "
        "(.safetensors), or, for glTF, a mesh in metres",
    )
    command.add_argument("--format", required=True, choices=FORMATS, help="what to write")
    command.add_argument(
        "-o", "--output", required=True, metavar="FOLDER", help="a folder that is not there yet"
    )
    command.add_argument("--root", default=".", help="folder of the data set (default: this one)")
    command.add_argument("--overwrite", action="store_true", help="replace an earlier export")
    command.add_argument(
        "--frame",
        choices=("unit", "object"),
        default="unit",
        help="nerf, colmap: longest side 1 and centred (default), or metres",
    )
    command.add_argument("--exr", action="store_true", help="nerf, colmap: scene-linear OpenEXR images, too")
    command.add_argument(
        "--points", type=int, default=5000, help="colmap: surface points to draw (default 5000)"
    )
    command.add_argument("--seed", type=int, default=0, help="colmap: seed of the points (default 0)")
    command.add_argument(
        "--surface",
        choices=("stored", "source"),
        help="gltf: the compressed surface of the Object File, or the source mesh (default: what there is, "
        "the stored one first)",
    )
    command.add_argument(
        "--colour",
        choices=("network", "source"),
        help="gltf, stored surface: what VisionNet learned, or the source's texture (default where there "
        "is one)",
    )
    command.add_argument("--texture-side", type=int, default=1024, help="gltf: texels a side (default 1024)")
    command.add_argument(
        "--vertex-colours", action="store_true", help="gltf, stored surface: no texture, a colour a corner"
    )
    command.add_argument("--roughness", type=float, help="gltf: in place of the material's")
    command.add_argument("--metallic", type=float, help="gltf: in place of the material's")
    command.add_argument(
        "--materials", default=str(REPOSITORY / "data" / "materials.csv"), help="materials table (CSV)"
    )
    command.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    """Export one object; print what was written."""
    found = find(options.object, Path(options.root))
    if options.format == "gltf":
        _export_gltf(found, options)
    else:
        _export_views(found, options)


def find(name: str, root: Path) -> Found:
    """Find the products of an object named by its id or by the path of one of them.

    Beside a product of a data set its other products are found, too.

    Raises
    ------
    InputError
        Nothing of that name.
    """
    from pipeline.dataset.stages import OBJECT_FILES, OBJECTS, VIEWS

    path = Path(name)
    named: dict[str, Any] = {}
    object_id = name
    if path.is_file():
        object_id = path.name.removesuffix(VIEWS_SUFFIX).removesuffix(OBJECT_FILE_SUFFIX)
        kind = _kind(path)
        named[kind] = path
        if kind == "mesh":
            return Found(path.stem, mesh=path)
        if path.parent.name not in (VIEWS.name, OBJECTS.name, OBJECT_FILES.name):
            return Found(object_id, **named)
        root = path.resolve().parents[2]
    elif path.suffix or path.parent != Path("."):
        raise InputError(name, "no such file", "Check the path.")
    kinds = {"views": VIEWS, "object_file": OBJECT_FILES, "objects": OBJECTS}
    for key, kind_of in kinds.items():
        beside = kind_of.path(root, object_id)
        if key not in named and beside.is_file():
            named[key] = beside
    if not named:
        known = VIEWS.object_ids(root)
        raise InputError(
            object_id,
            f"no product of it in {root / 'data'}",
            f"Use one of {', '.join(known)}."
            if known
            else "Give the data set's folder by --root, or a path.",
        )
    return Found(object_id, **named, record=_record(root, object_id))


def _kind(path: Path) -> str:
    """Return what a file is: the attributes of a product tell."""
    from objectfolder.store import read_attributes

    if path.name.endswith(OBJECT_FILE_SUFFIX):
        return "object_file"
    if not path.name.endswith(VIEWS_SUFFIX):
        return "mesh"
    attributes = read_attributes(path)
    if "camera_radius" in attributes and "light_power_w" in attributes:
        return "views"
    if "digests" in attributes:
        return "objects"
    raise InputError(str(path), "is a product of neither views nor objects", "Give one of those.")


def _record(root: Path, object_id: str) -> Mapping[str, Any] | None:
    from pipeline.dataset.records import RECORDS, read_records

    if not (root / RECORDS).is_file():
        return None
    return read_records(root).rows.get(object_id)


def _credit(found: Found) -> "Credit":
    """Return the credit of an object from the data set's records, else from its Object File."""
    import json

    from objectfolder.tensor_file import read_metadata
    from objectfolder.vision.export.credit import Credit

    record = found.record
    if record is None and found.object_file is not None:
        record = json.loads(read_metadata(found.object_file).get("object", "null"))
    return Credit.of_record(found.object_id, record)


def _export_views(found: Found, options: argparse.Namespace) -> None:
    from objectfolder.store import read_product
    from objectfolder.vision.export.colmap_views import write_colmap
    from objectfolder.vision.export.folder import new_folder
    from objectfolder.vision.export.posed_views import PosedViews
    from objectfolder.vision.export.transforms import write_transforms

    if found.views is None:
        raise InputError(
            found.object_id, f"has no views, and {options.format} is made of them",
            "Name a product of views, or run the stage `views`; glTF needs none.",
        )  # fmt: skip
    views = PosedViews.of_product(read_product(found.views), options.frame, str(found.views))
    credit = _credit(found)
    with new_folder(options.output, overwrite=options.overwrite) as folder:
        if options.format == "nerf":
            written: dict[str, Any] = {"cameras": write_transforms(folder, views, credit, exr=options.exr)}
        else:
            surface = _rendered_surface(found)
            written = {
                "points": write_colmap(
                    folder, views, credit, surface, points=options.points, seed=options.seed, exr=options.exr
                )
            }
        described = {"views": len(views), "held_out": int(views.held_out.sum()), "pixels": list(views.size)}
        _finish(folder, options, credit, {**described, **written, "frame": views.described_frame()})
    extra = f", {written['points']} points" if "points" in written else ""
    print(
        f"{options.output}: {len(views)} views of {views.size[1]} x {views.size[0]} pixels "
        f"({described['held_out']} held out){extra}, {views.frame} frame; {credit.licence}"
    )


def _rendered_surface(found: Found) -> "Surface | None":
    """Return the surface that the views show: the mesh that was rendered, else its stored form."""
    import objectfolder

    if found.objects is not None:
        return _source_mesh(found).surface
    return None if found.object_file is None else objectfolder.load(found.object_file).surface


def _export_gltf(found: Found, options: argparse.Namespace) -> None:
    from objectfolder.vision.export.folder import new_folder
    from objectfolder.vision.export.textured_surface import write_mesh, write_surface

    surface = options.surface or ("stored" if found.object_file is not None else "source")
    appearance, credit = _appearance(found, options), _credit(found)
    name = f"{found.object_id}.glb"
    if surface == "source" and options.vertex_colours:
        raise InputError("--vertex-colours", "the source mesh has its own textures", "Leave one of them out.")
    with new_folder(options.output, overwrite=options.overwrite) as folder:
        if surface == "source":
            written = write_mesh(folder / name, _source_mesh(found), appearance, credit)
        else:
            stored, colour_of, colour, finest = _stored_colours(found, options, appearance)
            written = write_surface(
                folder / name,
                stored,
                colour_of,
                appearance,
                credit,
                colour=colour,
                side=options.texture_side,
                finest_m=finest,
                vertex_colours=options.vertex_colours,
            )
        _finish(folder, options, credit, {"surface": surface, "file": name, **written})
    pitch = f", a texel each {written['texel_pitch_m'] * 1e3:.3g} mm" if "texel_pitch_m" in written else ""
    print(
        f"{Path(options.output) / name}: {written['triangles']} triangles of the {surface} surface{pitch}, "
        f"{written['bytes'] / 1e6:.2f} MB; {credit.licence}"
    )


def _stored_colours(
    found: Found, options: argparse.Namespace, appearance: "Appearance"
) -> "tuple[Surface, ColourOf, str, float]":
    """Return the stored surface, its colours, these in words, and the texel pitch that suffices (metres)."""
    import objectfolder
    from objectfolder.vision.export.base_colour import nearest_texture_colour, network_colour

    if found.object_file is None:
        raise InputError(
            found.object_id, "has no Object File, so no stored surface", "Give one, or --surface source."
        )
    file = objectfolder.load(found.object_file)
    surface = file.surface
    if (options.colour or ("network" if found.objects is None else "source")) == "source":
        mesh = _source_mesh(found)
        return (
            surface,
            lambda face, at: nearest_texture_colour(
                mesh, surface.points_at(face, at), surface.face_normals[face]
            ),
            "the source's texture at the nearest point",
            0.0,
        )
    # A quarter of a cell of the network's grid: between, its colours are nearly linear.
    finest = file.frame.scale / file.description["vision"]["grid_resolution"] / 4
    return (
        surface,
        lambda face, at: network_colour(file.vision, surface, file.frame, face, at, appearance.metallic),
        "VisionNet's reflectance along the normal, without the clear coat",
        finest,
    )


def _source_mesh(found: Found) -> "TexturedMesh":
    from objectfolder.geometry.clean import clean
    from objectfolder.geometry.load import load_mesh
    from objectfolder.geometry.mesh_product import textured_mesh_of
    from objectfolder.store import read_product

    if found.objects is not None:
        return textured_mesh_of(read_product(found.objects))
    if found.mesh is not None:
        return clean(load_mesh(found.mesh), str(found.mesh))[0]
    raise InputError(
        found.object_id, "its source mesh is not at hand",
        "Name it by id with --root, or give a product of objects; or export the stored surface.",
    )  # fmt: skip


def _appearance(found: Found, options: argparse.Namespace) -> "Appearance":
    """Return roughness and metallic as asked, as rendered, or as the materials table has them."""
    import json

    from objectfolder.audio.materials import find_material, read_materials
    from objectfolder.store import read_attributes
    from objectfolder.tensor_file import read_metadata
    from objectfolder.vision.appearance import Appearance

    known: dict[str, Any] = {}
    if found.views is not None:
        known = dict(read_attributes(found.views)["appearance"])
    elif found.record is not None:
        known = dict(found.record["appearance"])
    elif found.object_file is not None:
        material = json.loads(read_metadata(found.object_file)["material"])
        row = find_material(read_materials(Path(options.materials)), material["name"], options.materials)
        known = {"roughness": row.roughness, "metallic": row.metallic}
    for name in ("roughness", "metallic"):
        if getattr(options, name) is not None:
            known[name] = getattr(options, name)
        if name not in known:
            raise InputError(found.object_id, f"its {name} is not known", f"Give --{name}.")
    return Appearance(**known)


def _finish(
    folder: Path, options: argparse.Namespace, credit: "Credit", described: Mapping[str, Any]
) -> None:
    """Write the manifest and the attribution."""
    from objectfolder.vision.export.folder import MANIFEST, write_json

    write_json(folder / MANIFEST, {"format": options.format, "object": credit.to_dict(), **described})
    (folder / "ATTRIBUTION.txt").write_text(credit.to_text(), encoding="utf-8")
