from objectfolder.vision.compiled.renderer import CompiledRenderer

__all__ = ["CompiledRenderer"]
