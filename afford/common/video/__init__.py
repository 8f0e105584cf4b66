"""Videos and pictures: probe, decode, sample, write."""
