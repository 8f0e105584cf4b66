"""The demo: a local page that prompts the two-hand model."""
