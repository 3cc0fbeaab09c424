"""Which objects are for training, for validation and for testing: fixed by their names.

Within an object, training and held-out queries are fixed by its ground truth (the arrays `held_out` of its
products). Across objects the split is a hash of id and material: it needs no list, and adding or removing
objects moves no other. Seen and unseen objects can so never be confused between two users of a data set.
"""

import hashlib

TRAIN, VALIDATION, TEST = "train", "validation", "test"
OBJECT_SPLITS = (TRAIN, VALIDATION, TEST)
# Part of what is hashed: another rule would be another name, and cannot be taken for this one.
SPLIT_RULE = "objectfolder split 1"
VALIDATION_FROM, TEST_FROM = 0.8, 0.9


def object_split(object_id: str, material: str) -> str:
    """Return ``"train"``, ``"validation"`` or ``"test"``: about 80, 10 and 10 of 100 objects.

    The first 32 bits of the SHA-256 of ``"objectfolder split 1\\n<material>\\n<id>"`` as UTF-8, over 2**32,
    are a number in [0, 1): validation from 0.8, test from 0.9. A small data set may have none of a split.

    Parameters
    ----------
    object_id
        Identifier of the object in the table of objects.
    material
        Name of its material.

    Examples
    --------
    >>> object_split("bell", "iron"), object_split("mug", "ceramic")
    ('validation', 'train')
    """
    digest = hashlib.sha256(f"{SPLIT_RULE}\n{material}\n{object_id}".encode()).digest()
    place = int.from_bytes(digest[:4], "big") / 2**32
    if place < VALIDATION_FROM:
        return TRAIN
    return VALIDATION if place < TEST_FROM else TEST
