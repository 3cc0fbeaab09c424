"""TACTO's own renderer, for a process of the environment in which TACTO 0.0.3 is installed.

    PYTHON_OF_THAT_ENVIRONMENT bench/rivals/touch/tacto_renderer.py REQUEST.npz RESULT.npz

Imports nothing of this project. TACTO's drawing needs neither pybullet nor urdfpy, which its package
imports: where they are not installed, empty modules stand for them. The request has ``vertices`` (V, 3),
``faces`` (F, 3), ``poses`` (n, 4, 4) of the sensor in the object's frame, and perhaps ``normals`` (V, 3),
without which TACTO's mesh makes its own. The result has ``images`` (n, 160, 120, 3) uint8, ``calibrated``
over the image of no contact as background, ``no_contact``, the ``normals`` that were drawn, ``cpu_s`` (n,),
and ``driver``, what OpenGL is drawn by.
"""

import importlib.util
import os
import sys
import time
from pathlib import Path
from types import ModuleType

os.environ["PYOPENGL_PLATFORM"] = "egl"
import numpy as np

# TACTO 0.0.3 and pyrender 0.1.45 use names that numpy has since dropped; they mean these.
for name, meaning in (("float", float), ("infty", np.inf)):
    if name not in vars(np):
        setattr(np, name, meaning)
for name in ("pybullet", "urdfpy"):
    if importlib.util.find_spec(name) is None:
        sys.modules[name] = ModuleType(name)
        sys.modules[name].URDF = None


def main(request: Path, result: Path) -> None:
    import tacto
    import trimesh
    from OpenGL.GL import GL_RENDERER, GL_VERSION, glGetString
    from scipy.spatial.transform import Rotation

    inputs = np.load(request)
    renderer = tacto.Renderer(120, 160, None, tacto.get_digit_config_path())
    driver = " ".join(glGetString(name).decode() for name in (GL_RENDERER, GL_VERSION))
    renderer.current_object_nodes = {}
    no_contact = np.array(renderer.render(noise=False, calibration=False)[0][0])
    # OpenCV's order of colours, which `set_background` turns round.
    renderer.set_background(np.ascontiguousarray(no_contact[:, :, ::-1]))
    normals = inputs.get("normals")
    mesh = trimesh.Trimesh(inputs["vertices"], inputs["faces"], vertex_normals=normals, process=False)
    mesh.visual = trimesh.visual.ColorVisuals()
    renderer.add_object(mesh, "object")
    images, calibrated, seconds = [], [], []
    for pose in inputs["poses"]:
        inverse = np.linalg.inv(pose)
        turned = Rotation.from_matrix(inverse[:3, :3]).as_euler("xyz")
        placed = {"object": (inverse[:3, 3], turned)}
        start = time.process_time()
        colours, _ = renderer.render(placed, {"object": 0.0}, noise=False, calibration=False)
        seconds.append(time.process_time() - start)
        images.append(np.array(colours[0]))
        calibrated.append(renderer._calibrate(images[-1], 0))
    np.savez(
        result,
        images=np.array(images),
        calibrated=np.array(calibrated),
        no_contact=no_contact,
        normals=mesh.vertex_normals,
        cpu_s=np.array(seconds),
        driver=np.array(driver),
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
