"""Where hands belong, from pictures to the surface."""
