"""Products whose bytes are not those of the manifest: set aside before a run, so that it makes them again."""

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from objectfolder.errors import FormatError
from pipeline.dataset.manifest import Entry
from pipeline.dataset.products import STATE, md5_of
from pipeline.dataset.verified import FINGERPRINT, Verified
from pipeline.run.converge import Summary
from pipeline.store.product_cache import ProductCache

SET_ASIDE = Path(STATE) / "damaged"


def set_changed_aside(
    root: Path, entries: Mapping[str, Entry], summaries: Sequence[Summary], states: Verified
) -> list[str]:
    """Move products aside that a run kept, and that have changed since it looked; return their paths.

    `entries` are those of the manifest before the run, which would else list them as they are now.
    """
    keys = {(summary.stage, object_id) for summary in summaries for object_id in summary.kept}
    listed = {where: entry for where, entry in entries.items() if (entry.stage, entry.object) in keys}
    has_worked = any(summary.computed for summary in summaries)  # else it has only just looked
    return set_damaged_aside(root, listed, states) if has_worked else []


def set_damaged_aside(root: Path, entries: Mapping[str, Entry], states: Verified) -> list[str]:
    """Move products aside that have other bytes than the manifest lists for what they were made from.

    The manifest lists what runs made. A product that says that it was made from the same and differs was
    changed since, be it a whole file. Its copy in DVC's cache goes, too, if it is no longer what its name
    says: DVC would link it back unread.

    Returns
    -------
    list of str
        Their paths, from the root on.
    """
    paths, cache = [], ProductCache(root)
    digests = states.md5s([f"{root}{os.sep}{where}" for where in entries])  # a path each would take as long
    for (where, entry), digest in zip(entries.items(), digests, strict=True):
        if digest == entry.md5:
            continue
        path = root / where
        try:
            if states.attributes(path, (FINGERPRINT,))[FINGERPRINT] != entry.fingerprint:
                continue
        except FileNotFoundError:
            continue
        except FormatError:  # no whole product: a run makes it again as it is
            pass
        place = root / SET_ASIDE / path.parent.name / path.name
        place.parent.mkdir(parents=True, exist_ok=True)
        path.replace(place)
        copy = cache.path(entry.md5)
        if copy.is_file() and md5_of(copy) != entry.md5:
            copy.unlink()
        aside = place.relative_to(root)
        print(f"{where}: changed since it was made; now {aside}, and made again", file=sys.stderr)
        paths.append(where)
    return paths
