"""Symmetric tensors and their logarithms, for solid materials of the 3D solver.

A symmetric tensor is six numbers xx, yy, zz, xy, xz, yz; any other nine, row by row. Small strains are computed by a
fixed sequence of + - * /, which a compiler runs for several points at once. No principal values are needed, because
every power of a 3 x 3 tensor is a combination of itself, its square and the unit tensor (Cayley and Hamilton), so that
a series costs three numbers a term. Large strains need principal values, by Jacobi's rotations, one point at a time.

The left Cauchy-Green tensor b is kept as x = b - I. In single precision b itself resolves strains of 6e-8 and steps
below that are lost: after 60 000 small steps up to 12 kPa of an ice's 112 kPa (K = 6.7 MPa), and any stress where K is
1 GPa; of x 0.1 and 1.2 kPa (measured 2026-11-21). In double precision it costs 2 ns a point.
"""

from math import log1p, sqrt

# Largest |b - I| (Frobenius) of the series, squared. There |Z| <= 1/7, and the truncation error is below 2e-14.
SERIES_REACH = 0.0625
SWEEPS = 12  # of Jacobi's method at most; 5 or 6 are enough, because the convergence is quadratic
DIAGONAL = 1e-36  # [1] squared off-diagonal entries over squared diagonal ones that end the sweeps
SMALLEST_STRETCH, LARGEST_STRETCH = 1e-4, 1e4  # limits of the singular values of the deformation


def determinant_of_step(gradient: tuple) -> float:
    """Compute det(I + g) [1]: how a step changes volumes; at or below 0 it turns the point inside out.

    Parameters
    ----------
    gradient : tuple of 9 floats [1]
        Gradient of the step g = dt grad v: xx, xy, xz, yx, yy, yz, zx, zy, zz.
    """
    gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz = gradient
    axx, ayy, azz = 1.0 + gxx, 1.0 + gyy, 1.0 + gzz
    return axx * (ayy * azz - gyz * gzy) - gxy * (gyx * azz - gyz * gzx) + gxz * (gyx * gzy - ayy * gzx)


def pushed_forward(x: tuple, gradient: tuple) -> tuple[float, float, float, float, float, float]:
    """Compute x after a step: (I + g)(I + x)(I + g)^T - I, without a difference of large numbers.

    It is c (I + g)^T + g^T with c = (I + g) x + g.

    Parameters
    ----------
    x : tuple of 6 floats [1]
        b - I before the step: xx, yy, zz, xy, xz, yz.
    gradient : tuple of 9 floats [1]
        Gradient of the step g = dt grad v: xx, xy, xz, yx, yy, yz, zx, zy, zz.

    Returns
    -------
    xx, yy, zz, xy, xz, yz : float [1]
    """
    xxx, xyy, xzz, xxy, xxz, xyz = x
    gxx, gxy, gxz, gyx, gyy, gyz, gzx, gzy, gzz = gradient
    axx, ayy, azz = 1.0 + gxx, 1.0 + gyy, 1.0 + gzz
    cxx = axx * xxx + gxy * xxy + gxz * xxz + gxx
    cxy = axx * xxy + gxy * xyy + gxz * xyz + gxy
    cxz = axx * xxz + gxy * xyz + gxz * xzz + gxz
    cyx = gyx * xxx + ayy * xxy + gyz * xxz + gyx
    cyy = gyx * xxy + ayy * xyy + gyz * xyz + gyy
    cyz = gyx * xxz + ayy * xyz + gyz * xzz + gyz
    czx = gzx * xxx + gzy * xxy + azz * xxz + gzx
    czy = gzx * xxy + gzy * xyy + azz * xyz + gzy
    czz = gzx * xxz + gzy * xyz + azz * xzz + gzz
    return (
        cxx * axx + cxy * gxy + cxz * gxz + gxx,
        cyx * gyx + cyy * ayy + cyz * gyz + gyy,
        czx * gzx + czy * gzy + czz * azz + gzz,
        cxx * gyx + cxy * ayy + cxz * gyz + gyx,
        cxx * gzx + cxy * gzy + cxz * azz + gzx,
        cyx * gzx + cyy * gzy + cyz * azz + gzy,
    )


