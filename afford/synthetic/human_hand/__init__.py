"""Hands and forearms of people: bones, shape, skin, grasp."""
