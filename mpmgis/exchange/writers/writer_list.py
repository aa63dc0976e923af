"""Solvers with start files, by name: to add one, write its module and add it here."""

from . import cbgeo_start, geotaichi_start, houdini_files, kratos_start, mpm_geomechanics_start, paraview_files

SOLVER_FILES = {
    module.FILES.name: module.FILES
    for module in (kratos_start, cbgeo_start, geotaichi_start, mpm_geomechanics_start, houdini_files, paraview_files)
}
