"""Robot hands: read from MJCF or URDF, written as URDF, moved in numpy."""
