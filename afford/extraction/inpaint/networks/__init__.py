"""Inpainting networks: LaMa and VIDM, the hand-inpainting diffusion model of 2HandedAfforder."""
