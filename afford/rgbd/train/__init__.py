"""Training of the SOR3D-AFF model, of its pre-training and of the detector."""
