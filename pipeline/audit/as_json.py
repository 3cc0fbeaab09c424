"""An audit as JSON."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from typing import Any

from objectfolder.errors import ObjectFolderError
from pipeline.audit.fidelity import FidelityChange
from pipeline.audit.findings import Audit
from pipeline.audit.groups import totals


def as_json(audit: Audit, exceeded: Sequence[FidelityChange] = (), allowed: Mapping[str, float] = {}) -> str:
    """Return all that an audit found; what is infinite is null.

    Parameters
    ----------
    audit
        What it found.
    exceeded
        What lost more than was allowed.
    allowed
        The largest loss allowed by measure.
    """
    content = {
        "old": audit.old,
        "new": audit.new,
        "arrays_read": audit.arrays_read,
        "objects": [
            {
                **plain(one),
                "reasons": [str(reason) for reason in one.roots],
                "stages": [
                    {**plain(stage), "reasons": [{**plain(why), "text": str(why)} for why in stage.reasons]}
                    for stage in one.stages
                ],
            }
            for one in audit.objects
        ],
        "fidelity": [plain(one) for one in audit.fidelity],
        "stages": [plain(one) for one in totals(audit)],
        "fetch": plain(audit.fetch),
        "problems": [plain(one) for one in audit.problems],
        "max_loss": dict(allowed),
        "exceeded": [plain(one) for one in exceeded],
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)


def plain(value: Any) -> Any:
    """Return a value as JSON holds it."""
    if isinstance(value, ObjectFolderError):
        return {"where": value.where, "finding": value.finding, "remedy": value.remedy}
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
