"""Objects inside a running simulation: seen together, heard as they collide and roll, felt by fingers."""

from objectfolder.live.contacts import Simulation, Touching
from objectfolder.live.mujoco_simulation import MujocoSimulation
from objectfolder.live.pybullet_simulation import PybulletSimulation
from objectfolder.live.resting import Rest
from objectfolder.live.sight import LiveSight, SceneImage
from objectfolder.live.sound import Impact, LiveSound
from objectfolder.live.touch import Felt, Finger, LiveTouch

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
    "Touching",
]
