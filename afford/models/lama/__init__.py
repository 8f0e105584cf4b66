"""LaMa, which fills large holes of one picture in one pass (Suvorov et al. 2022): Fourier convolutions see all of it at once."""
