"""Software rasteriser, cameras, materials, lights."""
