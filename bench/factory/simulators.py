"""Scans as assets of simulators: what loads, how well convex parts fit, and whether bodies rest.

    python -m bench simulators --folder FOLDER [--objects CATALOGUE.csv] [--only ID ...]

Engines that are not installed are left out, and named: `pip install pybullet drake sapien` for all. Assets
and rows are kept in FOLDER and not made again, so that a run can be stopped and taken up.
"""

import time
import traceback
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from bench.factory.engines import (
    ENGINES,
    drift_of_angular_momentum,
    rest_in_drake,
    rest_in_mujoco,
    rest_in_pybullet,
    slide_in_mujoco,
)
from bench.record import conclude, cpu_seconds, rows_of
from bench.senses.catalogue import Scans, scan_arguments
from objectfolder.errors import ObjectFolderError
from objectfolder.export.files import Credit
from objectfolder.export.textured_surface import mesh_parts
from objectfolder.making.solid.filling import fill
from objectfolder.simulators.asset import Asset, Contact, RigidBody
from objectfolder.simulators.collision import convex_parts
from objectfolder.simulators.formats import write_asset
from objectfolder.surface.integrals import solid_properties
from objectfolder.vision.appearance import Appearance
from pipeline.publish.scenes.stable_poses import stable_poses

COMPARED = (
    "Assets of scans, made by convex_parts and write_asset with their defaults, as simulators read them; "
    "rest: four seconds from each stable pose of probability above 5 % on a plane"
)
RESTING = {"MuJoCo": rest_in_mujoco, "PyBullet": rest_in_pybullet, "Drake": rest_in_drake}
# Metres, degrees, metres or radians a second, metres: what counts as at rest.
RESTS = {"moved_m": 2e-3, "tilted_deg": 2.0, "speed": 1e-3, "overlap_m": 2e-4}


def main() -> None:
    options = scan_arguments("scans as assets of simulators", "assets and rows", only=()).parse_args()
    scans = Scans(options.objects)
    names = options.only or scans.ids
    table = rows_of(names, lambda name: measure(scans, name, options.folder / name), options.folder)
    conclude("simulators", figures(table), settings(), COMPARED)


