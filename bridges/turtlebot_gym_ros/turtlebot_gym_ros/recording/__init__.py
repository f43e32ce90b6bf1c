"""Record a graph to a bag that survives a kill."""
