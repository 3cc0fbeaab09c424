"""Which face each sub-sample of each pixel sees first, by rasterisation in homogeneous coordinates.

The edge functions of Olano and Greer (1997): a ray along d from the camera meets the plane of the triangle
(v0, v1, v2) at barycentric coordinates in the ratio of d . (v1 x v2), d . (v2 x v0), d . (v0 x v1), all of
the sign of v0 . (v1 x v2). Divided by that determinant their sum is one over depth. Nothing is clipped:
triangles that pass the camera need no cutting.
"""

# Kernels are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import numpy as np

from objectfolder.jit import arrayless, kernel, relaxed_kernel

# Pixels by which a triangle is widened against rounding: no sample falls between neighbours.
WIDENING = 1e-6


def edge_functions(
    vertices: np.ndarray, faces: np.ndarray, focal: float, centre_x: float, centre_y: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the edge functions of each face over the image, and the pixels that its image may touch.

    Parameters
    ----------
    vertices
        (V, 3) float64 in the camera's frame.
    faces
        (F, 3) int64.
    focal, centre_x, centre_y
        Pixels.

    Returns
    -------
    functions
        (F, 3, 3) float64: [i] holds a, b, c of b_i / depth = a x + b y + c at (x, y) pixels.
    reach
        (F, 4) float64: least and greatest x, then y; without end where the triangle passes the camera, and
        none where it lies behind or its plane holds the camera.
    """
    indices = np.ascontiguousarray(faces.T)
    ax, ay, az = (np.ascontiguousarray(part).take(indices) for part in vertices.T)  # corner, face
    x, y, z = np.empty((3, *indices.shape))  # of the cross product of the other two corners
    for corner in range(3):
        b, c = (corner + 1) % 3, (corner + 2) % 3
        x[corner] = ay[b] * az[c] - az[b] * ay[c]
        y[corner] = az[b] * ax[c] - ax[b] * az[c]
        z[corner] = ax[b] * ay[c] - ay[b] * ax[c]
    determinant = ax[0] * x[0] + ay[0] * y[0] + az[0] * z[0]
    functions, reach = np.empty((len(faces), 3, 3)), np.empty((len(faces), 4))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        x, y, z = x / determinant, y / determinant, z / determinant
        # d = ((column - centre_x) / focal, (centre_y - row) / focal, -1), along which depth is 1.
        functions[:, :, 0] = (x / focal).T
        functions[:, :, 1] = (-y / focal).T
        functions[:, :, 2] = ((y * centre_y - x * centre_x) / focal - z).T
        across = centre_x - focal * ax / az
        down = centre_y + focal * ay / az
        flat = (determinant == 0) | ~np.isfinite(1 / determinant)
    for column, part in ((0, across), (2, down)):
        reach[:, column], reach[:, column + 1] = part.min(axis=0), part.max(axis=0)
    reach[(az > -1e-6).any(axis=0)] = -np.inf, np.inf, -np.inf, np.inf
    reach[flat | (az >= 0).all(axis=0)] = np.inf, -np.inf, np.inf, -np.inf
    return functions, reach


@arrayless(relaxed_kernel)
def rasterise(functions, reach, slots, corner, offsets, front_faces, nearness):
    """Write the nearest face at each sub-sample of the pixels that have a slot.

    Parameters
    ----------
    functions, reach
        As of `edge_functions`.
    slots
        (h, w) int32: row of the results for each pixel of a window of the image, or -1.
    corner
        Top and left, where the window begins.
    offsets
        (2, s) float32 of the sub-samples from the centre of the pixel.
    front_faces, nearness
        (slots, s) int32 face (-1 at first) and float32 one over depth (0 at first); changed.
    """
    (height, width), (top, left) = slots.shape, corner
    offsets_x, offsets_y = offsets[0], offsets[1]
    count = len(offsets_x)
    for face in range(len(functions)):
        low_x, high_x = max(reach[face, 0] - left, 0.0), min(reach[face, 1] - left, width * 1.0)
        low_y, high_y = max(reach[face, 2] - top, 0.0), min(reach[face, 3] - top, height * 1.0)
        if not (low_x <= high_x and low_y <= high_y):
            continue
        last_column, last_row = min(int(high_x), width - 1), min(int(high_y), height - 1)
        f = functions[face]
        a0, a1, a2 = np.float32(f[0, 0]), np.float32(f[1, 0]), np.float32(f[2, 0])
        b0, b1, b2 = np.float32(f[0, 1]), np.float32(f[1, 1]), np.float32(f[2, 1])
        a, b = np.float32(f[0, 0] + f[1, 0] + f[2, 0]), np.float32(f[0, 1] + f[1, 1] + f[2, 1])
        c = f[0, 2] + f[1, 2] + f[2, 2]
        slack0, slack1, slack2 = abs(a0) + abs(b0), abs(a1) + abs(b1), abs(a2) + abs(b2)
        half = np.float32(0.5 + WIDENING)
        for row in range(int(low_y), last_row + 1):
            y = top + row + 0.5
            for column in range(int(low_x), last_column + 1):
                slot = slots[row, column]
                if slot < 0:
                    continue
                x = left + column + 0.5
                e0 = np.float32(f[0, 0] * x + f[0, 1] * y + f[0, 2])
                e1 = np.float32(f[1, 0] * x + f[1, 1] * y + f[1, 2])
                e2 = np.float32(f[2, 0] * x + f[2, 1] * y + f[2, 2])
                if e0 < -half * slack0 or e1 < -half * slack1 or e2 < -half * slack2:
                    continue
                e = np.float32((f[0, 0] + f[1, 0] + f[2, 0]) * x + (f[0, 1] + f[1, 1] + f[2, 1]) * y + c)
                e0 += np.float32(WIDENING) * slack0
                e1 += np.float32(WIDENING) * slack1
                e2 += np.float32(WIDENING) * slack2
                faces_here, nearness_here = front_faces[slot], nearness[slot]
                for s in range(count):
                    ox, oy = offsets_x[s], offsets_y[s]
                    inside = min(min(e0 + a0 * ox + b0 * oy, e1 + a1 * ox + b1 * oy), e2 + a2 * ox + b2 * oy)
                    near = e + a * ox + b * oy
                    better = (inside >= np.float32(0.0)) & (near > nearness_here[s])
                    nearness_here[s] = near if better else nearness_here[s]
                    faces_here[s] = face if better else faces_here[s]


def meet_planes(
    functions: np.ndarray, face: np.ndarray, x: np.ndarray, y: np.ndarray, camera_to_world: np.ndarray,
    focal: float, centre_x: float, centre_y: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Return where rays through (n,) image points (x, y) meet the faces (n,) they are known to see.

    Returns
    -------
    barycentric, depth, direction
        (n, 3), (n,) along the camera's -z, and (n, 3) unit vectors in the world.
    """
    barycentric, depth, direction = np.empty((len(face), 3)), np.empty(len(face)), np.empty((len(face), 3))
    camera = camera_to_world, focal, centre_x, centre_y
    _meet_planes(functions, face, x, y, camera, barycentric, depth, direction)
    return barycentric, depth, direction


@arrayless(kernel)
def _meet_planes(functions, face, x, y, camera, barycentric, depth, direction):
    camera_to_world, focal, centre_x, centre_y = camera
    for i in range(len(face)):
        f = functions[face[i]]
        total, clipped = 0.0, 0.0
        for corner in range(3):
            value = f[corner, 0] * x[i] + f[corner, 1] * y[i] + f[corner, 2]
            total += value
            value = max(value, 0.0)
            clipped += value
            barycentric[i, corner] = value
        for corner in range(3):
            # A sliver may be met by its widening alone.
            barycentric[i, corner] = barycentric[i, corner] / clipped if clipped > 0 else 1 / 3
        depth[i] = 1.0 / max(total, 1e-12)
        right, up = (x[i] - centre_x) / focal, (centre_y - y[i]) / focal
        scale = 1.0 / np.sqrt(right * right + up * up + 1.0)
        for k in range(3):
            direction[i, k] = scale * (
                camera_to_world[k, 0] * right + camera_to_world[k, 1] * up - camera_to_world[k, 2]
            )
