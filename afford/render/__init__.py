"""One small software renderer: meshes, lights with soft shadows, exact id maps. See `afford.render.draw`."""
