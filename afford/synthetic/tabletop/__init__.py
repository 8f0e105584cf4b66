"""Table-top RGB-D interactions with exact truth."""
