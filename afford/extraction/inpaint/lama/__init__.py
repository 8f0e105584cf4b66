"""LaMa, the inpainting network."""
