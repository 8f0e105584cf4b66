"""Layers of a clip: camera motion, background, moving shapes; what is behind the hands."""
