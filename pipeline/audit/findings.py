"""The findings of an audit: on every object and stage, on fidelity, and on files that could not be read."""

from dataclasses import dataclass, field

from objectfolder.errors import ObjectFolderError
from pipeline.audit import reasons
from pipeline.audit.arrays import Arrays
from pipeline.audit.change_costs import Fetch
from pipeline.audit.fidelity import FidelityChange
from pipeline.audit.reasons import Reason
from pipeline.dataset.task import Failure

ADDED, REMOVED, RENAMED, CHANGED, FAILED, STILL_FAILED, MENDED, UNCHANGED = (
    "added", "removed", "renamed", "changed", "failed", "failed as before", "mended", "unchanged",
)  # fmt: skip
STATES = (ADDED, REMOVED, RENAMED, CHANGED, FAILED, STILL_FAILED, MENDED, UNCHANGED)
MADE, GONE = "made", "gone"


@dataclass(frozen=True)
class StageChange:
    """The change of an object's products of a stage.

    Parameters
    ----------
    stage
        Its name.
    state
        `CHANGED`, `MADE` or `GONE`.
    reasons
        Why, for `CHANGED`.
    old, new
        Fingerprints; empty for a product without one.
    arrays
        What is known of the arrays without reading them, or after.
    cpu_s
        What it took to make, where that is known.
    """

    stage: str
    state: str
    reasons: tuple[Reason, ...] = ()
    old: str = ""
    new: str = ""
    arrays: Arrays = field(default_factory=Arrays)
    cpu_s: float | None = None


@dataclass(frozen=True)
class ObjectChange:
    """The change of an object.

    Parameters
    ----------
    object_id
        Its later id.
    state
        One of `STATES`.
    was
        Its former id, where it was renamed.
    stages
        The stages whose products are not the same.
    failure
        Why it has not all products in the later version; None where it has.
    failed_stage
        The stage that failed.
    """

    object_id: str
    state: str
    was: str = ""
    stages: tuple[StageChange, ...] = ()
    failure: Failure | None = None
    failed_stage: str = ""

    @property
    def roots(self) -> tuple[Reason, ...]:
        """Reasons that are no consequence of another stage's change, each once."""
        found = [one for stage in self.stages for one in stage.reasons if one.kind != reasons.UPSTREAM]
        known = [one for position, one in enumerate(found) if one not in found[:position]]
        return tuple(known)


@dataclass(frozen=True)
class Audit:
    """All that an audit finds.

    Parameters
    ----------
    old, new
        Labels of the versions.
    objects
        Every object of either.
    fidelity
        Measures that changed, worst first.
    fetch
        Files to fetch.
    arrays_read
        Whether arrays were read, or only their checksums compared.
    problems
        What could not be read here, and what to do about it; an audit with any is incomplete.
    """

    old: str
    new: str
    objects: tuple[ObjectChange, ...]
    fidelity: tuple[FidelityChange, ...]
    fetch: Fetch
    arrays_read: bool
    problems: tuple[ObjectFolderError, ...] = ()
