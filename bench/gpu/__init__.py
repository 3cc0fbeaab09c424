"""Throughput and answers of `objectfolder.batch` on a graphics processor."""
