"""Human hand motion: readers, synthesis, retargeting to a robot hand."""
