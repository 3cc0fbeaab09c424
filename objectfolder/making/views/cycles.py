"""Ground-truth images by Cycles: the only module that imports bpy, inside functions.

Run as ``python -m objectfolder.making.views.cycles REQUEST RESULT [REQUEST RESULT ...]`` it renders saved
requests in a process of its own (see `cycles_process`). Blender keeps state a process: one render at a time,
and no import of bpy before or beside other children.
"""

import contextlib
import os
import struct
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from objectfolder.child_process import end_with
from objectfolder.errors import SimulationError
from objectfolder.making.device import CPU, device_kind, missing_device
from objectfolder.making.views.glass import make_thin_glass
from objectfolder.making.views.render_request import (
    FACES_WITH_HOLES,
    Scene,
    Shots,
    load_request,
)
from objectfolder.vision.cameras import image_box

# Beside what shows the object: Cycles judges a pixel's noise with its neighbours, and Blender rounds shares
# of an image to pixels.
PART_MARGIN_PX = 2


@contextlib.contextmanager
def silenced_stdout() -> Iterator[None]:
    """Send file descriptor 1 to nowhere: Blender writes to it past `sys.stdout`."""
    sys.stdout.flush()
    saved, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
        os.close(nowhere)


def render(scene: Scene, shots: Shots) -> np.ndarray:
    """Render every shot in this process.

    Returns
    -------
    np.ndarray
        (n, height, width, 4) float32 scene-linear premultiplied RGBA, row 0 on top.
    """
    import bpy

    images = np.empty((len(shots.camera_to_world), shots.height, shots.width, 4), dtype=np.float32)
    with silenced_stdout(), tempfile.TemporaryDirectory(prefix="objectfolder-cycles-") as folder:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        _set_up_render(shots, os.path.join(folder, "view.exr"))
        bpy.context.scene.cycles.transparent_max_bounces = FACES_WITH_HOLES if scene.lets_through else 0
        if scene.appearance.thin:
            # Paths through glass would end by chance, and leave noise in alpha.
            bpy.context.scene.cycles.min_transparent_bounces = FACES_WITH_HOLES
        _add_object(scene, folder, alpha_alone=shots.alpha_alone)
        camera, light = _add_camera_and_light(shots)
        if shots.environment is not None:
            _surround(shots.environment)
            light.hide_render = True
        parts = _object_parts(scene, shots) if shots.parts is None else shots.parts
        for index in range(len(images)):
            camera.matrix_world = shots.camera_to_world[index].T.tolist()
            light.location = shots.light_position[index].tolist()
            bpy.context.scene.cycles.seed = int(shots.seeds[index])
            _limit(parts[index], shots.height, shots.width)
            # Without it the seed of the first view, kept by persistent data, stays in force.
            bpy.context.scene.update_tag()
            bpy.ops.render.render(write_still=True)
            images[index] = read_exr(bpy.context.scene.render.filepath, shots.height, shots.width)
    return images


def _set_up_render(shots: Shots, path: str) -> None:
    import bpy

    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = shots.width, shots.height
    scene.render.resolution_percentage = 100
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.render.threads_mode = "FIXED"
    scene.render.threads = shots.threads
    scene.render.use_compositing = False
    scene.render.use_sequencer = False
    scene.render.dither_intensity = 0.0
    scene.render.filepath = path
    settings = scene.render.image_settings
    settings.file_format = "OPEN_EXR"
    settings.color_mode = "RGBA"
    settings.color_depth = "32"
    settings.exr_codec = "NONE"
    cycles = scene.cycles
    cycles.device = _device()
    cycles.samples = shots.samples
    cycles.pixel_filter_type = "BOX"
    cycles.sampling_pattern = "TABULATED_SOBOL"
    cycles.use_adaptive_sampling = shots.most_samples is not None
    if shots.most_samples is not None:
        cycles.samples, cycles.adaptive_min_samples = shots.most_samples, shots.samples
        cycles.adaptive_threshold = shots.noise_threshold
    cycles.use_denoising = False
    cycles.use_auto_tile = False
    cycles.light_sampling_threshold = 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.blur_glossy = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = shots.bounces
    cycles.transmission_bounces = cycles.volume_bounces = 0
    world = bpy.data.worlds.new("black")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.0
    scene.world = world


