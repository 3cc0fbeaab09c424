"""What computes where there is a choice: a variable of the environment, as of a worker's place.

A product does not name it: its numbers are those of a processor but for rounding and, of images, noise.
"""

import os
from typing import TYPE_CHECKING

from objectfolder.errors import SimulationError
from objectfolder.extras import needs_extra

if TYPE_CHECKING:
    import torch

# The processor, or a kind of graphics processor as Blender names it: CUDA, OPTIX, HIP.
DEVICE, CPU = "OBJECTFOLDER_DEVICE", "CPU"


def device_kind() -> str:
    """Return the kind of device that is asked for, `CPU` where nothing is."""
    return os.environ.get(DEVICE, CPU)


def torch_device() -> "torch.device":
    """Return the device of torch.

    Raises
    ------
    SimulationError
        A graphics processor that torch does not find.
    MissingPackageError
        Torch is not installed.
    """
    with needs_extra("factory"):
        import torch
    if device_kind() == CPU:
        return torch.device("cpu")
    if not torch.cuda.is_available():
        raise missing_device("torch")
    return torch.device("cuda")


def missing_device(program: str) -> SimulationError:
    """Return the error of a program that finds no such device."""
    return SimulationError(program, f"finds no {device_kind()} device here", f"Set {DEVICE} to {CPU}.")
