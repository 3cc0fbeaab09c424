"""The id of a run: one for all commands of a `dvc repro`, and one for any other process."""

import os
import secrets
from datetime import UTC, datetime

import psutil

RUN_ID = "OBJECTFOLDER_RUN_ID"  # set for what a run starts
# DVC sets this for the commands of stages, and so not for itself.
DVC_STAGE = "DVC_STAGE"


def run_id() -> str:
    """Return the id of the run that this process is part of: ``20260102T030405Z-0a1b2c3d``, by time."""
    return os.environ.get(RUN_ID) or new_run_id()


def new_run_id() -> str:
    """Return the id of the `dvc repro` that this command is a stage of; a new one outside of any."""
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