def _device() -> str:
    """Choose the processor, or every graphics processor of the kind that is asked for.

    Raises
    ------
    SimulationError
        None of this kind, or Blender does not know it.
    """
    import bpy

    kind = device_kind()
    if kind == CPU:
        return CPU
    preferences = bpy.context.preferences.addons["cycles"].preferences
    try:
        preferences.compute_device_type = kind
    except TypeError as error:
        raise missing_device("Cycles") from error
    preferences.refresh_devices()
    for device in preferences.devices:
        device.use = device.type == kind
    if not any(device.use for device in preferences.devices):
        raise missing_device("Cycles")
    return "GPU"


def _object_parts(scene: Scene, shots: Shots) -> np.ndarray:
    """Return the parts (n, 4) of images, as of `Shots.parts`, beside which the object is not seen.

    Paths of the pixels there end in nothing, and took a fifth to three fifths of a view's time. Each pixel
    has random numbers of its own, so that images are the same bytes.
    """
    points, size = scene.vertices[np.unique(scene.faces)], (shots.height, shots.width)
    boxes = [
        image_box(points, pose, size, shots.field_of_view_deg, PART_MARGIN_PX)
        for pose in shots.camera_to_world
    ]
    parts = np.array(boxes, dtype=np.int32).reshape(-1, 4)
    # Blender takes a border without pixels for none. A single pixel shows that the object is elsewhere.
    parts[(parts[:, 2:] == 0).any(axis=1)] = 0, 0, 1, 1
    return parts


def _limit(part: np.ndarray, height: int, width: int) -> None:
    """Render the part (top, left, height, width) of an image alone."""
    import bpy

    render = bpy.context.scene.render
    top, left, rows, columns = map(int, part)
    render.use_border, render.use_crop_to_border = True, False
    render.border_min_x, render.border_max_x = left / width, (left + columns) / width
    render.border_min_y, render.border_max_y = 1 - (top + rows) / height, 1 - top / height


def _surround(radiance: np.ndarray) -> None:
    """Light the object by a map of radiance, sampled in proportion to it."""
    import bpy

    height, width = radiance.shape[:2]
    image = bpy.data.images.new("environment", width, height, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.concatenate([radiance, np.ones((height, width, 1))], axis=2)[::-1]
    image.pixels.foreach_set(np.ascontiguousarray(pixels, dtype=np.float32).ravel())
    image.update()
    world = bpy.context.scene.world
    nodes = world.node_tree.nodes
    texture = nodes.new("ShaderNodeTexEnvironment")
    texture.image, texture.interpolation = image, "Linear"
    world.node_tree.links.new(texture.outputs["Color"], nodes["Background"].inputs["Color"])
    nodes["Background"].inputs["Strength"].default_value = 1.0
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 1024


def _add_object(scene: Scene, folder: str, *, alpha_alone: bool) -> None:
    import bpy

    points, normals, faces = split_at_creases(scene)
    mesh = bpy.data.meshes.new("object")
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    mesh.polygons.foreach_set("material_index", scene.face_texture.astype(np.int32))
    mesh.update(calc_edges=True)
    coordinates = mesh.uv_layers.new(name="texture")
    coordinates.data.foreach_set("uv", scene.texture_coordinates.astype(np.float32).ravel())
    mesh.shade_smooth()
    mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", normals.ravel())
    for index in range(len(scene.textures)):
        mesh.materials.append(_material(scene, index, folder, alpha_alone=alpha_alone))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("object", mesh))


