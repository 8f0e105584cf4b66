"""Imitation of reference motion (AffordDex stage 1): environment, reward, prior."""
