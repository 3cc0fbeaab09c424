"""The id that all processes of one run share."""

import secrets
from datetime import UTC, datetime

RUN_ID = "OBJECTFOLDER_RUN_ID"  # environment variable of a process that is part of a run


def new_run_id() -> str:
    """Return an id that sorts by the time of the run: ``20260102T030405Z-0a1b2c3d``."""
    return f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{secrets.token_hex(4)}"
