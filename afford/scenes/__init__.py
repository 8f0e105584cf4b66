"""The synthetic source: rooms, objects, hands and choreographies that are rendered to clips in the EPIC/VISOR format."""
