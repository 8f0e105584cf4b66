"""Views of a mesh: plan cameras, render images, cast rays."""
