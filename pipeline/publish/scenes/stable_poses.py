"""Poses in which an object rests on a plane, and objects laid out on it without overlap."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from objectfolder.errors import InputError
from objectfolder.extras import needs_extra
from objectfolder.simulators.asset import Asset

Floats = NDArray[np.float64]
Circle = tuple[Floats, float]  # what an object takes on the table: middle (2,) and radius, metres
# Room between neighbours, and how often a place is drawn before the table counts as full.
GAP_M = 0.01
DRAWS = 2000
# Of objects close together: directions from the middle that are tried, and metres between places along them.
DIRECTIONS, PLACE_STEP_M = 16, 0.005
LEVEL = 1e-2  # of its height, that what touches the plane may be above it
TABLE_MARGIN = 1.35  # of the table's side, over that which the objects take


@dataclass(frozen=True)
class StablePose:
    """A pose at rest on the plane z = 0.

    Parameters
    ----------
    object_to_world
        (4, 4) rigid.
    probability
        That the object, turned at random and let down, comes to rest so: the share of directions.
    """

    object_to_world: Floats
    probability: float


def stable_poses(asset: Asset, *, least_probability: float = 0.05) -> list[StablePose]:
    """Return poses at rest of an asset's collision shapes on a plane, most probable first.

    Goldberg, Mirtich, Zhuang, Craig, Carlisle and Canny, "Part pose statistics" (1999), as in trimesh.

    Raises
    ------
    InputError
        A centre of mass outside the hull of the parts.
    """
    with needs_extra("factory"):
        import trimesh
    vertices = np.concatenate([hull.vertices for hull in asset.collision.hulls])
    hull = trimesh.convex.convex_hull(vertices)
    centre = np.asarray(asset.body.centre_of_mass_m)
    sides = ConvexHull(vertices).equations
    if (sides[:, :3] @ centre + sides[:, 3] > 0).any():  # it would fall over for ever
        finding = "its centre of mass is not within its convex parts, so it rests nowhere"
        raise InputError(asset.name, finding, "Check that its mesh encloses a solid, or give more parts.")
    poses, shares = trimesh.poses.compute_stable_poses(
        hull, center_mass=centre, sigma=0.0, n_samples=1, threshold=0.0
    )
    order = np.argsort(-shares, kind="stable")
    rests = [StablePose(poses[at], float(shares[at])) for at in order if shares[at] >= least_probability]
    return rests or [StablePose(poses[order[0]], float(shares[order[0]]))]


def standing(asset: Asset) -> Floats | None:
    """Return the pose (4, 4) in which an asset stands on the plane z = 0 as its own z axis has it, or None.

    It stands where its centre of mass is above the inside of what touches the plane.
    """
    corners = np.concatenate([hull.vertices for hull in asset.collision.hulls])
    low_m, high_m = corners[:, 2].min(), corners[:, 2].max()
    feet = corners[corners[:, 2] <= low_m + LEVEL * (high_m - low_m), :2]
    try:
        sides = ConvexHull(feet).equations
    except (QhullError, ValueError):  # a point or a line
        return None
    centre = np.asarray(asset.body.centre_of_mass_m)[:2]
    if (sides[:, :2] @ centre + sides[:, 2] >= 0).any():
        return None
    pose = np.eye(4)
    pose[2, 3] = -low_m
    return pose


def lay_out(
    assets: Sequence[Asset],
    side_m: float | None = None,
    *,
    height_m: float = 0.0,
    seed: int = 0,
    upright: bool = False,
) -> list[Floats]:
    """Return a pose (4, 4) for each asset on a square table, at rest, turned at random, none overlapping.

    Parameters
    ----------
    side_m
        Of the table, centred at the origin. None: objects stand as close to the middle as they come.
    height_m
        Of its top.
    seed
        Of stable poses, turns and places.
    upright
        Objects rest as their own z axis has it where they can (`standing`), else in their most probable pose.
        If false, poses are drawn by their probability.

    Raises
    ------
    InputError
        No room was found.
    """
    rng = np.random.default_rng(seed)
    circles: list[Circle] = []
    poses = []
    for asset in assets:
        pose = _turned(asset, upright, rng)
        middle, radius = _footprint(asset, pose)
        place = (
            _near_middle(radius, circles, rng) if side_m is None else _anywhere(radius, circles, side_m, rng)
        )
        if place is None:
            finding = f"no room on a table of {side_m:g} m beside {len(circles)} other objects"
            raise InputError(asset.name, finding, "Name fewer objects, or give a larger --table.")
        circles.append((place, radius))
        pose[:2, 3] += place - middle
        pose[2, 3] += height_m
        poses.append(pose)
    if side_m is None and poses:
        low = np.min([place - radius for place, radius in circles], axis=0)
        high = np.max([place + radius for place, radius in circles], axis=0)
        for pose in poses:
            pose[:2, 3] -= (low + high) / 2
    return poses


def table_side(assets: Sequence[Asset], poses: Sequence[Floats]) -> float:
    """Return the side of a square table round the origin that has a margin beside all objects, metres."""
    reach = 0.0
    for asset, pose in zip(assets, poses, strict=True):
        middle, radius = _footprint(asset, pose)
        reach = max(reach, float(np.abs(middle).max()) + radius)
    return float(np.ceil(2 * TABLE_MARGIN * reach * 100) / 100)


def _turned(asset: Asset, upright: bool, rng: np.random.Generator) -> Floats:
    """Return a pose at rest, turned at random about the vertical."""
    pose = standing(asset) if upright else None
    if pose is None:
        poses = stable_poses(asset)  # most probable first
        shares = np.array([pose.probability for pose in poses])
        pose_index = 0 if upright else rng.choice(len(poses), p=shares / shares.sum())
        pose = poses[pose_index].object_to_world
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return turn @ pose


def _footprint(asset: Asset, pose: Floats) -> tuple[Floats, float]:
    """Return the middle (2,) and the radius of the circle that an object takes on the table."""
    corners = np.concatenate([hull.vertices for hull in asset.collision.hulls])
    corners = corners @ pose[:3, :3].T + pose[:3, 3]
    middle = (corners[:, :2].min(axis=0) + corners[:, :2].max(axis=0)) / 2
    return middle, float(np.linalg.norm(corners[:, :2] - middle, axis=1).max())


def _anywhere(
    radius: float, circles: Sequence[Circle], side_m: float, rng: np.random.Generator
) -> Floats | None:
    """Return a free place (2,) drawn all over a table; None where there seems to be none."""
    room = side_m / 2 - radius
    draws = (rng.uniform(-room, room, 2) for _ in range(DRAWS if room >= 0 else 0))
    return next((place for place in draws if _is_free(place, radius, circles)), None)


def _near_middle(radius: float, circles: Sequence[Circle], rng: np.random.Generator) -> Floats:
    """Return the free place (2,) nearest the middle, of those in some random directions."""
    ways = rng.uniform(0, 2 * np.pi, DIRECTIONS)
    towards = np.column_stack([np.cos(ways), np.sin(ways)])
    outward = (step * PLACE_STEP_M * way for step in itertools.count() for way in towards)
    return next(place for place in outward if _is_free(place, radius, circles))


def _is_free(place: Floats, radius: float, circles: Sequence[Circle]) -> bool:
    return all(np.linalg.norm(place - centre) > radius + extent + GAP_M for centre, extent in circles)
