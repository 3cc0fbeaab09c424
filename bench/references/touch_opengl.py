"""The same touch through pyrender and OpenGL: an independent reference for tests.

Needs the packages pyrender and trimesh, and an EGL driver (software Mesa will do). OpenGL contexts
survive neither threads nor forks: use one `ReferenceRenderer` a process.
"""

import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from objectfolder.surface.surface import Surface
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor

GEL_COLUMNS = 100


def gel_mesh(sensor: Sensor, columns: int = GEL_COLUMNS) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of the gel, on a grid as TACTO builds it, facing the camera."""
    rows = int(columns * sensor.gel_height_m / sensor.gel_width_m)
    y = sensor.gel_apex_m[1] + np.linspace(-0.5, 0.5, columns) * sensor.gel_width_m
    z = sensor.gel_apex_m[2] + np.linspace(-0.5, 0.5, rows) * sensor.gel_height_m
    yy, zz = np.meshgrid(y, z)
    vertices = np.stack([gel_surface(sensor, yy, zz), yy, zz], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + columns, corner + 1], axis=1)
    upper = np.stack([corner + 1, corner + columns, corner + columns + 1], axis=1)
    return vertices, np.concatenate([lower, upper])


class ReferenceRenderer:
    """Sensor images by OpenGL: gel as a mesh, object's triangles with their corner normals, 4x multisampling.

    Parameters
    ----------
    sensor
        What to see through.

    Raises
    ------
    RuntimeError
        No EGL driver.
    """

    def __init__(self, sensor: Sensor) -> None:
        os.environ["PYOPENGL_PLATFORM"] = "egl"
        import pyrender

        self.sensor = sensor
        self._pyrender: Any = pyrender
        self._scene = pyrender.Scene()
        vertices, faces = gel_mesh(sensor)
        corners = vertices[faces]
        flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        flat /= np.linalg.norm(flat, axis=1, keepdims=True)
        self._scene.add(self._mesh(corners, np.repeat(flat[:, None], 3, axis=1)))
        pose = np.eye(4)
        # OpenGL's camera: right, up and back are the sensor's -y, z and -x.
        pose[:3, :3] = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        pose[:3, 3] = sensor.camera_position_m
        field_of_view = float(np.radians(sensor.field_of_view_deg))
        self._scene.add(pyrender.PerspectiveCamera(yfov=field_of_view, znear=sensor.near_m), pose=pose)
        for position, color in zip(sensor.light_positions_m, sensor.light_colours, strict=True):
            pose = np.eye(4)
            pose[:3, 3] = position
            self._scene.add(pyrender.PointLight(color=np.array(color), intensity=1.0), pose=pose)
        try:
            self._renderer = pyrender.OffscreenRenderer(sensor.image_width, sensor.image_height)
        except (AssertionError, ValueError, ImportError, AttributeError, IndexError) as error:
            raise RuntimeError(f"no OpenGL through EGL ({error}); install libegl1 and Mesa") from error

    def _mesh(self, corners: np.ndarray, normals: np.ndarray) -> Any:
        material = self._pyrender.MetallicRoughnessMaterial(
            baseColorFactor=[self.sensor.base_colour] * 3 + [1.0],
            metallicFactor=self.sensor.metallic,
            roughnessFactor=self.sensor.roughness,
        )
        primitive = self._pyrender.Primitive(
            positions=corners.reshape(-1, 3).astype(np.float32),
            normals=normals.reshape(-1, 3).astype(np.float32),
            material=material,
        )
        return self._pyrender.Mesh([primitive])

    def render(self, surface: Surface, sensor_to_object: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Render a surface from one pose (4, 4).

        Returns
        -------
        tuple
            (height, width, 3) uint8 image and (height, width) float32 camera depth, metres.
        """
        pose = np.linalg.inv(sensor_to_object)
        # Before single precision: the shader's matrices would lose micrometres on large objects.
        corners = surface.vertices[surface.faces] @ pose[:3, :3].T + pose[:3, 3]
        node = self._scene.add(self._mesh(corners, surface.corner_normals @ pose[:3, :3].T))
        try:
            color, depth = self._renderer.render(self._scene)
        finally:
            self._scene.remove_node(node)
        return np.array(color), np.array(depth)

    def render_held(
        self, surface: Surface, sensor_to_object: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield what `render` returns for poses (n, 4, 4), the mesh handed to OpenGL once and then moved.

        So TACTO does. The shader places the mesh in single precision: micrometres are lost on large objects.
        """
        node = self._scene.add(self._mesh(surface.vertices[surface.faces], surface.corner_normals))
        try:
            for pose in sensor_to_object:
                self._scene.set_pose(node, np.linalg.inv(pose))
                color, depth = self._renderer.render(self._scene)
                yield np.array(color), np.array(depth)
        finally:
            self._scene.remove_node(node)

    def close(self) -> None:
        """Free the OpenGL context."""
        self._renderer.delete()


def render_reference(
    vertices: np.ndarray,
    faces: np.ndarray,
    sensor: Sensor,
    sensor_to_object: np.ndarray,
    held: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Render poses (n, 4, 4) in one go, for a process of its own: images and camera depths, stacked.

    With `held` the mesh is handed to OpenGL once, see `ReferenceRenderer.render_held`.
    """
    renderer = ReferenceRenderer(sensor)
    try:
        surface = Surface(vertices, faces)
        if held:
            results = list(renderer.render_held(surface, sensor_to_object))
        else:
            results = [renderer.render(surface, pose) for pose in sensor_to_object]
    finally:
        renderer.close()
    images, depths = zip(*results, strict=True)
    return np.stack(images), np.stack(depths)
