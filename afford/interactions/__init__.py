"""People use things on a table before an RGB-D camera: what is planned, how it moves, what a sensor sees, and files of it."""
