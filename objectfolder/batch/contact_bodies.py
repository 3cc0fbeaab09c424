"""Where the sensor stands in each of many touches of several objects, and which faces are near its gel.

The arrays of all objects follow each other; `offsets` (objects + 1, 3) says where the boxes, leaves and faces
of each begin. Each function computes one touch, in double precision, by the kernels of a single press.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math
from collections import namedtuple

import numpy as np

from objectfolder.batch.targets import Body, compiled_copy, scalar
from objectfolder.touch.contact import first_touch
from objectfolder.touch.contact.first_touch import contact_normals
from objectfolder.touch.contact.indentation import indentation
from objectfolder.touch.contact.tree_queries import (
    TREE_STACK,
    Tree,
    _behind,
    _bound_box,
    _bound_triangle,
    _indentation_bound,
    _transform,
    closest,
    enters_box,
    in_balls,
    near_gel,
)
from objectfolder.touch.presses.touches import TOLERANCE_M
from objectfolder.touch.rendering.gather import _normal_map
from objectfolder.touch.rendering.rasterise import _edges

first_touch_pose = compiled_copy(
    first_touch._first_touch_pose,
    _contact_frame=scalar(first_touch._contact_frame),
    _tilt=scalar(first_touch._tilt),
    _roll=scalar(first_touch._roll),
)
# Numbers of a face for the pixels: of each corner's plane and of one over the depth, along 1, u and v.
FACE_NUMBERS = 12

# Trees of boxes over the triangles of all objects.
Trees = namedtuple("Trees", "offsets boxes order triangles")
# The trees, and the normals of their faces and of these' corners.
Surfaces = namedtuple("Surfaces", "offsets boxes order triangles face_normals corner_normals")
# Where touches are on the surface.
Places = namedtuple("Places", "face barycentric")
# Touched points, their shading normals, and how many faces are in the balls round them.
Contacts = namedtuple("Contacts", "points shading counts")
# Touched points, their shading normals, and tilt, azimuth and roll of the sensor.
Approaches = namedtuple("Approaches", "points shading angles")
# Where each touch's list of faces begins in that of all, and that one.
Lists = namedtuple("Lists", "starts faces")
# Mean normals round the touched points, and poses of first touch.
Stances = namedtuple("Stances", "normals poses")
# Poses, how far the first contact lies behind them, and whether more of the gel is in the way.
Advances = namedtuple("Advances", "poses contact_offset blocked")
# Radius of the ball whose mean normal counts, and `gel.gel_constants`.
Gel = namedtuple("Gel", "contact_radius constants")
# Low and high corner of the sensor's housing, and diagonals of the objects.
Housing = namedtuple("Housing", "corners diagonals")
# Which touches are blocked, and how far from the gel faces count for each.
Margins = namedtuple("Margins", "blocked margins")
# Touches of objects at poses, whether they are blocked, and where their lists of faces begin.
Presses = namedtuple("Presses", "objects poses blocked starts")
# Faces near the gels: bounds of their indentation, their indices, and corners in the sensor's frame.
Near = namedtuple("Near", "bounds faces corners")
# The camera's place, slopes u and v of its rays, its near plane, and rays of a pixel.
CameraRays = namedtuple("CameraRays", "camera u v near of_pixel")
# Of each face planes, normal map, rows and columns; of each touch rows and columns with any face.
Projections = namedtuple("Projections", "planes maps windows reach")
# Working memory of a search for faces.
Search = namedtuple("Search", "box corners working")
# Working memory of a list of faces.
Listing = namedtuple("Listing", "box faces corners bounds")
# Working memory of the projection of a face.
Projecting = namedtuple("Projecting", "box edges normal_map")


@scalar
def tree_of(trees, number):
    """Return the tree of an object, and the number of its first face."""
    some, after = trees.offsets[number], trees.offsets[number + 1]
    boxes, order = trees.boxes[some[0] : after[0]], trees.order[some[1] : after[1]]
    return Tree(boxes, order, trees.triangles[some[2] : after[2]]), some[2]


@scalar
def greatest_indentation(tree, pose, gel, least, search):
    """`indentation.deepest` of the faces of `near_gel`, which are not listed but looked at at once."""
    (boxes, order, triangles), (box, corners, working) = tree, search
    leaves, greatest, node = len(order), 0.0, np.int64(0)
    while node >= 0:
        _bound_box(boxes[node], pose, box)
        near = _indentation_bound(box, gel) > max(least, greatest)
        if near and node < leaves - 1:
            node = 2 * node + 1
            continue
        if near:
            for slot in range(order.shape[1]):
                face = order[node - leaves + 1, slot]
                if face >= 0:
                    _transform(triangles[face], pose, corners)
                    _bound_triangle(corners, box)
                    if _indentation_bound(box, gel) > max(least, greatest):
                        greatest = max(greatest, indentation(corners, gel, working))
        node = _behind(node)
    return greatest


def _locate(query, objects, points, trees: Trees, face, barycentric, stack):
    """Write the face of its object that is nearest to a point, and barycentric coordinates there."""
    row = slice(query, query + 1)
    tree, _ = tree_of(trees, objects[query])
    closest(tree, points[row], stack, face[row], barycentric[row])


def _find(touch, objects, places: Places, surfaces: Surfaces, radius, contacts: Contacts, span):
    """Write the touched point, its shading normal and how many faces are in the ball round it."""
    face, barycentric = places
    touched, shading, counts = contacts
    tree, first = tree_of(surfaces, objects[touch])
    triangles, corner_normals = surfaces.triangles, surfaces.corner_normals
    first, squared = first + face[touch], 0.0
    for axis in range(3):
        at, normal = 0.0, 0.0
        for corner in range(3):
            at += barycentric[touch, corner] * triangles[first, corner, axis]
            normal += barycentric[touch, corner] * corner_normals[first, corner, axis]
        touched[touch, axis], shading[touch, axis] = at, normal
        squared += normal * normal
    length = math.sqrt(squared)
    for axis in range(3):
        normal = shading[touch, axis] / max(length, 1e-300)
        shading[touch, axis] = normal if length > 1e-12 else surfaces.face_normals[first, axis]
    # Without room for them faces are only counted.
    counts[touch] = in_balls(tree, touched[touch : touch + 1], radius, span, objects[0:0])


def _stand(
    touch, objects, approaches: Approaches, surfaces: Surfaces, gel: Gel, lists: Lists, stances: Stances, span
):  # fmt: skip
    """Write the mean normal round the touched point and the pose of first touch."""
    touched, shading, angles = approaches
    (radius, constants), (normals, poses), starts = gel, stances, lists.starts
    tree, first = tree_of(surfaces, objects[touch])
    row = slice(touch, touch + 1)
    members = lists.faces[starts[touch] : starts[touch + 1]]
    in_balls(tree, touched[row], radius, span, members)
    span[0], span[1] = 0, len(members)
    contact_normals(
        touched[row], shading[row], span, members, tree.triangles,
        surfaces.face_normals[first : first + len(tree.triangles)], radius, normals[row],
    )  # fmt: skip
    pose = poses[touch]
    for column in range(4):
        pose[3, column] = 1.0 if column == 3 else 0.0
    tilt, azimuth, roll = angles[touch, 0], angles[touch, 1], angles[touch, 2]
    first_touch_pose(touched[touch], normals[touch], tilt, azimuth, roll, constants, pose)


def _advance(touch, objects, depths, trees: Trees, gel, advances: Advances, search: Search):
    """Move the pose on by a depth from its first contact, and write whether more of the gel is in the way."""
    tree, _ = tree_of(trees, objects[touch])
    pose, depth = advances.poses[touch], depths[touch]
    before = greatest_indentation(tree, pose, gel, -depth, search)
    advance = depth - before
    for axis in range(3):
        pose[axis, 3] += advance * pose[axis, 0]
    if advance < 0:
        after_all = greatest_indentation(tree, pose, gel, 0.0, search)
    else:
        after_all = before + advance
    advances.blocked[touch] = after_all > depth + TOLERANCE_M
    advances.contact_offset[touch] = before


def _fit(
    touch, objects, depths, trees: Trees, housing: Housing, advances: Advances, reachable, search: Search
):  # fmt: skip
    """Write whether a pose, a depth from its first contact, touches the asked point and has room."""
    (poses, contact_offset, blocked), (box, corners, working) = advances, search
    tree, _ = tree_of(trees, objects[touch])
    fits = not blocked[touch] and contact_offset[touch] <= depths[touch] + TOLERANCE_M
    if fits:
        half, low, high = working[0], working[1], housing.corners[1]
        for axis in range(3):
            low[axis] = housing.corners[0, axis]
            if axis == 0:  # its way there is straight
                low[axis] -= housing.diagonals[objects[touch]]
            half[axis] = (high[axis] - low[axis]) / 2
        fits = not enters_box(tree, poses[touch], low, high, half, corners, box)
    reachable[touch] = fits


def _penetrate(touch, objects, poses, trees: Trees, gel, penetration, search: Search):
    """Write the deepest indentation of the gel at a pose."""
    tree, _ = tree_of(trees, objects[touch])
    penetration[touch] = greatest_indentation(tree, poses[touch], gel, 0.0, search)


def _count(touch, objects, poses, trees: Trees, gel, margins: Margins, counts, listing: Listing):
    """Write how many rows the faces a margin from the gel need: one more than there are; 1 where blocked."""
    (box, faces, corners, bounds), least = listing, -margins.margins[touch]
    counts[touch] = 1
    if not margins.blocked[touch]:
        tree, _ = tree_of(trees, objects[touch])
        # Room for none: faces are only counted.
        counts[touch] += near_gel(tree, poses[touch], gel, least, box, faces, corners, bounds)


@scalar
def _span(a, b, c, first, pitch, rays, count):
    """First and last pixel that may hold a slope between the least and greatest of three."""
    a, b, c = (a - first) / pitch, (b - first) / pitch, (c - first) / pitch
    low = math.floor(max(min(min(a, b), c) / rays - 0.5, 0.0))
    high = math.ceil(min(max(max(a, b), c) / rays + 0.5, count - 1.0))
    return low, high


def _project(
    touch, presses: Presses, surfaces: Surfaces, gel, camera_rays: CameraRays, near_gels: Near,
    projections: Projections, projecting: Projecting,
):  # fmt: skip
    """Write of each face near the gel what its pixels need, and the rows and columns that it may cover."""
    objects, poses, blocked, starts = presses
    (camera, u, v, near, rays), (bounds, faces, corners) = camera_rays, near_gels
    (planes, maps, windows, reach), (box, edges, normal_map) = projections, projecting
    tree, first_face = tree_of(surfaces, objects[touch])
    start, end = starts[touch], starts[touch + 1]
    height, width = len(v) // rays, len(u)
    reach[touch, 0], reach[touch, 1], reach[touch, 2], reach[touch, 3] = height, -1, width, -1
    count = 0
    if not blocked[touch]:
        count = near_gel(
            tree, poses[touch], gel, 0.0, box, faces[start:end], corners[start:end], bounds[start:end]
        )
    for k in range(start, end):
        windows[k, 0], windows[k, 1], windows[k, 2], windows[k, 3] = 1, 0, 1, 0
        if k - start >= count:
            continue
        triangle = corners[k]
        determinant = _edges(triangle, camera, edges)
        if determinant == 0 or not math.isfinite(1 / determinant):
            continue
        for axis in range(3):
            for corner in range(3):
                planes[k, 3 * corner + axis] = edges[corner, axis] / determinant
            planes[k, 9 + axis] = (edges[0, axis] + edges[1, axis] + edges[2, axis]) / determinant
        _normal_map(edges, surfaces.corner_normals[first_face + faces[k]], poses[touch], normal_map)
        for axis in range(3):
            for along in range(3):
                maps[k, 3 * axis + along] = normal_map[axis, along]
        x0, x1, x2 = triangle[0, 0] - camera[0], triangle[1, 0] - camera[0], triangle[2, 0] - camera[0]
        low_i, high_i, low_j, high_j = 0, height - 1, 0, width - 1
        if x0 > near and x1 > near and x2 > near:
            low_i, high_i = _span(
                (triangle[0, 2] - camera[2]) / x0, (triangle[1, 2] - camera[2]) / x1,
                (triangle[2, 2] - camera[2]) / x2, v[0], v[1] - v[0], rays, height,
            )  # fmt: skip
            low_j, high_j = _span(
                (triangle[0, 1] - camera[1]) / x0, (triangle[1, 1] - camera[1]) / x1,
                (triangle[2, 1] - camera[1]) / x2, u[0], u[1] - u[0], 1, width,
            )  # fmt: skip
        windows[k, 0], windows[k, 1], windows[k, 2], windows[k, 3] = low_i, high_i, low_j, high_j
        if low_i <= high_i and low_j <= high_j:
            reach[touch, 0], reach[touch, 1] = min(reach[touch, 0], low_i), max(reach[touch, 1], high_i)
            reach[touch, 2], reach[touch, 3] = min(reach[touch, 2], low_j), max(reach[touch, 3], high_j)


_TRIANGLE, _BOX = ((3, 3), np.float64), ((6,), np.float64)
locate = Body(_locate, stack=((TREE_STACK,), np.int64))
find = Body(_find, span=((2,), np.int64))
stand = Body(_stand, span=((2,), np.int64))
advance = Body(_advance, box=_BOX, corners=_TRIANGLE, working=_TRIANGLE)
fit = Body(_fit, box=_BOX, corners=_TRIANGLE, working=_TRIANGLE)
penetrate = Body(_penetrate, box=_BOX, corners=_TRIANGLE, working=_TRIANGLE)
count = Body(
    _count, box=_BOX, faces=((1,), np.int64), corners=((1, 3, 3), np.float64), bounds=((1,), np.float64)
)
project = Body(_project, box=_BOX, edges=_TRIANGLE, normal_map=_TRIANGLE)
