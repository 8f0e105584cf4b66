"""Readers of RGB-D sets: SOR3D-AFF, UMD, IIT-AFF, UTKinect."""
