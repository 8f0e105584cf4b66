"""The network that finds hands in a picture: where they are, which they are, and what they touch."""