def squared(
    xx: float, yy: float, zz: float, xy: float, xz: float, yz: float
) -> tuple[float, float, float, float, float, float]:
    """Compute a a of a symmetric tensor a.

    Parameters
    ----------
    xx, yy, zz, xy, xz, yz : float
        Entries of the tensor.
    """
    return (
        xx * xx + xy * xy + xz * xz,
        xy * xy + yy * yy + yz * yz,
        xz * xz + yz * yz + zz * zz,
        xx * xy + xy * yy + xz * yz,
        xx * xz + xy * yz + xz * zz,
        xy * xz + yy * yz + yz * zz,
    )


def determinant(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> float:
    """Compute det a of a symmetric tensor a.

    Parameters
    ----------
    xx, yy, zz, xy, xz, yz : float
        Entries of the tensor.
    """
    return xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)


def squared_norm(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> float:
    """Compute a : a of a symmetric tensor a.

    Parameters
    ----------
    xx, yy, zz, xy, xz, yz : float
        Entries of the tensor.
    """
    return xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz)


def cayley(
    xx: float, yy: float, zz: float, xy: float, xz: float, yz: float
) -> tuple[float, float, float, float, float, float]:
    """Compute Z = x (2 I + x)^-1 of x = b - I; log(b) = 2 artanh(Z).

    Z is between -I and I while b is positive definite. By Cayley and Hamilton it is (I3 I + (4 + 2 I1) x - 2 x x) / (8
    + 4 I1 + 2 I2 + I3) with the invariants of x.

    Parameters
    ----------
    xx, yy, zz, xy, xz, yz : float
        Entries of the tensor.
    """
    sxx, syy, szz, sxy, sxz, syz = squared(xx, yy, zz, xy, xz, yz)
    first, third = xx + yy + zz, determinant(xx, yy, zz, xy, xz, yz)
    second = 0.5 * (first * first - (sxx + syy + szz))
    scale = 1.0 / (8.0 + 4.0 * first + 2.0 * second + third)
    q, p, r = (4.0 + 2.0 * first) * scale, -2.0 * scale, third * scale
    return (
        p * sxx + q * xx + r,
        p * syy + q * yy + r,
        p * szz + q * zz + r,
        p * sxy + q * xy,
        p * sxz + q * xz,
        p * syz + q * yz,
    )


