"""``python -m pipeline.cli``: the `objectfolder` command of this very source tree."""

import sys

from pipeline.cli import main

if __name__ == "__main__":
    sys.exit(main())
