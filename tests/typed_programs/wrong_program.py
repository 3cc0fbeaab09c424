"""Mistakes of a user; each line that ends in a comment is one, and the checker names it."""

import numpy as np
from numpy.typing import NDArray

import objectfolder

mug = objectfolder.example("mug")
points, normals = mug.sample_contacts(2)
cameras, lights = mug.sample_views(2)

mug.strike(points, duration=1.0)  # call-arg
mug.strike(points, -normals, forces=points)  # call-arg
mug.press(points, depth=0.001)  # call-arg
mug.render(cameras, lights, linear=True)  # call-arg
mug.touch.press(points, tilt_deg="steep")  # arg-type
mug.render(cameras, lights, resolution="large")  # arg-type
mug.sample_contacts("many")  # arg-type
objectfolder.load(5)  # arg-type
linear: NDArray[np.float32] = mug.render(cameras, lights)  # assignment
image: NDArray[np.uint8] = mug.render_linear(cameras, lights)  # assignment
mask: NDArray[np.float64] = mug.press(points).mask  # assignment
label: str = mug.mass_kg  # assignment
print(mug.taste)  # attr-defined
