"""The findings of the audit's commands as JSON; a number that is not finite is null."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic_core import to_json, to_jsonable_python

from objectfolder.errors import ObjectFolderError
from pipeline.audit.fidelity import FidelityChange
from pipeline.audit.findings import Audit
from pipeline.audit.groups import totals
from pipeline.audit.history import ObjectVersion, Unreadable
from pipeline.audit.recomputation import Remade
from pipeline.audit.verification import Verified


def audit_json(
    audit: Audit, exceeded: Sequence[FidelityChange] = (), allowed: Mapping[str, float] = {}
) -> str:
    """Return all that an audit found, what lost more than was allowed, and the largest loss allowed."""
    content = _plain(audit)
    for found, one in zip(content["objects"], audit.objects, strict=True):
        found["reasons"] = [str(reason) for reason in one.roots]
        for stage, change in zip(found["stages"], one.stages, strict=True):
            for reason, why in zip(stage["reasons"], change.reasons, strict=True):
                reason["text"] = str(why)
    return _text({**content, "stages": totals(audit), "max_loss": allowed, "exceeded": exceeded})


def verified_json(found: Verified, remade: Sequence[Remade]) -> str:
    """Return what a verification found."""
    return _text({**_plain(found), "remade": remade})


def history_json(object_id: str, found: Sequence[ObjectVersion], unreadable: Sequence[Unreadable]) -> str:
    """Return the versions of an object."""
    commits = [{"commit": commit, "error": error} for commit, error in unreadable]
    return _text({"object_id": object_id, "versions": found, "unreadable": commits})


def _text(value: Any) -> str:
    return to_json(value, indent=1, inf_nan_mode="null", fallback=_error).decode()


def _plain(value: Any) -> Any:
    return to_jsonable_python(value, inf_nan_mode="null", fallback=_error)


def _error(error: ObjectFolderError) -> dict[str, str]:
    return {"where": error.where, "finding": error.finding, "remedy": error.remedy}
