import numpy as np

DIRECTIONS = -2 * np.pi * np.arange(180) / 180  # in the LiDAR's frame, rad
PILLAR, RADIUS, WALL = 1.0 + 0.1j, 0.3, 2.5  # m


def ranges_at(x, y, heading):
    """Return the range of each beam, m."""
    ray = np.exp(1j * (heading + DIRECTIONS))
    with np.errstate(divide="ignore"):
        walls = np.minimum((WALL - np.sign(ray.real) * x) / abs(ray.real), (WALL - np.sign(ray.imag) * y) / abs(ray.imag))
    to = (PILLAR - (x + 1j * y)) * np.conj(ray)
    hits = (abs(to.imag) < RADIUS) & (to.real > 0)
    return np.where(hits, np.minimum(to.real - np.sqrt(np.maximum(RADIUS**2 - to.imag**2, 0)), walls), walls)
