"""Objects inside a running simulation: what they sound like as they collide, roll and scrape."""

from objectfolder.live.contacts import Simulation, Touching
from objectfolder.live.mujoco_simulation import MujocoSimulation
from objectfolder.live.pybullet_simulation import PybulletSimulation
from objectfolder.live.sight import LiveSight, SceneImage
from objectfolder.live.sound import Impact, LiveSound

__all__ = [
    "Impact",
    "LiveSight",
    "LiveSound",
    "MujocoSimulation",
    "PybulletSimulation",
    "SceneImage",
    "Simulation",
    "Touching",
]