def split_at_creases(scene: Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (n, 3), a normal for each (n, 3), both float32, and faces (f, 3) int32.

    A vertex is repeated for each of its normals: Cycles shades with corner normals but lifts shadow rays
    with those of the vertices, so that a crease between shared vertices would lie in its own shadow.
    """
    normals = scene.corner_normals.reshape(-1, 3).astype(np.float32)
    keys = np.column_stack([scene.faces.ravel(), np.round(normals * 2**20)]).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    points = scene.vertices[scene.faces.ravel()[first]].astype(np.float32)
    return points, normals[first], inverse.reshape(-1, 3).astype(np.int32)


def _material(scene: Scene, index: int, folder: str, *, alpha_alone: bool) -> Any:
    import bpy

    material = bpy.data.materials.new("surface")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader = nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = scene.appearance.roughness
    shader.inputs["Metallic"].default_value = scene.appearance.metallic
    shader.inputs["Specular IOR Level"].default_value = scene.appearance.specular
    texture = scene.textures[index]
    base = _image_node(nodes, texture, "sRGB", folder)
    links.new(base.outputs["Color"], shader.inputs["Base Color"])
    if (texture[..., 3] < 255).any():
        # Colour and alpha are interpolated apart: a hole does not darken its rim.
        base.image.alpha_mode = "CHANNEL_PACKED"
        alpha = base.outputs["Alpha"]
        if index in scene.alpha_cutoffs:
            absent = nodes.new("ShaderNodeMath")
            absent.operation = "LESS_THAN"
            absent.inputs[1].default_value = scene.alpha_cutoffs[index]
            links.new(alpha, absent.inputs[0])
            present = nodes.new("ShaderNodeMath")
            present.operation = "SUBTRACT"
            present.inputs[0].default_value = 1.0
            links.new(absent.outputs[0], present.inputs[1])
            alpha = present.outputs[0]
        links.new(alpha, shader.inputs["Alpha"])
    roughness: Any = scene.appearance.roughness
    for name, maps in (("Roughness", scene.roughness_maps), ("Metallic", scene.metallic_maps)):
        if index in maps:
            node = _image_node(nodes, np.repeat(maps[index][..., None], 4, axis=2), "Non-Color", folder)
            split = nodes.new("ShaderNodeSeparateColor")
            links.new(node.outputs["Color"], split.inputs["Color"])
            links.new(split.outputs["Red"], shader.inputs[name])
            roughness = split.outputs["Red"] if name == "Roughness" else roughness
    normal = None
    if index in scene.normal_maps:
        image = scene.normal_maps[index]
        node = _image_node(nodes, np.dstack([image, np.full_like(image[..., 0], 255)]), "Non-Color", folder)
        bent = nodes.new("ShaderNodeNormalMap")
        bent.uv_map = "texture"
        links.new(node.outputs["Color"], bent.inputs["Color"])
        normal = bent.outputs["Normal"]
        links.new(normal, shader.inputs["Normal"])
    if scene.appearance.thin:
        look = scene.appearance.specular, roughness, normal
        make_thin_glass(material, base.outputs["Color"], *look, shines=not alpha_alone)
    return material


def _image_node(nodes: Any, pixels: np.ndarray, colour_space: str, folder: str) -> Any:
    """Texture node of an (h, w, 4) uint8 image; bilinear, repeating.

    The bytes go by an uncompressed Targa file: `Image.pixels` takes 16 bytes a texel, which
    for 4096 a side adds a hundred MiB to the peak.
    """
    import bpy

    height, width = pixels.shape[:2]
    path = os.path.join(folder, f"{len(bpy.data.images)}.tga")
    with open(path, "wb") as file:
        file.write(struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, width, height, 32, 8))
        for row in pixels[::-1]:
            file.write(row[:, [2, 1, 0, 3]].tobytes())
    node = nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.load(path)
    node.image.colorspace_settings.name = colour_space
    node.image.alpha_mode = "NONE"
    return node


def _add_camera_and_light(shots: Shots) -> tuple[Any, Any]:
    import bpy

    scene = bpy.context.scene
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit = "AUTO"
    lens.angle = float(np.deg2rad(shots.field_of_view_deg))
    lens.clip_start, lens.clip_end = 1e-3, 1e3
    camera = bpy.data.objects.new("camera", lens)
    lamp = bpy.data.lights.new("light", "POINT")
    lamp.energy = shots.light_power_w
    lamp.shadow_soft_size = 0.0
    lamp.use_soft_falloff = False
    light = bpy.data.objects.new("light", lamp)
    for item in (camera, light):
        scene.collection.objects.link(item)
    scene.camera = camera
    return camera, light


def read_exr(path: str, height: int, width: int) -> np.ndarray:
    """Read an uncompressed 32-bit RGBA OpenEXR file of known size: what `render` has Cycles write.

    Such a file ends with its scan lines, each a line number, a byte count and the channels A, B, G, R in
    turn. Blender's own reader takes seven times as long.

    Returns
    -------
    np.ndarray
        (height, width, 4) float32, row 0 on top.

    Raises
    ------
    SimulationError
        A file of another kind.
    """
    line = 8 + 16 * width
    data = np.fromfile(path, dtype=np.uint8)
    if len(data) > height * line:
        lines = data[len(data) - height * line :].reshape(height, line)
        numbers = np.ascontiguousarray(lines[:, :8]).view("<i4")
        if (numbers == np.stack([np.arange(height), np.full(height, line - 8)], axis=1)).all():
            channels = np.ascontiguousarray(lines[:, 8:]).view("<f4").reshape(height, 4, width)
            return channels[:, ::-1].transpose(0, 2, 1)
    raise SimulationError(
        "Cycles",
        "the rendered file is not the uncompressed image asked for",
        "Use the pinned bpy.",
    )


if __name__ == "__main__":
    end_with(os.getppid())
    for request, result in zip(sys.argv[1::2], sys.argv[2::2], strict=True):
        np.save(Path(result), render(*load_request(Path(request))))
