"""Base colours of glTF files as Blender shows them under white light from everywhere."""

import json
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hard_checks import colours_at
from hard_meshes import OBJ_SIDES, GltfWriter, write_gltf_box
from PIL import Image
from test_hard_gltf import (
    colours_of_vertices,
    compressed,
    glossy,
    meshopt_with_fallback,
    moved_texture,
    second_set,
    webp,
)

from objectfolder.making.mesh.readers.load import load_mesh

WIDTH, HEIGHT = 18, 14
"""Pixels of the side of the box that is seen; no middle of one lies on a border of colours."""

BLENDER = """
import bpy, json, sys
for path, image in json.loads(sys.argv[1]):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path)
    for material in bpy.data.materials:
        for node in material.node_tree.nodes:
            if node.type == "BSDF_PRINCIPLED" and material.name != "shiny":
                node.inputs["Specular IOR Level"].default_value = 0  # a dielectric scatters all light
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("white")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", {side}
    camera.location, camera.rotation_euler = (0, -1, 0), (1.5707963267948966, 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.max_bounces = 64, False, 4
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "GAUSSIAN", 0.01
    scene.render.resolution_x, scene.render.resolution_y = {width}, {height}
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = image
    bpy.ops.render.render(write_still=True)
"""


def plain(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    """The picture alone."""


def tinted(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    writer.header["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 0.25, 1, 1]


def uniform(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    parts = {"baseColorFactor": [0.8, 0.1, 0.02, 1], "metallicFactor": 0}
    writer.header["materials"][0] = {"pbrMetallicRoughness": parts}


def metal(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    writer.header["materials"][0]["pbrMetallicRoughness"] |= {"metallicFactor": 1, "roughnessFactor": 0}


def glossy_metal(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    """Nothing scattered, and gold reflected, by specular and glossiness."""
    said = {"diffuseFactor": [0, 0, 0, 1], "specularFactor": [1, 0.55, 0.1], "glossinessFactor": 1}
    material = {"name": "shiny", "extensions": {"KHR_materials_pbrSpecularGlossiness": said}}
    writer.header["materials"][0] = material
    writer.needs("KHR_materials_pbrSpecularGlossiness", used_only=True)


def whole_numbers(writer: GltfWriter, primitive: dict[str, Any]) -> None:
    """Colours of vertices as bytes."""
    rows = np.tile(np.array([[200, 60, 9, 255]], dtype="u1"), (24, 1))
    primitive["attributes"]["COLOR_0"] = writer.accessor(rows, normalized=True)
    writer.header["materials"][0] = {"pbrMetallicRoughness": {}}


KINDS = (
    plain, tinted, uniform, metal, colours_of_vertices, whole_numbers, moved_texture, second_set,
    glossy, glossy_metal, compressed, meshopt_with_fallback, webp,
)  # fmt: skip


def dielectric(change: Callable[..., None]) -> Callable[..., None]:
    """A change of a box that is no metal, which glTF takes for granted."""

    def changed(writer: GltfWriter, primitive: dict[str, Any]) -> None:
        writer.header["materials"][0]["pbrMetallicRoughness"]["metallicFactor"] = 0
        change(writer, primitive)
        parts = writer.header["materials"][0].get("pbrMetallicRoughness")
        if parts is not None and change is not metal:
            parts["metallicFactor"] = 0

    return changed


@pytest.mark.release("objectfolder.making.mesh")
def test_base_colours_are_those_of_a_render_under_white_light(tmp_path, subtests):
    jobs = []
    for kind in KINDS:
        path = write_gltf_box(tmp_path / f"{kind.__name__}.glb", dielectric(kind))
        jobs.append((str(path), str(path.with_suffix(".png"))))
    x, height, depth = OBJ_SIDES  # y of the file is up
    program = BLENDER.format(side=x, width=WIDTH, height=HEIGHT)
    subprocess.run([sys.executable, "-c", program, json.dumps(jobs)], check=True, capture_output=True)
    pixel = x / WIDTH
    across = (np.arange(WIDTH) + 0.5 - WIDTH / 2) * pixel
    upwards = (HEIGHT / 2 - np.arange(HEIGHT) - 0.5) * pixel
    rows = np.abs(upwards) < height / 2
    points = np.stack(np.broadcast_arrays(across[None], -depth / 2, upwards[rows][:, None]), axis=-1)
    for kind, (path, image) in zip(KINDS, jobs, strict=True):
        with subtests.test(kind=kind.__name__):
            rendered = np.asarray(Image.open(image).convert("RGB"))[rows].reshape(-1, 3)
            colours = colours_at(load_mesh(path), points.reshape(-1, 3))
            np.testing.assert_allclose(colours, rendered, atol=2)
