"""XML of a mesh file as a tree whose names have no namespaces."""

from xml.etree import ElementTree


def xml_tree(data: bytes) -> ElementTree.Element:
    """Parse XML, and leave the namespaces of tags and attributes out.

    Raises
    ------
    ValueError
        No XML, or a document type, whose entities may make much of few bytes.
    """
    if b"<!DOCTYPE" in data[:4096]:
        raise ValueError("it declares a document type")
    try:
        root = ElementTree.fromstring(data)
    except ElementTree.ParseError as problem:
        raise ValueError(f"no XML: {problem}") from problem
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        for name in [name for name in element.attrib if name.startswith("{")]:
            element.attrib[name.rpartition("}")[2]] = element.attrib.pop(name)
    return root
