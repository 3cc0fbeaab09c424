"""Timed comparisons: ``python -m bench.NAME`` writes ``bench/results/NAME.json`` and ``NAME.png``."""
