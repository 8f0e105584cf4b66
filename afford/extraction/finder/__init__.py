"""The hand finder: network, files, training, augmentation, card."""
