"""Images, optical flow, geometry, text, files, errors, bounded reading, statistics: what every system uses."""
