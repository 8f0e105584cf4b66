"""Kitchens: rooms, casts, scripts, play, clips."""
