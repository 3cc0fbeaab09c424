"""Simulators that plugins bring."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import InputError
from objectfolder.live.contacts import Simulation
from objectfolder.plugins import SIMULATORS, find_plugin, plugin_names

OWN = ("mujoco",)


def open_simulation(simulator: str, scene: Path, poses: Mapping[str, NDArray[np.float64]]) -> Simulation:
    """Open a scene in a plugin's simulator.

    Parameters
    ----------
    simulator
        Name of an entry point of the group ``objectfolder.simulators``; called with `scene` and `poses`.
    scene
        MJCF as ``objectfolder scene`` writes it, the assets beside it.
    poses
        (4, 4) object to world, metres, of each body at the beginning; none moves yet.

    Raises
    ------
    InputError
        No such plugin, or one that makes no `objectfolder.live.Simulation`.
    """
    plugin = find_plugin(SIMULATORS, simulator, OWN)
    if plugin is None:
        names = ", ".join([*OWN, *plugin_names(SIMULATORS)])
        raise InputError("simulator", f"{simulator!r} is not known", f"Known: {names}.")
    simulation: Simulation = plugin.part(scene, poses)
    members = [name for name in dir(Simulation) if not name.startswith("_")]
    if absent := [name for name in members if not hasattr(simulation, name)]:
        finding = f"makes an object of type {type(simulation).__name__} without {', '.join(absent)}"
        raise plugin.error(finding, "docs/live.md says what a simulation has.")
    return simulation
