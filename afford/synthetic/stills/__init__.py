"""Still pictures of hands and things, with exact labels."""
