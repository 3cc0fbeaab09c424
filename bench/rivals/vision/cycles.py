"""Cycles in a process of its own, as the factory runs it, with the CPU seconds of each view.

    python -m bench.rivals.vision.cycles REQUEST.npz RESULT.npz

A view's seconds end where the next begins, the image read back; the first has the building of the scene's
bounding volumes in it, and the process before that is in none.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np

from objectfolder.child_process import end_with
from objectfolder.making.views.cycles import render
from objectfolder.making.views.render_request import load_request


def main() -> None:
    import bpy

    begun: list[float] = []

    @bpy.app.handlers.persistent
    def note(*_: object) -> None:
        begun.append(time.process_time())

    scene, shots = load_request(Path(sys.argv[1]))
    bpy.app.handlers.render_pre.append(note)
    images = render(scene, shots)
    np.savez(sys.argv[2], images=images, cpu_s=np.diff([*begun, time.process_time()]))


if __name__ == "__main__":
    end_with(os.getppid())
    main()
