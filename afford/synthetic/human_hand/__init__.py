"""Model of a human hand and forearm: skeleton, skin, appearance, postures and finger closing."""
