"""Sentences that several cards share: what is in the data set, how it came about, its known limits."""

from collections import Counter

from pipeline.publish.cards.published_data_set import DataSet

SUMMARY = (
    "Simulated by ObjectFolder Factory from meshes and material constants: views by path tracing (Blender "
    "Cycles), modal sound by finite elements, touches by a simulated tactile sensor. Each Object File was "
    "fitted to the training part and measured against the held-out part."
)
LIMITS = (
    "Everything is simulated; no figure here compares with a measurement of a real object.",
    "Material constants are those of the table of materials, one set an object: isotropic, uniform, linear.",
    "Glass and other clear materials are drawn as glossy opaque bodies.",
    "A container that was scanned solid rings like a solid unless its wall is stated in the table.",
    "The estimated error of a frequency is that of the elements, not of the mesh they were given.",
    "The gel of the tactile sensor is a model of its shape and lights; unless the parameters say elastic it "
    "does not deform and bears no force.",
    "Masses, sizes and wall thicknesses are those of the mesh at its stated length.",
)


def counted(number: int, noun: str) -> str:
    """Return ``1 object`` or ``7 objects``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def materials(data_set: DataSet) -> list[tuple[str, int]]:
    """Return materials with their number of objects, most frequent first."""
    counts = Counter(entry.material for entry in data_set.objects)
    return sorted(counts.items(), key=lambda item: (-item[1], item[0]))


def description(data_set: DataSet) -> str:
    """Return the paragraph that says what is in the data set."""
    unstated = sum(not entry.licence.stated for entry in data_set.objects)
    parts = [
        data_set.publication.description,
        f"{counted(len(data_set.objects), 'object')}, each one file that answers what the object looks, "
        "sounds and feels like, with the fidelity of each file on held-out queries.",
        SUMMARY,
        f"No licence is stated for {counted(unstated, 'object')}." if unstated else "",
        f"{counted(len(data_set.missing), 'listed object')} could not be made." if data_set.missing else "",
    ]
    return " ".join(part for part in parts if part)


def citation(data_set: DataSet) -> str:
    """Return how to cite the data set, of what its publisher states."""
    publication = data_set.publication
    parts = [
        ", ".join(publication.creators),
        f"{publication.title}, version {data_set.version}",
        publication.date,
        f"https://doi.org/{publication.doi}" if publication.doi else publication.url,
    ]
    return ". ".join(part for part in parts if part) + "."
