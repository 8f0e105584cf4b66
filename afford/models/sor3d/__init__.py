"""The spatio-temporal autoencoder of SOR3D-AFF: an RGB-D sequence in; where its last frame affords what, and the action, out."""
