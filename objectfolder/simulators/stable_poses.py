"""Poses in which an object rests on a plane, and objects laid out on it without overlap."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import InputError
from objectfolder.extras import needs_extra
from objectfolder.simulators.asset import Asset

Floats = NDArray[np.float64]
# Room between neighbours, and how often a place is drawn before the table counts as full.
GAP_M = 0.01
DRAWS = 2000


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
    """
    with needs_extra("factory"):
        import trimesh
    vertices = np.concatenate([hull.vertices for hull in asset.collision.hulls])
    hull = trimesh.convex.convex_hull(vertices)
    poses, shares = trimesh.poses.compute_stable_poses(
        hull, center_mass=np.asarray(asset.body.centre_of_mass_m), sigma=0.0, n_samples=1, threshold=0.0
    )
    order = np.argsort(-shares, kind="stable")
    found = [StablePose(poses[at], float(shares[at])) for at in order if shares[at] >= least_probability]
    return found or [StablePose(poses[order[0]], float(shares[order[0]]))]


def lay_out(assets: Sequence[Asset], side_m: float, *, height_m: float = 0.0, seed: int = 0) -> list[Floats]:
    """Return a pose (4, 4) for each asset on a square table, at rest, turned at random, none overlapping.

    Parameters
    ----------
    side_m
        Of the table, centred at the origin.
    height_m
        Of its top.
    seed
        Of stable poses, turns and places.

    Raises
    ------
    InputError
        No room was found.
    """
    rng = np.random.default_rng(seed)
    placed: list[tuple[Floats, float]] = []
    result = []
    for asset in assets:
        poses = stable_poses(asset)
        shares = np.array([pose.probability for pose in poses])
        pose = poses[rng.choice(len(poses), p=shares / shares.sum())].object_to_world.copy()
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        pose = turn @ pose
        corners = np.concatenate([hull.vertices for hull in asset.collision.hulls])
        corners = corners @ pose[:3, :3].T + pose[:3, 3]
        middle = (corners[:, :2].min(axis=0) + corners[:, :2].max(axis=0)) / 2
        radius = float(np.linalg.norm(corners[:, :2] - middle, axis=1).max())
        room = side_m / 2 - radius
        for _ in range(DRAWS if room >= 0 else 0):
            place = rng.uniform(-room, room, 2)
            if all(np.linalg.norm(place - other) > radius + taken + GAP_M for other, taken in placed):
                break
        else:
            finding = f"no room on a table of {side_m:g} m beside {len(placed)} other objects"
            raise InputError(asset.name, finding, "Name fewer objects, or give a larger --table.")
        placed.append((place, radius))
        pose[:2, 3] += place - middle
        pose[2, 3] += height_m
        result.append(pose)
    return result
