"""Videos and image sequences: probe, decode, sample, write."""
