"""Physically based rendering by Cycles, in a process and an environment of its own."""
