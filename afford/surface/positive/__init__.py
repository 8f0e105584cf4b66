"""Positive affordance: the regions of a two-hand model, projected on a mesh."""
