"""Which objects of a version have not all their products, and what is known of why."""

from collections.abc import Sequence

from pipeline.audit.versions import Version
from pipeline.dataset.stage import Stage
from pipeline.dataset.task import Failure

NOT_KEPT = "no product; versions do not keep why"
LOOK = "See runs/ where that version was made, or run it again: `dvc repro`."


def failures_of(version: Version, stages: Sequence[Stage]) -> dict[str, tuple[str, Failure]]:
    """Return the first stage that an object lacks a product of, and why, by object id.

    A stage that a version does not have at all, or whose products are not known here, says nothing.
    """
    found = {object_id: (stages[0].name, failure) for object_id, failure in version.refused.items()}
    known = [
        (stage.name, [version.folders[kind.folder].products for kind in stage.products])
        for stage in stages
        if all(
            version.folders[kind.folder].made and version.folders[kind.folder].problem is None
            for kind in stage.products
        )
    ]
    for object_id in version.rows:
        for stage, folders in known:
            if all(object_id in products for products in folders):
                continue
            failure = version.reported.get((stage, object_id), Failure(object_id, NOT_KEPT, LOOK))
            found.setdefault(object_id, (stage, failure))
            break
    return found
