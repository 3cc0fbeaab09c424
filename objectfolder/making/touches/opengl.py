"""The touches of a sensor as TACTO draws them: pyrender, OpenGL through EGL.

Needs the extra ``opengl`` and an EGL driver; Mesa's, without a graphics card, will do. A context of OpenGL
survives neither threads nor forks.
"""

import os
import reprlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from objectfolder.errors import InputError, SimulationError
from objectfolder.extras import missing_package
from objectfolder.surface.surface import Surface
from objectfolder.touch.presses.touches import Touches
from objectfolder.touch.rendering.surroundings import surroundings
from objectfolder.touch.sensor.camera import DEPTH_STEPS_PER_M, ray_grid, to_bytes
from objectfolder.touch.sensor.gel import gel_surface
from objectfolder.touch.sensor.sensor import Sensor

RENDERERS = COMPILED, PYRENDER = "compiled", "pyrender"
GEL_COLUMNS = 100
SHADER_GAMMA = 2.2  # of pyrender, whatever the sensor's is


def check_drawable(renderer: str, sensor: Sensor, contact: str) -> None:
    """Refuse what a renderer cannot draw.

    Raises
    ------
    InputError
        Another renderer than those of `RENDERERS`; of pyrender, an elastic contact or a sensor with a
        photometric table.
    """
    if renderer not in RENDERERS:
        raise InputError("renderer", reprlib.repr(renderer), f"Use {' or '.join(RENDERERS)}.")
    if renderer == COMPILED:
        return
    if contact != "rigid":
        raise InputError("renderer", f"pyrender draws no {contact} contact", "Use the contact rigid.")
    if sensor.photometric_table is not None:
        remedy = "Use a sensor with lights, such as digit, or the renderer compiled."
        raise InputError(
            "renderer", f"pyrender draws no photometric table, and {sensor.name} has one", remedy
        )


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


class OpenGLRenderer:
    """Sensor images by OpenGL: gel as a mesh, object's triangles with their corner normals, 4x multisampling.

    Parameters
    ----------
    sensor
        What to see through.

    Raises
    ------
    MissingPackageError
        No pyrender.
    SimulationError
        No EGL driver.
    """

    def __init__(self, sensor: Sensor) -> None:
        os.environ["PYOPENGL_PLATFORM"] = "egl"  # read when OpenGL is imported
        try:
            import pyrender
            from OpenGL.GL import GL_RENDERER, GL_VERSION, glGetString

            self._renderer = pyrender.OffscreenRenderer(sensor.image_width, sensor.image_height)
        except ModuleNotFoundError as error:
            raise missing_package(error.name or "pyrender", "opengl") from error
        except Exception as error:  # PyOpenGL and pyrender have no class of their own for a missing driver
            remedy = "Install libegl1 and libgl1-mesa-dri, or use the renderer compiled."
            raise SimulationError("pyrender", f"no OpenGL through EGL ({error})", remedy) from error
        self.driver = " ".join(glGetString(name).decode() for name in (GL_RENDERER, GL_VERSION))
        self._pyrender: Any = pyrender
        self._sensor = sensor
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
        for position, colour in zip(sensor.light_positions_m, sensor.light_colours, strict=True):
            pose = np.eye(4)
            pose[:3, 3] = position
            self._scene.add(pyrender.PointLight(color=np.array(colour), intensity=1.0), pose=pose)

    def _mesh(self, corners: np.ndarray, normals: np.ndarray) -> Any:
        material = self._pyrender.MetallicRoughnessMaterial(
            baseColorFactor=[self._sensor.base_colour] * 3 + [1.0],
            metallicFactor=self._sensor.metallic,
            roughnessFactor=self._sensor.roughness,
        )
        primitive = self._pyrender.Primitive(
            positions=corners.reshape(-1, 3).astype(np.float32),
            normals=normals.reshape(-1, 3).astype(np.float32),
            material=material,
        )
        return self._pyrender.Mesh([primitive])

    def render_gel(self) -> tuple[np.ndarray, np.ndarray]:
        """Render the gel that nothing touches.

        Returns
        -------
        tuple
            (height, width, 3) uint8 image without shadows, by the sensor's `display_gamma`, and
            (height, width) float32 camera depth, metres.
        """
        values, depth = self._renderer.render(self._scene)
        gamma = SHADER_GAMMA / self._sensor.display_gamma
        if gamma != 1:
            values = to_bytes((np.arange(256, dtype=np.float32) / 255) ** np.float32(gamma))[values]
        return np.array(values), np.array(depth)

    def render(
        self, surface: Surface, sensor_to_object: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield what `render_gel` returns for a surface at poses (n, 4, 4).

        The mesh is handed to OpenGL once and then moved, as TACTO does. The shader places it in single
        precision.
        """
        node = self._scene.add(self._mesh(surface.vertices[surface.faces], surface.corner_normals))
        try:
            for pose in sensor_to_object:
                self._scene.set_pose(node, np.linalg.inv(pose))
                yield self.render_gel()
        finally:
            self._scene.remove_node(node)

    def close(self) -> None:
        """Free the OpenGL context."""
        self._renderer.delete()


def draw_touches(surface: Surface, sensor: Sensor, touches: Touches) -> tuple[Touches, np.ndarray, str]:
    """Draw touches anew in TACTO's way, each at its pose.

    Parameters
    ----------
    surface
        What they touch, metres.
    touches
        As the rigid `press` returned them.

    Returns
    -------
    tuple
        The touches with ``rgb``, ``depth_m`` and ``mask`` of OpenGL, mask and depth by one sample a pixel;
        the image of the untouched gel; the name of the driver. What pyrender knows nothing of is the
        compiled renderer's: a sensor's shadows, and that one that cannot stand sees its gel alone.

    Raises
    ------
    InputError
        A sensor that pyrender cannot draw.
    MissingPackageError, SimulationError
        As `OpenGLRenderer`.
    """
    check_drawable(PYRENDER, sensor, "rigid")
    renderer, caster, grid = OpenGLRenderer(sensor), surroundings(sensor), ray_grid(sensor, 1)
    try:
        untouched, gel_depth = renderer.render_gel()
        rgb = np.broadcast_to(untouched, touches.rgb.shape).copy()
        indentation, mask = np.zeros_like(touches.depth_m), np.zeros_like(touches.mask)
        standing = np.flatnonzero(touches.penetration_m > 0)
        drawn = renderer.render(surface, touches.sensor_to_object[standing])
        for index, (image, depth) in zip(standing, drawn, strict=True):
            rgb[index], mask[index] = image, depth < gel_depth
            camera = sensor.camera_position_m
            x = depth.astype(np.float64)
            gel = gel_surface(sensor, camera[1] + grid.u * x, camera[2] + grid.v[:, None] * x) - camera[0]
            steps = np.rint(np.maximum(gel - x, 0) * DEPTH_STEPS_PER_M)
            indentation[index] = np.where(mask[index], steps / DEPTH_STEPS_PER_M, 0)
            if caster is not None:
                caster.cast(rgb[index], indentation[index])
        return replace(touches, rgb=rgb, depth_m=indentation, mask=mask), untouched, renderer.driver
    finally:
        renderer.close()
