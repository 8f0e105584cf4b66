"""A clip as layers: a background and rigid-ish objects that move over it, each seen in some frames and hidden in others."""
