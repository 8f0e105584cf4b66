"""Training of the SOR3D-AFF model and of the detector."""
