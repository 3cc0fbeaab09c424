"""The memory of a worker, and the pools that it belongs to."""

import importlib.util
import os
from collections.abc import Mapping
from pathlib import Path

from pipeline.dataset.job import BLENDER, GPU

MEMORY = "OBJECTFOLDER_WORKER_MEMORY_GB"  # what tasks may take on a worker
POOLS = (BLENDER, GPU)
USABLE = 0.9  # of a worker's memory, where no setting says how much
NOTHING = "nothing"  # resource of a worker that was started for no pool


def offers_here() -> list[str]:
    """Return the pools that this process can serve, by what is installed; nothing is imported."""
    able = {BLENDER: importlib.util.find_spec("bpy") is not None, GPU: _has_gpu()}
    return [pool for pool, is_installed in able.items() if is_installed]


def stated(resources: Mapping[str, float]) -> list[str]:
    """Return the pools that a worker was started for, else those that it can serve."""
    if any(name in resources for name in (*POOLS, NOTHING)):
        return [pool for pool in POOLS if resources.get(pool)]
    return offers_here()


def _has_gpu() -> bool:
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible is not None and visible.strip() in ("", "-1", "NoDevFiles"):
        return False
    return any(Path("/dev").glob("nvidia[0-9]*")) or Path("/dev/dxg").exists()
