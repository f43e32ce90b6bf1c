"""A system as a compiled loop over many environments."""
