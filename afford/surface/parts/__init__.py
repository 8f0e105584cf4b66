"""The part scorer: crops, traits, network, training, card."""
