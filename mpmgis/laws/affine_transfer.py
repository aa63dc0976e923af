"""Part of a point's velocity gradient that the 3D transfer keeps for the next step (Jiang et al. 2015)."""

# APIC: the whole gradient. Exact for linear fields.
WHOLE_GRADIENT = 0
# RPIC: only the antisymmetric part, its rotation. Angular momentum is conserved, strain rates diffuse. Not available in
# scenes; used in tests of results that must not depend on the transfer.
TURNING_GRADIENT = 1
