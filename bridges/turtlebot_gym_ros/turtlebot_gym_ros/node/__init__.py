"""The shell that turns a block into a node, with conversion, triggers, freshness of inputs, parameters and the switch."""
