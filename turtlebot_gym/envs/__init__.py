"""Gymnasium environments over the compiled loop: scalar, native vector, and their rendering."""
