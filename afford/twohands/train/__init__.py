"""Training of the two-hand model: samples, augmentation, batches, losses over the shared loop."""
