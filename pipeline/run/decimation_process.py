"""Child process that decimates a mesh with Blender: ``-m pipeline.run.decimation_process IN OUT``.

A process of its own because Blender is native code that keeps its state and can crash. IN is an .npz file
with `vertices`, `faces`, `texture_coordinates`, `face_texture` of a mesh, and `target`; OUT gets the same of
the decimated one.
"""

import os
import sys
from pathlib import Path

import numpy as np

from objectfolder.child_process import end_with, limit_cpu_time

TIME_LIMIT_S = 600


def main(source: Path, target: Path) -> None:
    """Collapse edges by the quadrics of their faces; coordinates of textures move with the corners."""
    import bpy

    limit_cpu_time(TIME_LIMIT_S)
    arrays = np.load(source)
    count = len(arrays["faces"])
    mesh = bpy.data.meshes.new("mesh")
    mesh.vertices.add(len(arrays["vertices"]))
    mesh.vertices.foreach_set("co", arrays["vertices"].astype(np.float32).ravel())
    mesh.loops.add(3 * count)
    mesh.loops.foreach_set("vertex_index", arrays["faces"].astype(np.int32).ravel())
    mesh.polygons.add(count)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * count, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    for _ in range(int(arrays["face_texture"].max()) + 1):
        mesh.materials.append(bpy.data.materials.new("material"))  # an index without one is cut off
    mesh.polygons.foreach_set("material_index", arrays["face_texture"].astype(np.int32))
    mesh.uv_layers.new().uv.foreach_set("vector", arrays["texture_coordinates"].astype(np.float32).ravel())
    body = bpy.data.objects.new("body", mesh)
    bpy.context.collection.objects.link(body)
    modifier = body.modifiers.new("decimation", "DECIMATE")
    mesh.validate()  # Blender cannot take faces that are given twice
    modifier.ratio = int(arrays["target"]) / len(mesh.polygons)
    result = body.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    result.calc_loop_triangles()
    vertices = np.empty((len(result.vertices), 3), dtype=np.float32)
    result.vertices.foreach_get("co", vertices.ravel())
    triangles = len(result.loop_triangles)
    loops, polygons = np.empty((triangles, 3), dtype=np.int32), np.empty(triangles, dtype=np.int32)
    result.loop_triangles.foreach_get("loops", loops.ravel())
    result.loop_triangles.foreach_get("polygon_index", polygons)
    corners = np.empty(len(result.loops), dtype=np.int32)
    result.loops.foreach_get("vertex_index", corners)
    coordinates = np.empty((len(result.loops), 2), dtype=np.float32)
    result.uv_layers[0].uv.foreach_get("vector", coordinates.ravel())
    textures = np.empty(len(result.polygons), dtype=np.int32)
    result.polygons.foreach_get("material_index", textures)
    np.savez(
        target,
        vertices=vertices,
        faces=corners[loops],
        texture_coordinates=coordinates[loops],
        face_texture=textures[polygons],
    )


if __name__ == "__main__":
    end_with(os.getppid())
    main(Path(sys.argv[1]), Path(sys.argv[2]))
