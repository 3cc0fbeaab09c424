"""fTetWild in a child process, within a limit of CPU time."""

import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.errors import SimulationError
from objectfolder.surface.surface import Surface

PATIENCE = 10  # wall seconds for a CPU second: a busy machine must not change what comes out


class CutOffError(SimulationError):
    """A limit or a signal ended fTetWild: on another machine, or another day, it may get further."""


@dataclass(frozen=True)
class Envelope:
    """What one run of fTetWild gets: dimensionless lengths, see `filling.Filling`; bytes."""

    epsilon: float
    allowed: float
    edge_length: float
    target_faces: int
    most_faces: int
    stop_energy: float
    time_limit_s: float
    memory_limit: float


def run_tetwild(surface: Surface, envelope: Envelope) -> dict[str, NDArray[Any]] | str:
    """Simplify and fill in a child process; why not, where nothing came back.

    Returns
    -------
    dict or str
        `vertices` (v, 3), `tetrahedra` (t, 4), `faces` the surface was simplified to, rms distance `moved`.

    Raises
    ------
    CutOffError
        It took too long or too much memory, or a signal ended it.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "surface.npz", Path(folder) / "solid.npz"
        np.savez(source, vertices=surface.vertices, faces=surface.faces, **asdict(envelope))
        command = [sys.executable, "-m", "objectfolder.solid.tetwild_process", str(source), str(target)]
        root = str(Path(__file__).parents[2])
        path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
        slow = CutOffError("fTetWild", f"took more than {envelope.time_limit_s:.0f} CPU-s")
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=PATIENCE * envelope.time_limit_s,
                cwd=folder,  # fTetWild leaves files where it runs
                check=False,
                env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"},
            )
        except subprocess.TimeoutExpired as error:
            raise slow from error
        if done.returncode in (-24, -9):
            raise slow
        if "MemoryError" in done.stderr or "bad_alloc" in done.stderr:
            raise CutOffError("fTetWild", f"needs more than {envelope.memory_limit / 1e9:.3g} GB")
        if done.returncode < 0:
            raise CutOffError("fTetWild", f"ended with signal {-done.returncode}")
        if done.returncode > 0:
            last = done.stderr.strip().splitlines()[-1:] or ["no message"]
            return f"fTetWild failed: {last[0]}"
        with np.load(target) as result:
            return {key: result[key] for key in result.files}
