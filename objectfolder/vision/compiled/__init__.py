from objectfolder.vision.compiled.glass_images import GlassRenderer
from objectfolder.vision.compiled.renderer import CompiledRenderer

__all__ = ["CompiledRenderer", "GlassRenderer"]
