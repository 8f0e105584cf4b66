"""Readers: EPIC-KITCHENS / VISOR roots and one's own video -> `Clip`s. The quirks of a data set stop here."""
