"""Gymnasium environments over the compiled loop: a scalar one, a native vector one, and a picture of what goes on."""
