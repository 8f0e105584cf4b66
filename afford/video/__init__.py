"""Video files and frame folders -> frames with exact numbers and times."""
