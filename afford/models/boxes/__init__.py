"""A detector with affordance masks inside its boxes, after AffordanceNet: what SOR3D-AFF is compared with on single pictures."""
