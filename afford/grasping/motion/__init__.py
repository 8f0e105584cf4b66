"""Human hand motion: readers, synthesis, retargeting."""
