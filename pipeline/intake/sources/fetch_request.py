"""The options for fetching objects of published collections; light to import."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from objectfolder.errors import InputError

if TYPE_CHECKING:
    from pipeline.intake.sources.fetching import Fetcher

MIRRORS = "OBJECTFOLDER_MIRRORS"


@dataclass(frozen=True, kw_only=True)
class Fetching:
    """Where from, where to, and what is known of the files.

    Parameters
    ----------
    folder
        objects come to FOLDER/SOURCE/NAME (default: fetched, in the folder of TABLE)
    cache
        where downloads are kept (default: .downloads in the folder)
    hashes
        table of what is known of files, which new ones are added to (default: source_hashes.csv, in the
        folder of TABLE)
    mirror
        SOURCE=URL, asks URL in place of a source; may be given several times, or in OBJECTFOLDER_MIRRORS,
        separated by spaces
    proxy
        URL to ask through (default: HTTPS_PROXY and the like)
    retries
        how often to ask for a file again
    refresh
        fetch again what lies there already
    accept_changed
        take and record content that is not what was known
    """

    folder: Path | None = None
    cache: Path | None = None
    hashes: Path | None = None
    mirror: tuple[str, ...] = ()
    proxy: str | None = None
    retries: int = 6
    refresh: bool = False
    accept_changed: bool = False

    def fetcher(self, table: Path, progress: Callable[[str, int, int | None], None]) -> "Fetcher":
        """Return the fetcher for a table of objects.

        Raises
        ------
        InputError
            A mirror or a time that cannot be used.
        """
        from pipeline.intake.sources.download import Downloader
        from pipeline.intake.sources.fetching import Fetcher
        from pipeline.intake.sources.registry import mirrored_addresses

        if self.retries < 0:
            raise InputError("--retries", str(self.retries), "Give a number from 0 on.")
        folder = self.folder or table.parent / "fetched"
        return Fetcher(
            folder,
            Downloader(
                self.cache or folder / ".downloads",
                proxies={"http": self.proxy, "https": self.proxy} if self.proxy else None,
                mirrors=mirrored_addresses([*os.environ.get(MIRRORS, "").split(), *self.mirror]),
                retries=self.retries,
                progress=progress,
            ),
            self.hashes or table.parent / "source_hashes.csv",
            refresh=self.refresh,
            accept_changed=self.accept_changed,
        )
