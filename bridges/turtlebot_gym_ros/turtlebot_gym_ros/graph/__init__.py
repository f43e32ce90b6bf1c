"""The whole graph: bringing it up, observing it, drawing it."""
