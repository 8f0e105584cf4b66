"""Asking a trained model about pictures of any origin, and keeping what it says as files."""
