"""Where the sensor stands in each of many touches of several objects, and which faces are near its gel.

The arrays of all objects follow each other; `offsets` (objects + 1, 3) says where the boxes, leaves and faces
of each begin. Each function computes one touch, in double precision, by the kernels of a single press.
"""

# Bodies are compiled for the types they meet.
# mypy: disable-error-code="no-untyped-def"

import math

import numpy as np

from objectfolder.batch.targets import Body, compiled_copy, scalar
from objectfolder.touch.contact import first_touch
from objectfolder.touch.contact.first_touch import contact_normals
from objectfolder.touch.contact.indentation import indentation
from objectfolder.touch.contact.tree_queries import (
    TREE_STACK,
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
from objectfolder.touch.rendering.gather import _normal_map
from objectfolder.touch.rendering.rasterise import _edges
from objectfolder.touch.truth.touches import TOLERANCE_M

first_touch_pose = compiled_copy(
    first_touch._first_touch_pose,
    _contact_frame=scalar(first_touch._contact_frame),
    _tilt=scalar(first_touch._tilt),
    _roll=scalar(first_touch._roll),
)
# Numbers of a face for the pixels: of each corner's plane and of one over the depth, along 1, u and v.
FACE_NUMBERS = 12


@scalar
def greatest_indentation(boxes, order, triangles, pose, gel, least, box, corners, working):
    """`indentation.deepest` of the faces of `near_gel`, which are not listed but looked at at once."""
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


def _locate(
    query, objects, points, offsets, boxes, order, triangles, face, barycentric, stack
):  # fmt: skip
    """Write the face of its object that is nearest to a point, and barycentric coordinates there."""
    some, after, row = offsets[objects[query]], offsets[objects[query] + 1], slice(query, query + 1)
    closest(
        boxes[some[0] : after[0]], order[some[1] : after[1]], triangles[some[2] : after[2]], points[row],
        stack, face[row], barycentric[row],
    )  # fmt: skip


def _find(
    touch, objects, face, barycentric, offsets, boxes, order, triangles, face_normals, corner_normals, radius,
    touched, shading, counts, span,
):  # fmt: skip
    """Write the touched point, its shading normal and how many faces are in the ball round it."""
    some, after = offsets[objects[touch]], offsets[objects[touch] + 1]
    first, squared = some[2] + face[touch], 0.0
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
        shading[touch, axis] = normal if length > 1e-12 else face_normals[first, axis]
    # Without room for them faces are only counted.
    counts[touch] = in_balls(
        boxes[some[0] : after[0]], order[some[1] : after[1]], touched[touch : touch + 1], radius, span,
        objects[0:0],
    )  # fmt: skip


def _stand(
    touch, objects, touched, shading, angles, offsets, boxes, order, triangles, face_normals, radius, gel,
    starts, listed, normals, poses, span,
):  # fmt: skip
    """Write the mean normal round the touched point and the pose of first touch."""
    some, after = offsets[objects[touch]], offsets[objects[touch] + 1]
    row = slice(touch, touch + 1)
    members = listed[starts[touch] : starts[touch + 1]]
    in_balls(
        boxes[some[0] : after[0]], order[some[1] : after[1]], touched[row], radius, span, members
    )  # fmt: skip
    span[0], span[1] = 0, len(members)
    contact_normals(
        touched[row], shading[row], span, members, triangles[some[2] : after[2]],
        face_normals[some[2] : after[2]], radius, normals[row],
    )  # fmt: skip
    pose = poses[touch]
    for column in range(4):
        pose[3, column] = 1.0 if column == 3 else 0.0
    tilt, azimuth, roll = angles[touch, 0], angles[touch, 1], angles[touch, 2]
    first_touch_pose(touched[touch], normals[touch], tilt, azimuth, roll, gel, pose)


def _advance(
    touch, objects, depths, offsets, boxes, order, triangles, gel, poses, contact_offset, blocked,
    box, corners, working,
):  # fmt: skip
    """Move the pose on by a depth from its first contact, and write whether more of the gel is in the way."""
    some, after = offsets[objects[touch]], offsets[objects[touch] + 1]
    nodes, leaves = boxes[some[0] : after[0]], order[some[1] : after[1]]
    faces, pose, depth = triangles[some[2] : after[2]], poses[touch], depths[touch]
    before = greatest_indentation(nodes, leaves, faces, pose, gel, -depth, box, corners, working)
    advance = depth - before
    for axis in range(3):
        pose[axis, 3] += advance * pose[axis, 0]
    if advance < 0:
        after_all = greatest_indentation(nodes, leaves, faces, pose, gel, 0.0, box, corners, working)
    else:
        after_all = before + advance
    blocked[touch] = after_all > depth + TOLERANCE_M
    contact_offset[touch] = before


def _fit(
    touch, objects, depths, offsets, boxes, order, triangles, housing, diagonals, poses, contact_offset,
    blocked, reachable, box, corners, working, low,
):  # fmt: skip
    """Write whether a pose, a depth from its first contact, touches the asked point and has room."""
    some, after = offsets[objects[touch]], offsets[objects[touch] + 1]
    fits = not blocked[touch] and contact_offset[touch] <= depths[touch] + TOLERANCE_M
    if fits:
        for axis in range(3):
            low[axis] = housing[0, axis]
            if axis == 0:  # its way there is straight
                low[axis] -= diagonals[objects[touch]]
            working[0, axis] = (housing[1, axis] - low[axis]) / 2
        fits = not enters_box(
            boxes[some[0] : after[0]], order[some[1] : after[1]], triangles[some[2] : after[2]], poses[touch],
            low, housing[1], working[0], corners, box,
        )  # fmt: skip
    reachable[touch] = fits


def _penetrate(
    touch, objects, poses, offsets, boxes, order, triangles, gel, penetration, box, corners, working
):
    """Write the deepest indentation of the gel at a pose."""
    some, after = offsets[objects[touch]], offsets[objects[touch] + 1]
    penetration[touch] = greatest_indentation(
        boxes[some[0] : after[0]], order[some[1] : after[1]], triangles[some[2] : after[2]], poses[touch],
        gel, 0.0, box, corners, working,
    )  # fmt: skip


def _count(
    touch, objects, poses, offsets, boxes, order, triangles, gel, blocked, margins, counts,
    box, faces, corners, bounds,
):  # fmt: skip
    """Write how many rows the faces a margin from the gel need: one more than there are; 1 where blocked."""
    some, after = offsets[objects[touch]], offsets[objects[touch] + 1]
    counts[touch] = 1
    if not blocked[touch]:
        # Room for none: faces are only counted.
        counts[touch] += near_gel(
            boxes[some[0] : after[0]], order[some[1] : after[1]], triangles[some[2] : after[2]], poses[touch],
            gel, -margins[touch], box, faces, corners, bounds,
        )  # fmt: skip


@scalar
def _span(a, b, c, first, pitch, rays, count):
    """First and last pixel that may hold a slope between the least and greatest of three."""
    a, b, c = (a - first) / pitch, (b - first) / pitch, (c - first) / pitch
    low = math.floor(max(min(min(a, b), c) / rays - 0.5, 0.0))
    high = math.ceil(min(max(max(a, b), c) / rays + 0.5, count - 1.0))
    return low, high


def _project(
    touch, objects, poses, offsets, boxes, order, triangles, corner_normals, gel, blocked, starts,
    camera, u, v, near, rays, bounds, faces, corners, planes, maps, windows, reach, box, edges, map_,
):  # fmt: skip
    """Write of each face near the gel what its pixels need, and the rows and columns that it may cover."""
    some, after = offsets[objects[touch]], offsets[objects[touch] + 1]
    start, end = starts[touch], starts[touch + 1]
    height, width = len(v) // rays, len(u)
    reach[touch, 0], reach[touch, 1], reach[touch, 2], reach[touch, 3] = height, -1, width, -1
    count = 0
    if not blocked[touch]:
        count = near_gel(
            boxes[some[0] : after[0]], order[some[1] : after[1]], triangles[some[2] : after[2]], poses[touch],
            gel, 0.0, box, faces[start:end], corners[start:end], bounds[start:end],
        )  # fmt: skip
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
        _normal_map(edges, corner_normals[some[2] + faces[k]], poses[touch], map_)
        for axis in range(3):
            for along in range(3):
                maps[k, 3 * axis + along] = map_[axis, along]
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
fit = Body(_fit, box=_BOX, corners=_TRIANGLE, working=_TRIANGLE, low=((3,), np.float64))
penetrate = Body(_penetrate, box=_BOX, corners=_TRIANGLE, working=_TRIANGLE)
count = Body(
    _count, box=_BOX, faces=((1,), np.int64), corners=((1, 3, 3), np.float64), bounds=((1,), np.float64)
)
project = Body(_project, box=_BOX, edges=_TRIANGLE, map_=_TRIANGLE)
