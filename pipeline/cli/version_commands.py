"""Commands for versions of a data set: audit, verify, history."""

import gc
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from cyclopts.validators import Number

from pipeline.cli.options import Json, Overwrite, Remote, Root
from pipeline.cli.output_paths import check_new_file
from pipeline.cli.printing import FAILED, FINE, print_error, print_text, status_line, terminal_width


def audit(
    old: str = "HEAD",
    new: str | None = None,
    /,
    *,
    arrays: bool = False,
    max_loss: tuple[str, ...] = (),
    json: Json = False,
    html: Path | None = None,
    overwrite: Overwrite = False,
    remote: Remote = "",
    root: Root = Path("."),
) -> int:
    """Say what changed between two versions of the data set, why, and what it did to fidelity.

    Nothing is checked out; of products only attributes are read. The figures of committed reports are
    compared always. The exit status is 1 where a limit of --max-loss is exceeded, and where something could
    not be compared.

    Parameters
    ----------
    old
        a git revision
    new
        a git revision (default: the work tree)
    arrays
        read the arrays of what changed
    max_loss
        MEASURE=LOSS, the largest loss of an object that is allowed, as vision.psnr_db=0.5; may be given
        several times
    html
        write a page that needs no network
    """
    from pipeline.audit.comparison import Comparison
    from pipeline.audit.contents import Contents
    from pipeline.audit.fidelity import exceeded, thresholds
    from pipeline.audit.findings import totals
    from pipeline.audit.rendering import as_json, audit_text
    from pipeline.audit.versions import read_version
    from pipeline.dataset.stages import STAGES
    from pipeline.publish.report.audit_page import write_page

    if html:
        check_new_file(html, overwrite=overwrite)
    stages, most = tuple(STAGES.values()), thresholds(max_loss)
    gc.disable()  # among a million dictionaries without reference cycles, to search for these takes seconds
    try:
        with (
            Contents(root, remote) as contents,
            status_line(f"comparing {old} with {new or 'the work tree'}"),
        ):
            before, after = (read_version(contents, stages, revision) for revision in (old, new))
            result = Comparison(contents, before, after, stages, arrays).audit()
    finally:
        gc.enable()
    too_much = exceeded(result.fidelity, most)
    if html:
        write_page(html, result, audit_text(result, too_much, most, 120, whole=True))
    if json:
        more = {"stages": totals(result), "max_loss": most, "exceeded": too_much}
        print(as_json(vars(result) | more))
    else:
        print_text(audit_text(result, too_much, most, terminal_width()))
    if result.problems:
        print_error(
            f"not all could be compared ({len(result.problems)} could not be read), so more may have "
            "changed; limits were judged by what was read and by the committed figures."
        )
        return FAILED
    return FAILED if too_much else FINE


def verify(
    revision: str | None = None,
    /,
    *,
    recompute: Annotated[int, Parameter(validator=Number(gte=0))] = 0,
    seed: int = 0,
    json: Json = False,
    root: Root = Path("."),
) -> int:
    """Read every file of a version and say which is damaged, and what to do.

    Checked are hashes against dvc.lock, checksums, fingerprints and lineage. The exit status is 1 where
    something is wrong with a file, or where a product made again is different.

    Parameters
    ----------
    revision
        a git revision (default: the work tree)
    recompute
        make this number of products, drawn at random, again and compare them
    seed
        of the draw
    """
    from pipeline.audit.contents import Contents
    from pipeline.audit.recomputation import FAILED as NOT_MADE
    from pipeline.audit.recomputation import recompute as make_again
    from pipeline.audit.rendering import as_json, verified_text
    from pipeline.audit.reproducibility import DIFFERENT
    from pipeline.audit.verification import verify as verified
    from pipeline.audit.versions import read_version
    from pipeline.dataset.stages import STAGES

    stages = tuple(STAGES.values())
    with Contents(root) as contents, status_line("reading files") as show:
        version = read_version(contents, stages, revision)
        result = verified(
            contents,
            version,
            stages,
            lambda done, count, size: show(f"{done} of {count} files, {size / 1e9:.2f} GB"),
        )
        remade = make_again(
            contents,
            version,
            stages,
            recompute,
            seed,
            started=lambda stage, object_id: show(f"making {stage} {object_id} again"),
        )
    if json:
        print(as_json(vars(result) | {"remade": remade}))
    else:
        print_text(verified_text(result, remade, version.label, terminal_width()))
    faulty = result.findings or any(product.verdict in (DIFFERENT, NOT_MADE) for product in remade)
    return FAILED if faulty else FINE


def history(
    object_: Annotated[str, Parameter(name="OBJECT")],
    /,
    *,
    rev: str = "HEAD",
    json: Json = False,
    remote: Remote = "",
    root: Root = Path("."),
) -> None:
    """List the versions of one object: commits, why it changed, fidelity.

    Parameters
    ----------
    object_
        an id
    rev
        the last version, a git revision
    """
    from pipeline.audit.contents import Contents
    from pipeline.audit.history import history as versions_of
    from pipeline.audit.rendering import as_json, history_text
    from pipeline.dataset.stages import STAGES

    with Contents(root, remote) as contents, status_line(f"reading versions of {object_}"):
        versions, unreadable = versions_of(contents, object_, tuple(STAGES.values()), rev)
    if json:
        commits = [{"commit": commit, "error": error} for commit, error in unreadable]
        print(as_json({"object_id": object_, "versions": versions, "unreadable": commits}))
    else:
        print_text(history_text(object_, versions, unreadable, terminal_width()))
