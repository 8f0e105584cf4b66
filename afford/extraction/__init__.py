"""From video to two-hand affordance: sources, hands, tracks, inpainting, completion, intersection."""
