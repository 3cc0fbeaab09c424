"""The `dvc repro` that this process is part of: its id, and whether it has converged all stages.

``python -m pipeline.run.converged`` exits with 0 where it has. The commands of single stages in ``dvc.yaml``
ask this first, so that nothing slow is imported to do nothing.
"""

import os
import secrets
import sys
from datetime import UTC, datetime
from pathlib import Path

import psutil

# DVC sets this for the commands of stages, and so not for itself.
DVC_STAGE = "DVC_STAGE"
CONVERGED = Path(".objectfolder/converged")  # the last run that converged all stages


def run_id() -> str:
    """Return the id of the `dvc repro` that this command is a stage of; a new one outside of any.

    It begins with the time: ``20260102T030405Z-0a1b2c3d``.
    """
    driver = driving_dvc()
    if driver is None:
        return f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{secrets.token_hex(4)}"
    return f"{datetime.fromtimestamp(driver.create_time(), UTC):%Y%m%dT%H%M%SZ}-{driver.pid:08x}"


def driving_dvc() -> psutil.Process | None:
    """Return the process of the `dvc repro` that this command is a stage of; None outside of one."""
    if DVC_STAGE not in os.environ:
        return None
    try:
        for process in psutil.Process().parents():
            if DVC_STAGE not in process.environ():
                return process
    except psutil.Error:  # of another user, or gone
        pass
    return None


if __name__ == "__main__":
    noted = CONVERGED.read_text() if CONVERGED.is_file() else ""
    sys.exit(driving_dvc() is None or noted != run_id())
