"""Software renderer: rasteriser, cameras, materials, lights, and views of a mesh."""