def hencky_strain(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> tuple[float, ...]:
    """Compute e = log(I + x) / 2 within the reach of the series.

    e = Z + Z^3/3 + Z^5/5 + ... + Z^13/13 with Z of `cayley`, evaluated by Horner on p Z^2 + q Z + r I.

    Parameters
    ----------
    xx, yy, zz, xy, xz, yz : float
        Entries of the tensor.

    Returns
    -------
    trace, xx, yy, zz, xy, xz, yz : float [1]
        Trace of e, and its deviator.
    """
    zxx, zyy, zzz, zxy, zxz, zyz = cayley(xx, yy, zz, xy, xz, yz)
    yxx, yyy, yzz, yxy, yxz, yyz = squared(zxx, zyy, zzz, zxy, zxz, zyz)
    first = zxx + zyy + zzz  # invariants of Z
    trace_of_square = yxx + yyy + yzz
    second = 0.5 * (first * first - trace_of_square)
    third = determinant(zxx, zyy, zzz, zxy, zxz, zyz)
    p, q, r = first * (1.0 / 13.0), 1.0 / 11.0 - second * (1.0 / 13.0), third * (1.0 / 13.0)
    p, q, r = times_square(p, q, r, first, second, third)
    q = q + 1.0 / 9.0
    p, q, r = times_square(p, q, r, first, second, third)
    q = q + 1.0 / 7.0
    p, q, r = times_square(p, q, r, first, second, third)
    q = q + 1.0 / 5.0
    p, q, r = times_square(p, q, r, first, second, third)
    q = q + 1.0 / 3.0
    p, q, r = times_square(p, q, r, first, second, third)
    q = q + 1.0
    trace = p * trace_of_square + q * first + 3.0 * r
    mean = trace * (1.0 / 3.0) - r
    return (
        trace,
        p * yxx + q * zxx - mean,
        p * yyy + q * zyy - mean,
        p * yzz + q * zzz - mean,
        p * yxy + q * zxy,
        p * yxz + q * zxz,
        p * yyz + q * zyz,
    )


def times_square(p: float, q: float, r: float, first: float, second: float, third: float) -> tuple[float, float, float]:
    """Compute p, q, r of (p a^2 + q a + r I) a^2 for a tensor a.

    Parameters
    ----------
    p, q, r : float
    first, second, third : float
        Invariants of a.
    """
    lead = first * p + q
    return first * lead + r - second * p, third * p - second * lead, third * lead


def exponential_less_unit(
    trace: float, xx: float, yy: float, zz: float, xy: float, xz: float, yz: float
) -> tuple[float, float, float, float, float, float]:
    """Compute exp(a) - I of a symmetric tensor a; to 1e-15 while its norm is below 0.3.

    exp(trace / 3) times exp(deviator), Taylor to the 11th power; the deviator's by Horner on p s^2 + q s + r I, where
    s^3 = (s : s / 2) s + det(s) I.

    Parameters
    ----------
    trace : float [1]
        Trace of a.
    xx, yy, zz, xy, xz, yz : float
        Entries of the tensor.

    Returns
    -------
    xx, yy, zz, xy, xz, yz : float [1]
    """
    sxx, syy, szz, sxy, sxz, syz = squared(xx, yy, zz, xy, xz, yz)
    half, third = 0.5 * (sxx + syy + szz), determinant(xx, yy, zz, xy, xz, yz)
    m = trace * (1.0 / 3.0)
    # 1/11! to 1/9! of s: p s^2 + q s + r I
    p, q, r, scale = 1.0 / 39916800.0, 1.0 / 3628800.0, 1.0 / 362880.0, m * (1.0 / 39916800.0) + 1.0 / 3628800.0
    scale = scale * m + 1.0 / 362880.0
    p, q, r, scale = q, r + half * p, third * p + 1.0 / 40320.0, scale * m + 1.0 / 40320.0
    p, q, r, scale = q, r + half * p, third * p + 1.0 / 5040.0, scale * m + 1.0 / 5040.0
    p, q, r, scale = q, r + half * p, third * p + 1.0 / 720.0, scale * m + 1.0 / 720.0
    p, q, r, scale = q, r + half * p, third * p + 1.0 / 120.0, scale * m + 1.0 / 120.0
    p, q, r, scale = q, r + half * p, third * p + 1.0 / 24.0, scale * m + 1.0 / 24.0
    p, q, r, scale = q, r + half * p, third * p + 1.0 / 6.0, scale * m + 1.0 / 6.0
    p, q, r, scale = q, r + half * p, third * p + 0.5, scale * m + 0.5
    p, q, r, scale = q, r + half * p, third * p + 1.0, scale * m + 1.0
    p, q, r, scale = q, r + half * p, third * p, scale * m  # r and scale without their 1
    p, q, r = p + scale * p, q + scale * q, r + scale + scale * r
    return (
        p * sxx + q * xx + r,
        p * syy + q * yy + r,
        p * szz + q * zz + r,
        p * sxy + q * xy,
        p * sxz + q * xz,
        p * syz + q * yz,
    )


def large_exponential_less_unit(
    trace: float, xx: float, yy: float, zz: float, xy: float, xz: float, yz: float
) -> tuple:
    """Compute `exponential_less_unit` up to a norm of 4, of numbers or of arrays.

    It is that of a 16th, squared four times.

    Parameters
    ----------
    trace : float [1]
        Trace of a.
    xx, yy, zz, xy, xz, yz : float
        Entries of the tensor.
    """
    part = 1.0 / 16.0
    power = exponential_less_unit(trace * part, xx * part, yy * part, zz * part, xy * part, xz * part, yz * part)
    for _ in range(4):  # (I + y)^2 - I = y y + 2 y
        square = squared(power[0], power[1], power[2], power[3], power[4], power[5])
        power = tuple(part + 2.0 * whole for part, whole in zip(square, power, strict=True))
    return power


def rotation(app: float, aqq: float, apq: float) -> tuple[float, float, float]:
    """Compute Jacobi's rotation that clears the entry apq between the diagonal entries app and aqq.

    Parameters
    ----------
    app, aqq, apq : float
        Entries of the tensor.

    Returns
    -------
    cosine, sine, tangent : float [1]
    """
    tangent = 0.0
    if apq != 0.0:
        turn = (aqq - app) / (2.0 * apq)
        tangent = (1.0 if turn >= 0.0 else -1.0) / (abs(turn) + sqrt(turn * turn + 1.0))
    cosine = 1.0 / sqrt(tangent * tangent + 1.0)
    return cosine, tangent * cosine, tangent


def turned(
    c: float, s: float, ax: float, ay: float, az: float, bx: float, by: float, bz: float
) -> tuple[float, float, float, float, float, float]:
    """Rotate the directions a and b.

    Parameters
    ----------
    c, s : float [1]
        Cosine and sine of the rotation.
    ax, ay, az, bx, by, bz : float [1]
        Directions a and b.
    """
    return c * ax - s * bx, c * ay - s * by, c * az - s * bz, s * ax + c * bx, s * ay + c * by, s * az + c * bz


def principal(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> tuple[float, ...]:
    """Compute the principal values of a symmetric tensor and their directions, by Jacobi's rotations.

    Parameters
    ----------
    xx, yy, zz, xy, xz, yz : float
        Entries of the tensor.

    Returns
    -------
    a, b, c, ax, ay, az, bx, by, bz, cx, cy, cz : float
        Values, then directions [1].
    """
    ax, ay, az, bx, by, bz, cx, cy, cz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    for _ in range(SWEEPS):
        if xy * xy + xz * xz + yz * yz <= DIAGONAL * (xx * xx + yy * yy + zz * zz):
            break
        c, s, t = rotation(xx, yy, xy)
        xx, yy, xy, xz, yz = xx - t * xy, yy + t * xy, 0.0, c * xz - s * yz, s * xz + c * yz
        ax, ay, az, bx, by, bz = turned(c, s, ax, ay, az, bx, by, bz)
        c, s, t = rotation(xx, zz, xz)
        xx, zz, xz, xy, yz = xx - t * xz, zz + t * xz, 0.0, c * xy - s * yz, s * xy + c * yz
        ax, ay, az, cx, cy, cz = turned(c, s, ax, ay, az, cx, cy, cz)
        c, s, t = rotation(yy, zz, yz)
        yy, zz, yz, xy, xz = yy - t * yz, zz + t * yz, 0.0, c * xy - s * xz, s * xy + c * xz
        bx, by, bz, cx, cy, cz = turned(c, s, bx, by, bz, cx, cy, cz)
    return xx, yy, zz, ax, ay, az, bx, by, bz, cx, cy, cz


def assembled(
    a: float,
    b: float,
    c: float,
    ax: float,
    ay: float,
    az: float,
    bx: float,
    by: float,
    bz: float,
    cx: float,
    cy: float,
    cz: float,
) -> tuple[float, float, float, float, float, float]:
    """Compute the symmetric tensor with these principal values and directions.

    Parameters
    ----------
    a, b, c : float
        Principal values.
    ax, ay, az, bx, by, bz, cx, cy, cz : float [1]
        Their directions.
    """
    return (
        a * ax * ax + b * bx * bx + c * cx * cx,
        a * ay * ay + b * by * by + c * cy * cy,
        a * az * az + b * bz * bz + c * cz * cz,
        a * ax * ay + b * bx * by + c * cx * cy,
        a * ax * az + b * bx * bz + c * cx * cz,
        a * ay * az + b * by * bz + c * cy * cz,
    )


def principal_strain(value: float) -> float:
    """Compute log(1 + value) / 2 [1], limited to the allowed stretches.

    Parameters
    ----------
    value : float [1]
        Principal value of b - I.
    """
    smallest, largest = SMALLEST_STRETCH * SMALLEST_STRETCH - 1.0, LARGEST_STRETCH * LARGEST_STRETCH - 1.0
    return 0.5 * log1p(min(max(value, smallest), largest))
