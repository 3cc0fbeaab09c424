"""``python -m learning.metaworld ASSETS``: do what Meta-World's own scripted policies do, with other objects.

ASSETS has a folder an object, as ``objectfolder export --format mjcf`` writes them. `reach` never touches the
object: it says only that an object loads and rests. `push` and `pick-place` take hold of it.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from metaworld import envs, policies
from scipy.spatial.transform import Rotation

RESULT = Path("learning/results/metaworld.json")
TASKS: dict[str, tuple[Any, Callable[[], Any]]] = {
    "reach": (envs.SawyerReachEnvV3, policies.SawyerReachV3Policy),
    "push": (envs.SawyerPushEnvV3, policies.SawyerPushV3Policy),
    "pick-place": (envs.SawyerPickPlaceEnvV3, policies.SawyerPickPlaceV3Policy),
}
STANDING_M = 0.02  # of the body over the table, wherever Meta-World puts it
# Of the cylinder that Meta-World grasps.
GRIP: dict[str, Any] = {
    "friction": [1.0, 0.1, 0.002], "solref": [0.01, 1.0], "solimp": [0.99, 0.99, 0.01, 0.5, 2.0], "condim": 4
}  # fmt: skip
RESETS = {"reach": 100, "push": 30, "pick-place": 30}  # with each object
STEPS = 500  # of an episode, Meta-World's own
# Of the collision parts: the narrower horizontal side, the other, the height.
FITTING_M = ((0.03, 0.062), (0.03, 0.15), (0.025, 0.12))


def swapped(scene: Path, asset: Path) -> mujoco.MjModel:
    """Return a scene of Meta-World whose body ``obj`` is an object, standing as it does in its own frame.

    The longer of its horizontal sides lies across the way the fingers close. Its centre of mass is over the
    body's origin. Its contacts are those of the cylinder that it stands in for.
    """
    spec = mujoco.MjSpec.from_file(str(scene))
    body = spec.body("obj")
    for geom in body.geoms:
        geom.delete()
    properties = json.loads((asset / "object.json").read_text(encoding="utf-8"))
    parts, points = _parts(asset)
    wide, deep = np.ptp(points[:, :2], axis=0)
    turn = Rotation.from_euler("z", 0.0 if wide >= deep else np.pi / 2)
    centre = turn.apply(properties["centre_of_mass_m"])
    place = np.array([-centre[0], -centre[1], -STANDING_M - points[:, 2].min()])
    for number, part in enumerate(parts):
        spec.add_mesh(name=part.stem, file=str(part.resolve()))
        name = "objGeom" if number == 0 else part.stem  # Meta-World asks for the first
        mesh = {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": part.stem}
        body.add_geom(name=name, pos=place, quat=turn.as_quat(scalar_first=True), **mesh, **GRIP)
    moments, axes = np.linalg.eigh(properties["inertia_kg_m2"])
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    body.mass, body.ipos, body.inertia = properties["mass_kg"], centre + place, moments
    body.iquat = (turn * Rotation.from_matrix(axes)).as_quat(scalar_first=True)
    return spec.compile()


def fits(asset: Path) -> bool:
    """Return whether Meta-World's gripper can close round an object as it stands."""
    *sides, height = np.ptp(_parts(asset)[1], axis=0)
    sizes = (*sorted(sides), height)
    return all(low <= size <= high for size, (low, high) in zip(sizes, FITTING_M, strict=True))


def _parts(asset: Path) -> tuple[list[Path], np.ndarray]:
    """Return the files of the convex parts, and all their vertices (n, 3)."""
    parts = sorted(asset.glob("collision_*.obj"))
    return parts, np.vstack([_vertices(part) for part in parts])


def _vertices(path: Path) -> np.ndarray:
    lines = path.read_text(encoding="utf-8").splitlines()
    return np.array([line.split()[1:4] for line in lines if line.startswith("v ")], dtype=np.float64)


def environment(task: str, asset: Path, seed: int) -> Any:
    """Return Meta-World's environment of a task with an object swapped in, its goals shown."""

    base: Any = TASKS[task][0]

    class Swapped(base):
        def _initialize_simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
            model = swapped(Path(self.fullpath), asset)
            return model, mujoco.MjData(model)

    instance = Swapped()
    # As Meta-World's own environments with goals that are seen.
    instance._partially_observable = instance._freeze_rand_vec = False
    instance._set_task_called = True
    del instance.sawyer_observation_space
    instance.seed(seed)
    return instance


def successes(task: str, asset: Path, resets: int) -> int:
    """Return how many of the episodes succeed at some step, as Meta-World counts."""
    played, policy = environment(task, asset, seed=0), TASKS[task][1]()
    return sum(_succeeds(played, policy) for _ in range(resets))


def _succeeds(played: Any, policy: Any) -> bool:
    observed, _ = played.reset()
    for _ in range(STEPS):
        action = np.clip(policy.get_action(observed), -1, 1)
        observed, _, _, over, info = played.step(action)
        if info["success"] or over:
            break
    return bool(info["success"])


def main() -> None:
    """Write how many resets of each task succeed with each object."""
    parser = argparse.ArgumentParser(prog="python -m learning.metaworld", description=__doc__)
    parser.add_argument("assets", type=Path)
    parser.add_argument("--resets", type=int, help="with each object, in every task")
    parser.add_argument(
        "--fitting",
        action="store_true",
        help="push and pick-place those alone that the gripper can close round",
    )
    parser.add_argument("--result", type=Path, default=RESULT)
    arguments = parser.parse_args()
    assets = sorted(path.parent for path in arguments.assets.glob("*/object.json"))
    if not assets:
        parser.error(
            f"{arguments.assets} has no object: `objectfolder export --format mjcf -o {arguments.assets}`"
        )
    results: dict[str, dict[str, Any]] = {}
    for task in TASKS:
        resets = arguments.resets or RESETS[task]
        row = results[task] = {"resets": resets, "succeeded": {}}
        for asset in assets:
            if arguments.fitting and task != "reach" and not fits(asset):
                continue
            count = row["succeeded"][asset.name] = successes(task, asset, resets)
            print(f"{task}, {asset.name}: {count} of {resets}", flush=True)
    arguments.result.write_text(json.dumps(results, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
