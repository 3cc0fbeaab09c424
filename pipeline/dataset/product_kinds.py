"""The kinds of products that stages make; light to import."""

from pipeline.dataset.products import TENSORS, ProductKind

OBJECTS = ProductKind("data/objects")
VIEWS = ProductKind("data/views")
MODES = ProductKind("data/modes")
TOUCHES = ProductKind("data/touches")
COLLISION = ProductKind("data/collision")
ENCODED = ProductKind("data/encoded", TENSORS, "encode")
OBJECT_FILES = ProductKind("data/object_files", TENSORS, "fidelity")
FIDELITY = ProductKind("data/fidelity")
