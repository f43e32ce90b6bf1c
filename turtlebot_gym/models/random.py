"""Counter-based randomness: a draw depends on the episode's key, the step and the stream, and on nothing else.

So environment *i* has the same trajectory alone and in any batch, in any order of stepping. Keys are 64-bit integers; masks
make Python's unbounded integers wrap like the machine's.
"""

from __future__ import annotations

from turtlebot_gym.kernel import exactly, kernel, plus, split, sqrt, times
from turtlebot_gym.models.angles import PI, TWO_PI, sincos

_M64 = 0xFFFFFFFFFFFFFFFF
_M37 = _M64 >> 27
_M31 = _M64 >> 33
_M32 = 0xFFFFFFFF
MAX_SEED = 0x7FFFFFFFFFFFFFFF  # largest seed and key: larger seeds are masked to it
_WEYL = 0x1E3779B97F4A7C15
_STREAMS = 16

# Streams of the draws. Each yields two uniform or two normal numbers.
PROCESS, POSITION, HEADING, EVENTS, SLIP, START, GOAL, LEAP, COUNT = range(9)

# Uses of an episode that draw more numbers in a step than there are streams: each has its own key, see `sub_key`.
ROOM, SCAN, FIX, SENSOR, GYRO, GOALS = 1, 2, 3, 4, 5, 7


@kernel
def mix(x: int) -> int:
    """Scramble 64 bits: every output bit depends on every input bit.

    References:
        Evensen, "Stronger, better, morer, Moremur; a better Murmur3-type mixer" (2019).
    """
    # Right shifts are masked because compiled integers are signed; the constants are below 2^63 for the same reason.
    x = x ^ ((x >> 27) & _M37)
    x = times(x, 0x3C79AC492BA7B653)
    x = x ^ ((x >> 33) & _M31)
    x = times(x, 0x1C69B3F74AC4AE35)
    return x ^ ((x >> 27) & _M37)


@kernel
def episode_key(seed: int, episode: int) -> int:
    """Return the key of an environment's episode: 63 bits, so that it fits a signed integer."""
    # mix(0) is 0: the constants keep seed 0 and episode 0 away from it
    return mix(mix(plus(seed, _WEYL)) ^ times(episode + 1, _WEYL)) & MAX_SEED


@kernel
def sub_key(key: int, use: int) -> int:
    """Return the key of one use of an episode, such as the room or the beams of its scans; its draws are numbered from 0."""
    return mix(key ^ times(use, _WEYL)) & MAX_SEED


@kernel
def uniforms(key: int, step: int, stream: int) -> tuple[float, float]:
    """Return two independent uniform numbers in (0, 1), of 32 bits each."""
    bits = mix(plus(key, times(step * _STREAMS + stream + 1, _WEYL)))
    return (exactly((bits >> 32) & _M32) + 0.5) * 2.0**-32, (exactly(bits & _M32) + 0.5) * 2.0**-32


@kernel
def normals(key: int, step: int, stream: int) -> tuple[float, float]:
    """Return two independent standard normal numbers, at most 6.8 in magnitude (Box and Muller, 1958)."""
    u1, u2 = uniforms(key, step, stream)
    radius = sqrt(-2.0 * _log_unit(u1))
    sine, cosine = sincos(TWO_PI * u2 - PI)
    return radius * cosine, radius * sine


@kernel
def _log_unit(x: float) -> float:
    """Return the natural logarithm of x in (2^-63, 1], to 1e-15 relative, without a branch.

    An exact division by a power of two brings x to [0.707, 1.414]; then follows the series of fdlibm's log.

    References:
        Sun Microsystems, *fdlibm* (1993), e_log.c: the coefficients.
    """
    x, exponent = split(x)
    below = x < 0.7071067811865476
    x, exponent = (2.0 * x if below else x), (exponent - 1.0 if below else exponent)
    f = x - 1.0
    s = f / (2.0 + f)
    z = s * s
    r = 1.818357216161805012e-01 + z * (1.531383769920937332e-01 + z * 1.479819860511658591e-01)
    r = 3.999999999940941908e-01 + z * (2.857142874366239149e-01 + z * (2.222219843214978396e-01 + z * r))
    r = z * (6.666666666666735130e-01 + z * r)
    half = 0.5 * f * f
    return exponent * 6.93147180369123816490e-01 - ((half - (s * (half + r) + exponent * 1.90821492927058770002e-10)) - f)
