"""Functions by their series, with + - * alone.

Loops over them use the lanes of a processor. On a graphics card single precision stays single, where the sine of the
library reduces large angles in double precision.
"""


def decay(y: float) -> float:
    """Compute exp(-y) [1] within 1e-14, y clipped to 0..40, by + - * alone.

    By Taylor's series of exp(-y / 32), squared five times.

    Parameters
    ----------
    y : float [1]
    """
    z = min(max(y, 0.0), 40.0) * -0.03125
    power = z * (1.0 / 3628800.0) + 1.0 / 362880.0
    power = power * z + 1.0 / 40320.0
    power = power * z + 1.0 / 5040.0
    power = power * z + 1.0 / 720.0
    power = power * z + 1.0 / 120.0
    power = power * z + 1.0 / 24.0
    power = power * z + 1.0 / 6.0
    power = power * z + 0.5
    power = power * z + 1.0
    power = power * z + 1.0
    power = power * power
    power = power * power
    power = power * power
    power = power * power
    return power * power


def sine_cosine(angle: float) -> tuple[float, float]:
    """Compute sin and cos [1] of an angle within 1e-12, by + - * alone.

    By Taylor's series of half the angle.

    Parameters
    ----------
    angle : float [rad]
        0 to pi/2.
    """
    half = 0.5 * angle
    y = half * half
    sine = y * (1.0 / 6227020800.0) - 1.0 / 39916800.0
    sine = sine * y + 1.0 / 362880.0
    sine = sine * y - 1.0 / 5040.0
    sine = sine * y + 1.0 / 120.0
    sine = sine * y - 1.0 / 6.0
    sine = half + half * y * sine
    cosine = y * (1.0 / 479001600.0) - 1.0 / 3628800.0
    cosine = cosine * y + 1.0 / 40320.0
    cosine = cosine * y - 1.0 / 720.0
    cosine = cosine * y + 1.0 / 24.0
    cosine = cosine * y - 0.5
    cosine = cosine * y + 1.0
    return 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine
