"""What an export says of itself: its manifest and its attribution."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from objectfolder.vision.export.credit import Credit
from objectfolder.vision.export.folder import MANIFEST, write_json


def write_manifest(folder: Path, kind: str, credit: Credit, described: Mapping[str, Any]) -> None:
    """Write the manifest and the attribution of an export of a format."""
    write_json(folder / MANIFEST, {"format": kind, "object": credit.to_dict(), **described})
    (folder / "ATTRIBUTION.txt").write_text(credit.to_text(), encoding="utf-8")
