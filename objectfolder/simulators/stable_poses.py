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
# Of objects close together: directions from the middle that are tried, and metres between places along them.
DIRECTIONS, STEP_M = 16, 0.005
UPRIGHT = 0.99  # cosine of the angle of an object's own z axis with the vertical
MARGIN = 1.35  # of the table's side, over that which the objects take


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


def upright_pose(poses: Sequence[StablePose]) -> StablePose:
    """Return the most probable pose that leaves the object's own z axis up; the most probable where none does."""
    upright = [pose for pose in poses if pose.object_to_world[2, 2] > UPRIGHT]
    return max(upright or poses, key=lambda pose: pose.probability)


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
        Objects rest as their own z axis has it where they can (`upright_pose`); else in a pose drawn by its
        probability.

    Raises
    ------
    InputError
        No room was found.
    """
    rng = np.random.default_rng(seed)
    turned = [_turned(asset, upright, rng) for asset in assets]
    footprints = [_footprint(asset, pose) for asset, pose in zip(assets, turned, strict=True)]
    if side_m is None:
        places = _close_together([radius for _, radius in footprints], rng)
    else:
        places = _spread([radius for _, radius in footprints], side_m, [asset.name for asset in assets], rng)
    for pose, (middle, _), place in zip(turned, footprints, places, strict=True):
        pose[:2, 3] += place - middle
        pose[2, 3] += height_m
    return turned


def table_side(assets: Sequence[Asset], poses: Sequence[Floats]) -> float:
    """Return the side of a square table round the origin that has a margin beside all objects, metres."""
    reach = 0.0
    for asset, pose in zip(assets, poses, strict=True):
        middle, radius = _footprint(asset, pose)
        reach = max(reach, float(np.abs(middle).max()) + radius)
    return float(np.ceil(2 * MARGIN * reach * 100) / 100)


def _turned(asset: Asset, upright: bool, rng: np.random.Generator) -> Floats:
    """Return a pose at rest, turned at random about the vertical."""
    poses = stable_poses(asset)
    shares = np.array([pose.probability for pose in poses])
    drawn = poses[rng.choice(len(poses), p=shares / shares.sum())]
    pose = upright_pose(poses) if upright else drawn
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return turn @ pose.object_to_world


def _footprint(asset: Asset, pose: Floats) -> tuple[Floats, float]:
    """Return the middle (2,) and the radius of the circle that an object takes on the table."""
    corners = np.concatenate([hull.vertices for hull in asset.collision.hulls])
    corners = corners @ pose[:3, :3].T + pose[:3, 3]
    middle = (corners[:, :2].min(axis=0) + corners[:, :2].max(axis=0)) / 2
    return middle, float(np.linalg.norm(corners[:, :2] - middle, axis=1).max())


def _spread(
    radii: Sequence[float], side_m: float, names: Sequence[str], rng: np.random.Generator
) -> list[Floats]:
    """Return places (2,) all over a table, drawn until no circles overlap."""
    places: list[Floats] = []
    for radius, name in zip(radii, names, strict=True):
        room = side_m / 2 - radius
        for _ in range(DRAWS if room >= 0 else 0):
            place = rng.uniform(-room, room, 2)
            if _is_free(place, radius, places, radii):
                break
        else:
            finding = f"no room on a table of {side_m:g} m beside {len(places)} other objects"
            raise InputError(name, finding, "Name fewer objects, or give a larger --table.")
        places.append(place)
    return places


def _close_together(radii: Sequence[float], rng: np.random.Generator) -> list[Floats]:
    """Return places (2,), each as near the middle as a circle comes in some random direction, then centred."""
    places: list[Floats] = []
    for radius in radii:
        ways = rng.uniform(0, 2 * np.pi, DIRECTIONS)
        steps = np.arange(0.0, sum(radii) * 2 + len(radii) * GAP_M, STEP_M)
        tried = (
            distance * np.array([np.cos(way), np.sin(way)]) for distance in steps for way in ways
        )  # nearer ones first
        places.append(next(place for place in tried if _is_free(place, radius, places, radii)))
    around = np.array(places), np.array(radii)[:, None]
    middle = ((around[0] - around[1]).min(axis=0) + (around[0] + around[1]).max(axis=0)) / 2
    return [place - middle for place in places]


def _is_free(place: Floats, radius: float, places: Sequence[Floats], radii: Sequence[float]) -> bool:
    """Return whether a circle overlaps none of those that have places."""
    return all(
        np.linalg.norm(place - other) > radius + taken + GAP_M
        for other, taken in zip(places, radii, strict=False)
    )
