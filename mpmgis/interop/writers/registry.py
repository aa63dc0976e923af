"""Solvers with start files, by name: to add one, write its module and add it here."""

from . import cbgeo, geotaichi, houdini, kratos, mpm_geomechanics, paraview

SOLVER_FILES = {
    module.FILES.name: module.FILES for module in (kratos, cbgeo, geotaichi, mpm_geomechanics, houdini, paraview)
}
