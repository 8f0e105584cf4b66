"""Still pictures of hands and objects, with exact labels."""
