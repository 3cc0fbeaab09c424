"""Scenes of MuJoCo with the package's Object Files beside them."""

import shutil
from pathlib import Path

import objectfolder

EXAMPLES = Path(objectfolder.__file__).parent / "examples"
BODY = """
  <body name="{place}_{name}" pos="{x} 0 {height}"><freejoint/>
    <inertial pos="0 0 0" mass="{mass_kg}" diaginertia="4e-4 4e-4 4e-4"/>
    <geom type="cylinder" size="0.04 0.05" pos="{middle}"/>
  </body>"""
SCENE = """
<mujoco><option timestep="0.002"/><worldbody>
  <geom name="table" type="box" pos="0 0 -0.02" size="0.3 0.3 0.02"/>{}
</worldbody></mujoco>
"""


def drop_scene(folder: Path, *names: str) -> Path:
    """Write a scene of objects of the package, as cylinders that stand 10 mm above a table, 20 cm apart."""
    bodies = ""
    for place, name in enumerate(names):
        (folder / name).mkdir()
        shutil.copy(EXAMPLES / f"{name}.safetensors", folder / name)
        file = objectfolder.example(name)
        low, high = file.surface.bounds
        middle = " ".join(map(str, (low + high) / 2))
        bodies += BODY.format(
            place=place, name=name, x=0.2 * place, height=0.06 - (low[2] + high[2]) / 2, middle=middle,
            mass_kg=file.description["body"]["mass_kg"],
        )  # fmt: skip
    path = folder / "scene.xml"
    path.write_text(SCENE.format(bodies))
    return path
