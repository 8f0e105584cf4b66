"""Views of a mesh: plan cameras, draw, cast rays."""
