"""Scene flow: how the surface behind every pixel moves in space between two RGB-D frames."""
