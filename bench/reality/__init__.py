"""The product against measurements of real things: ``python -m bench.reality [--bundle FOLDER]``."""
