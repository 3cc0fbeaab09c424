"""Scenes of MuJoCo with the package's Object Files beside them."""

import shutil
from pathlib import Path

from scipy.spatial import ConvexHull

import objectfolder

EXAMPLES = Path(objectfolder.__file__).parent / "examples"
BODY = """
  <body name="{place}_{name}" pos="{x} 0 {height}"><freejoint/>
    <inertial pos="0 0 0.05" mass="{mass_kg}" diaginertia="4e-4 4e-4 4e-4"/>
    <geom type="mesh" mesh="{name}"/>
  </body>"""
SCENE = """
<mujoco><option timestep="0.002"/><asset>{}</asset><worldbody>
  <geom name="table" type="box" pos="0 0 -0.02" size="0.3 0.3 0.02"/>{}
</worldbody></mujoco>
"""


def drop_scene(folder: Path, *names: str) -> Path:
    """Write a scene of objects of the package, as their hulls 10 mm above a table, 20 cm apart."""
    hulls, bodies = "", ""
    for place, name in enumerate(names):
        (folder / name).mkdir()
        shutil.copy(EXAMPLES / f"{name}.safetensors", folder / name)
        file = objectfolder.example(name)
        hull = file.surface.vertices[ConvexHull(file.surface.vertices).vertices]
        hulls += f'<mesh name="{name}" vertex="{" ".join(map(str, hull.ravel()))}"/>'
        bodies += BODY.format(
            place=place, name=name, x=0.2 * place, height=0.01 - file.surface.bounds[0][2],
            mass_kg=file.description["body"]["mass_kg"],
        )  # fmt: skip
    path = folder / "scene.xml"
    path.write_text(SCENE.format(hulls, bodies))
    return path
