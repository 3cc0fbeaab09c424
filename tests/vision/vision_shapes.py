"""Small textured meshes for the tests of sight."""

import numpy as np
import trimesh

from objectfolder.surface.textured_mesh import TexturedMesh

FACE_COLOURS = np.array(
    [[200, 40, 30], [30, 180, 60], [40, 60, 200], [220, 200, 40], [200, 200, 200], [90, 40, 120]],
    dtype=np.uint8,
)


def cube(side: float = 0.1) -> TexturedMesh:
    """A closed cube away from the origin, a colour with a dark square on each side."""
    vertices, faces, coordinates = [], [], []
    for axis in range(3):
        for sign in (-1, 1):
            first, second = (axis + 1) % 3, (axis + 2) % 3
            corners = np.zeros((4, 3))
            corners[:, axis] = sign
            corners[:, first] = np.array([-1, 1, 1, -1]) * sign
            corners[:, second] = [-1, -1, 1, 1]
            uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
            uv = (uv * 0.9 + 0.05 + [len(faces) // 2, 0]) / [6, 1]
            base = len(vertices)
            vertices += list(corners * side / 2)
            for triangle in ((0, 1, 2), (0, 2, 3)):
                faces.append([base + corner for corner in triangle])
                coordinates.append(uv[list(triangle)])
    texture = np.repeat(FACE_COLOURS[None], 16, axis=0).repeat(16, axis=1)
    texture = np.dstack([texture, np.full(texture.shape[:2], 255, np.uint8)])
    for tile in range(6):
        texture[4:9, tile * 16 + 5 : tile * 16 + 11, :3] //= 3
    points, inverse = np.unique(np.round(vertices, 9), axis=0, return_inverse=True)
    return TexturedMesh(
        points + np.array([0.3, -0.2, 0.1]),
        inverse.ravel()[np.array(faces)],
        np.array(coordinates),
        (texture,),
        np.zeros(len(faces), dtype=np.int32),
    )


def sphere(radius: float, colour: tuple[int, int, int], subdivisions: int = 4) -> TexturedMesh:
    """An icosphere of one colour."""
    ball = trimesh.creation.icosphere(subdivisions, radius)
    return TexturedMesh(
        np.array(ball.vertices),
        np.array(ball.faces),
        np.zeros((len(ball.faces), 3, 2)),
        (np.array([[[*colour, 255]]], dtype=np.uint8),),
        np.zeros(len(ball.faces), dtype=np.int32),
    )
