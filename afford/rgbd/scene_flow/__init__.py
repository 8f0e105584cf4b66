"""Scene flow: regularised 3-D motion between RGB-D frames."""
