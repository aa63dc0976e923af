from .face import *
from .face import __all__ as __all__

__version__: str
