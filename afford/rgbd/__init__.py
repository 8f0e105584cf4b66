"""RGB-D interactions: where an object affords what, learned from video of its use (SOR3D-AFF)."""
