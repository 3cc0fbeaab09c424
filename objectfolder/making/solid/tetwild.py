"""fTetWild in a child process, within a limit of CPU time."""

import signal
import subprocess
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from objectfolder.child_process import OUT_OF_TIME, last_words, run_module
from objectfolder.errors import SimulationError
from objectfolder.surface.surface import Surface

PATIENCE = 10  # wall seconds for a CPU second: a busy machine must not change what comes out

OUTSIDE = (signal.SIGKILL, signal.SIGTERM)


class CutOffError(SimulationError):
    """A limit or a signal ended fTetWild: on another machine, or another day, it may get further."""


@dataclass(frozen=True)
class Envelope:
    """What one run of fTetWild gets: dimensionless lengths, see `filling.Filling`; bytes.

    `wave_edge` is the edge that carries bending waves. fTetWild leaves single edges longer than asked, 1.7
    times on vessels. Where such an element is longer than a wave no order up to 5 carries it: a steel dish of
    2 mm had modes 77 cents too high.
    """

    epsilon: float
    allowed: float
    edge_length: float
    wave_edge: float
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
        `vertices` (v, 3), `tetrahedra` (t, 4), `faces` the surface was simplified to, rms distance `moved`,
        `edge` that was asked for.

    Raises
    ------
    CutOffError
        It took too long or too much memory, or a signal of its own ended it.
    SimulationError
        It was killed from outside: another way to fill would make another solid than without the kill.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "surface.npz", Path(folder) / "solid.npz"
        np.savez(source, vertices=surface.vertices, faces=surface.faces, **asdict(envelope))
        slow = CutOffError("fTetWild", f"took more than {envelope.time_limit_s:.0f} CPU-s")
        try:
            done = run_module(
                "objectfolder.making.solid.tetwild_process",
                source,
                target,
                cwd=Path(folder),  # fTetWild leaves files where it runs
                timeout_s=PATIENCE * envelope.time_limit_s,
                environment={"OMP_NUM_THREADS": "1"},
            )
        except subprocess.TimeoutExpired as error:
            raise slow from error
        if done.returncode == OUT_OF_TIME:
            raise slow
        if "MemoryError" in done.stderr or "bad_alloc" in done.stderr:
            raise CutOffError("fTetWild", f"needs more than {envelope.memory_limit / 1e9:.3g} GB")
        if -done.returncode in OUTSIDE:
            finding = f"was killed from outside (signal {-done.returncode}), as for want of memory"
            raise SimulationError("fTetWild", finding, "Run again, with more memory or fewer tasks at a time")
        if done.returncode < 0:
            raise CutOffError("fTetWild", f"ended with signal {-done.returncode}")
        if done.returncode > 0:
            return f"fTetWild failed: {last_words(done.stderr)}"
        with np.load(target) as result:
            return {key: result[key] for key in result.files}
