"""Programs of the system that tests of clusters run: skipped where they are missing, required in CI."""

import os
import shutil

import pytest

PATH = os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/sbin"])


def need(*programs: str) -> None:
    """Skip the test where programs are missing; fail it where ``OBJECTFOLDER_SERVICES`` says ``required``."""
    missing = [name for name in programs if shutil.which(name, path=PATH) is None]
    if missing and os.environ.get("OBJECTFOLDER_SERVICES") == "required":
        pytest.fail(f"not installed: {', '.join(missing)}")
    if missing:
        pytest.skip(f"not installed: {', '.join(missing)}")
