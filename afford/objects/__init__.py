"""Procedural hand tools and household things with exact part truth. See `afford.objects.build`."""
