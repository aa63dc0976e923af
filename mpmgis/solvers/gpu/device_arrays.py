"""Arrays of a solver that are copied from a CUDA device when they are read."""


class OnDevice:
    """An array of the host that is current after it is read through this attribute; the solver has `download`."""

    def __set_name__(self, owner, name):
        self._name = f"{name}_of_host"

    def __get__(self, solver, owner=None):
        if solver is None:
            return self
        solver.download()
        return getattr(solver, self._name)

    def __set__(self, solver, values):
        setattr(solver, self._name, values)
