"""What the guard and the nodes share: parameters, frames, names, quality of service, discovery and processes."""
