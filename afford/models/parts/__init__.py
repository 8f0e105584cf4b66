"""The embedded scorer of parts: a small dual encoder, a mask in a view on one side and words for a part on the other."""
