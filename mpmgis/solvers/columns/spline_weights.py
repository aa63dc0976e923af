"""Compute the weights of the quadratic B-splines of the nodes around a place (Steffen et al. 2008).

Nodes lie on cell corners: array index k + 1 is the node at k * dx from the domain's south-west corner, so that there
is one ghost node outside each edge.
"""

from ...compiled.jit import jit_inline

INDEX_MASK = 0x3FFFFFFF  # shows the compiler that an index is not negative, which spares a test for each access


@jit_inline
def weights(position: float, inverse_dx: float) -> tuple[int, float, float, float, float]:
    """Return the quadratic B-spline weights of a place along one axis.

    Parameters
    ----------
    position : float [m]
        From the domain's south-west corner.
    inverse_dx : float [m-1]
        1 / dx.

    Returns
    -------
    int
        Index of the first of the three nodes around the place.
    float [cells]
        Offset of the place from that node.
    float, float, float
        Weights of the three nodes.
    """
    s = position * inverse_dx
    base = int(s + 0.5) & INDEX_MASK  # to the letter as in the block keys, so that both round alike
    f = s + 1.0 - base
    return base, f, 0.5 * (1.5 - f) ** 2, 0.75 - (f - 1.0) ** 2, 0.5 * (f - 0.5) ** 2
