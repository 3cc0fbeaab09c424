from objectfolder.object_file.object_file import ObjectFile

__all__ = ["ObjectFile"]
