from .api import *
from .api import __all__ as __all__

__version__: str
