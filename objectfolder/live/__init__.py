"""Objects inside a running simulation of physics: what they sound like as they fall and collide."""

from objectfolder.live.contacts import Simulation, Touching
from objectfolder.live.mujoco_simulation import MujocoSimulation
from objectfolder.live.sound import Impact, LiveSound

__all__ = ["Impact", "LiveSound", "MujocoSimulation", "Simulation", "Touching"]