def settings() -> dict[str, Any]:
    versions = {}
    for package in ("mujoco", "pybullet", "drake", "sapien", "usd-core", "coacd"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    return {
        "engines": versions,
        "times": "CPU seconds",
        "at_rest": RESTS,
    }


def measure(scans: Scans, name: str, folder: Path) -> dict[str, Any]:
    """One object's row; a failure has its reason."""
    try:
        return _measure(scans, name, folder)
    except ObjectFolderError as error:
        return {"failure": str(error)}
    except Exception:
        return {"failure": traceback.format_exc(limit=1)}


def _measure(scans: Scans, name: str, folder: Path) -> dict[str, Any]:
    mesh, material = scans.mesh(name), scans.material(name)
    surface = scans.surface(name)
    topology = surface.topology
    solid = solid_properties(surface.vertices, surface.faces)
    closed = topology.watertight and topology.consistent
    if not closed:  # as a data set has it: that of the solid that sounds
        filled = fill(surface, name=name)
        solid = solid_properties(filled.vertices, filled.surface.faces)
    density = material.density_kg_m3
    body = RigidBody(
        density * solid.volume_m3, solid.centre_of_mass_m, density * solid.inertia_per_density_m5
    )
    start = cpu_seconds()
    collision = convex_parts(surface, name=name)
    decomposed = cpu_seconds()
    contact = Contact(material.friction or 0.0, material.restitution or 0.0)
    looks = Appearance(roughness=material.roughness, metallic=material.metallic)
    parts = mesh_parts(mesh, looks)
    asset = Asset(name, parts, surface, looks, collision, body, "solid", contact, Credit(name))
    folder.mkdir(parents=True, exist_ok=True)
    write_asset(folder, asset)
    first_load_ms = load_ms(folder)
    length = float(np.ptp(surface.bounds, axis=0).max())
    flat, *_ = poses = stable_poses(asset)
    return {
        "failure": None,
        "closed": closed,
        **collision.to_dict(),
        "outward_share": collision.outward_m / length,
        "inward_share": collision.inward_m / length,
        "decompose_cpu_s": decomposed - start,
        "read": read(asset, folder, length),
        "rest": [rests(folder, pose.object_to_world) | {"probability": pose.probability} for pose in poses],
        "slide_over_friction": slide_in_mujoco(folder, flat.object_to_world, contact.friction),
        "angular_momentum_drift": drift_of_angular_momentum(folder),
        "step_us": step_us(folder, flat.object_to_world),
        "load_ms": first_load_ms,
    }


def read(asset: Asset, folder: Path, length_m: float) -> dict[str, Any]:
    """The worst relative error of mass, centre and moments by engine and format; or why it does not load."""
    errors: dict[str, Any] = {}
    for engine, (reader, kinds) in ENGINES.items():
        for kind in kinds:
            try:
                errors[f"{engine} {kind}"] = reader(folder, kind).worst_relative(asset.body, length_m)
            except Exception as error:
                errors[f"{engine} {kind}"] = repr(error)
    return errors


def rests(folder: Path, pose: np.ndarray) -> dict[str, Any]:
    outcome: dict[str, Any] = {}
    up = {}
    for engine in (engine for engine in RESTING if engine in ENGINES):
        rest = RESTING[engine](folder, pose)
        up[engine] = rest.pose[2, :3]
        outcome[engine] = {name: getattr(rest, name) for name in RESTS}
    for engine in up.keys() - {"MuJoCo"}:
        apart = np.clip(up["MuJoCo"] @ up[engine], -1, 1)
        outcome[engine]["from_mujoco_deg"] = float(np.degrees(np.arccos(apart)))
    return outcome


def step_us(folder: Path, pose: np.ndarray) -> float:
    """CPU microseconds of a MuJoCo step of 2 ms: those of two more seconds of simulation."""
    cpu_s = []
    for time_s in (1.0, 3.0):
        start = time.process_time()
        rest_in_mujoco(folder, pose, time_s=time_s)
        cpu_s.append(time.process_time() - start)
    return (cpu_s[1] - cpu_s[0]) / 1000 * 1e6


def load_ms(folder: Path) -> float:
    """CPU milliseconds of MuJoCo's first reading of the folder; it keeps meshes for the next."""
    import mujoco

    start = time.process_time()
    mujoco.MjModel.from_xml_path(str(folder / "object.xml"))
    return (time.process_time() - start) * 1e3


def figures(table: dict[str, dict[str, Any]]) -> dict[str, Any]:
    rows = {name: row for name, row in table.items() if row["failure"] is None}
    column = {
        key: np.array([row[key] for row in rows.values()])
        for key in (
            "parts", "union_iou", "outward_share", "inward_share", "decompose_cpu_s", "slide_over_friction",
            "angular_momentum_drift", "step_us", "load_ms",
        )
    }  # fmt: skip
    poses = [(name, rest) for name, row in rows.items() for rest in row["rest"]]
    loads: dict[str, Any] = {}
    for reader in sorted({reader for row in rows.values() for reader in row["read"]}):
        errors = [row["read"][reader] for row in rows.values()]
        numbers = [error for error in errors if isinstance(error, float)]
        loads[reader] = {"loaded": len(numbers), "worst_relative_error": max(numbers, default=None)}

    def moving(engine: str) -> list[str]:
        return [name for name, rest in poses if engine in rest and not at_rest(rest[engine])]

    def apart(engine: str) -> dict[str, Any]:
        """How many poses end within a degree of MuJoCo's, and which objects do not."""
        far = [name for name, rest in poses if engine in rest and rest[engine]["from_mujoco_deg"] > 1]
        both = sum(engine in rest for _, rest in poses)
        return {"poses": both, "within_1_deg": both - len(far), "objects_apart": sorted(set(far))}

    return {
        "objects": {name: {key: row[key] for key in row if key != "rest"} for name, row in table.items()},
        "made": len(rows),
        "failed": {name: row["failure"] for name, row in table.items() if row["failure"]},
        "loads": loads,
        "median": {key: float(np.median(values)) for key, values in column.items()},
        "tenth": {key: float(np.quantile(values, 0.1)) for key, values in column.items()},
        "nine_tenths": {key: float(np.quantile(values, 0.9)) for key, values in column.items()},
        "largest": {key: float(values.max()) for key, values in column.items()},
        "rest": {
            engine: {
                "poses": sum(engine in rest for _, rest in poses),
                "moving": len(moving(engine)),
                "objects_moving": sorted(set(moving(engine))),
            }
            for engine in RESTING
        },
        "apart": {engine: apart(engine) for engine in RESTING if engine != "MuJoCo"},
    }


def at_rest(rest: dict[str, float]) -> bool:
    return all(rest[name] <= limit for name, limit in RESTS.items())
