"""Synthetic first-person video clips of two hands at work in kitchens, workshops and at desks."""
