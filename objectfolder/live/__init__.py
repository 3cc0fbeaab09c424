"""Objects inside a running simulation: seen together, heard as they collide and roll, felt by fingers."""

from typing import TYPE_CHECKING

from objectfolder.lazy import lazy_names

if TYPE_CHECKING:
    from objectfolder.live.contacts import Simulation, Touching
    from objectfolder.live.environments import Squeeze, Strike
    from objectfolder.live.gripper import standing
    from objectfolder.live.mujoco_simulation import MujocoSimulation
    from objectfolder.live.pybullet_simulation import PybulletSimulation
    from objectfolder.live.resting import Rest
    from objectfolder.live.sight import LiveSight, SceneImage
    from objectfolder.live.simulators import open_simulation
    from objectfolder.live.sound import Impact, LiveSound
    from objectfolder.live.touch import Felt, Finger, LiveTouch
else:
    __getattr__, __dir__ = lazy_names(
        __name__,
        {
            "contacts": ["Simulation", "Touching"],
            "environments": ["Squeeze", "Strike"],
            "gripper": ["standing"],
            "mujoco_simulation": ["MujocoSimulation"],
            "pybullet_simulation": ["PybulletSimulation"],
            "resting": ["Rest"],
            "sight": ["LiveSight", "SceneImage"],
            "simulators": ["open_simulation"],
            "sound": ["Impact", "LiveSound"],
            "touch": ["Felt", "Finger", "LiveTouch"],
        },
    )

__all__ = [
    "Felt",
    "Finger",
    "Impact",
    "LiveSight",
    "LiveSound",
    "LiveTouch",
    "MujocoSimulation",
    "PybulletSimulation",
    "Rest",
    "SceneImage",
    "Simulation",
    "Squeeze",
    "Strike",
    "Touching",
    "open_simulation",
    "standing",
]
