"""A detector of single pictures to compare SOR3D-AFF with."""
