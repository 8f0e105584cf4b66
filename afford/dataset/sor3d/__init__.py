"""On-disk format of SOR3D-AFF: folders, names, label colours, sequences."""
