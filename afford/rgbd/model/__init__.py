"""SOR3D-AFF model: inputs, layers, losses, checkpoints, prediction."""
