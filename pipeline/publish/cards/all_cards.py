"""The cards of a data set: Croissant for machines, Markdown for people, CITATION.cff for both."""

from pathlib import Path

from objectfolder.atomic import atomic_write
from pipeline.publish.cards.citation_file import citation_text
from pipeline.publish.cards.croissant import croissant_text
from pipeline.publish.cards.data_card import card_text
from pipeline.publish.cards.published_data_set import read_data_set

CARDS = ("croissant.json", "data_card.md", "CITATION.cff")


def write_cards(root: Path, folder: Path) -> None:
    """Write croissant.json, data_card.md and CITATION.cff into `folder`, each atomically.

    Everything is a function of the Object Files, the reports in `folder`, ``data/records.json``,
    ``data/card.yaml``, ``params.yaml`` and what failed last: equal inputs give equal bytes.

    Parameters
    ----------
    root
        Root of the data set.
    folder
        Where per_object.csv and metrics.json of the report lie; without them the cards have no figures.

    Raises
    ------
    InputError
        No records, or a parameter file, report or ``data/card.yaml`` that cannot be read.
    """
    root, folder = Path(root), Path(folder)
    data_set = read_data_set(root, folder)
    texts = (
        croissant_text(data_set, root, folder),
        card_text(data_set, root, folder),
        citation_text(data_set),
    )
    for name, text in zip(CARDS, texts, strict=True):
        with atomic_write(folder / name) as file:
            file.write(text.encode())
