"""Positive affordance of the two-hand model projected on a mesh."""
