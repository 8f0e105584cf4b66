"""VIDM, a latent diffusion model that fills the holes of one frame from four (Chang et al. 2023, "Look Ma, No Hands!")."""
