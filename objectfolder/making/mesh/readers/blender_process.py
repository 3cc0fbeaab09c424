"""Child process: ``-m objectfolder.making.mesh.readers.blender_process IN OUT`` reads a mesh with Blender.

A process of its own because Blender is native code that keeps its state and can crash. IN is an FBX, USD or
.blend file; OUT is a folder that gets `mesh.glb`, with z up, and `read.json`: the version of Blender, metres
in a unit, the files that IN refers to, and sentences about what is left out.
"""

import json
import os
import sys
from pathlib import Path
from typing import Any

from objectfolder.child_process import end_with, limit_cpu_time

TIME_LIMIT_S = 600
_SHADERS = {"BSDF_PRINCIPLED", "EMISSION", "BACKGROUND"}
_COLOURS = ("Base Color", "Color")
_CARRIED = {
    "TEX_IMAGE", "RGB", "VALUE", "VERTEX_COLOR", "ATTRIBUTE", "MIX", "MIX_RGB", "REROUTE", "UVMAP", "MAPPING",
    "TEX_COORD", "COMBINE_COLOR", "SEPARATE_COLOR", "GROUP_INPUT",
}  # fmt: skip
"""Nodes before a base colour that Blender writes to glTF: others are left out by it in silence."""


def main(source: Path, folder: Path) -> None:
    """Import, leave out what lies outside of the folder of `source`, export."""
    import bpy

    limit_cpu_time(TIME_LIMIT_S)
    if source.suffix.lower() == ".blend":
        bpy.ops.wm.open_mainfile(filepath=str(source), load_ui=False, use_scripts=False)
    else:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        if source.suffix.lower() == ".fbx":
            bpy.ops.wm.fbx_import(filepath=str(source), use_anim=False)
        else:
            packed = "IMPORT_PACK" if source.suffix.lower() == ".usdz" else "IMPORT_NONE"
            bpy.ops.wm.usd_import(filepath=str(source), import_textures_mode=packed, set_frame_range=False)
    files, remarks = _images(source)
    remarks += _lost_colours()
    scale = bpy.context.scene.unit_settings.scale_length
    bpy.ops.export_scene.gltf(
        filepath=str(folder / "mesh.glb"),
        export_yup=False,
        export_apply=True,
        use_visible=True,
        export_animations=False,
        export_skins=False,
        export_morph=False,
    )
    record = {"version": bpy.app.version_string, "files": files, "remarks": remarks, "metres": scale}
    (folder / "read.json").write_text(json.dumps(record))


def _images(source: Path) -> tuple[list[str], list[str]]:
    """Files of pictures in the folder of the mesh, and sentences about those that are not there."""
    import bpy

    inside, files, remarks = source.parent.resolve(), [], []
    for image in list(bpy.data.images):
        if image.source != "FILE" or image.packed_file is not None or not image.filepath:
            continue
        path = Path(bpy.path.abspath(image.filepath))
        if path.is_file() and path.resolve().is_relative_to(inside):
            files.append(str(path))
            continue
        beside = inside / path.name
        if beside.is_file():
            image.filepath = str(beside)
            files.append(str(beside))
            continue
        remarks.append(f"the picture {path.name[:80]!r} is not in the folder of the mesh and is left out")
        bpy.data.images.remove(image)
    return files, remarks


def _lost_colours() -> list[str]:
    """Sentences about materials whose colour glTF cannot carry: another shader, or a computed colour."""
    import bpy

    used = {slot.material for item in bpy.data.objects for slot in item.material_slots if slot.material}
    remarks = []
    for material in sorted(used, key=lambda material: str(material.name)):
        if kinds := sorted(_foreign_nodes(material.node_tree)):
            remarks.append(
                f"the colour of material {str(material.name)[:80]!r} is computed by nodes that are not read "
                f"({', '.join(kinds)[:120]}): bake it into a picture"
            )
    return remarks


def _foreign_nodes(tree: Any) -> set[str]:
    """Kinds of nodes, upstream of a material's base colour, that are no constant, picture or attribute."""
    output = tree.get_output_node("ALL") if tree is not None else None
    links = output.inputs["Surface"].links if output is not None else ()
    if not links:
        return set()
    shader = links[0].from_node
    if shader.type not in _SHADERS:
        return {shader.bl_label}
    foreign = set()
    pending = [
        link.from_node for name in _COLOURS if name in shader.inputs for link in shader.inputs[name].links
    ]
    visited = set(pending)
    while pending:
        node = pending.pop()
        flat = node.type != "TEX_IMAGE" or (
            node.projection == "FLAT" and node.image is not None and node.image.source != "TILED"
        )
        if (
            node.type not in _CARRIED
            or not flat
            or (node.type == "TEX_COORD" and not node.outputs["UV"].is_linked)
        ):
            foreign.add(node.bl_label)
        upstream = {link.from_node for socket in node.inputs for link in socket.links} - visited
        visited |= upstream
        pending += upstream
    return foreign


if __name__ == "__main__":
    end_with(os.getppid())
    main(Path(sys.argv[1]), Path(sys.argv[2]))
