"""Shared helpers: images, masks, video, text, files, bounded reading, geometry, statistics, worker set-up."""
