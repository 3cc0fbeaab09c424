"""Child process that clones a repository: ``-m pipeline.audit.clone_process ADDRESS FOLDER [BRANCH]``.

A process of its own, because nothing bounds what a server of git sends: `cloning` watches the folder, and
ends it.
"""

import errno
import os
import resource
import sys

from objectfolder.child_process import end_with

MOST_MEMORY_BYTES = 2**32


def main(address: str, folder: str, branch: str | None = None) -> None:
    """Clone; end with a sentence on standard error where that fails, or `errno.ENOSPC` on a full disk."""
    from scmrepo.exceptions import CloneError
    from scmrepo.git import Git

    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY_BYTES, MOST_MEMORY_BYTES))
    try:
        Git.clone(address, folder, shallow_branch=branch).close()
    except CloneError as error:
        if getattr(error.__cause__, "errno", None) == errno.ENOSPC:
            sys.exit(errno.ENOSPC)
        sys.exit(" ".join(str(error.__cause__ or error).split()) or "the connection ended")


if __name__ == "__main__":
    end_with(os.getppid())
    main(*sys.argv[1:])
