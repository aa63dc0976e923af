"""ASCII grids, as model intercomparisons exchange them."""

import os
import tempfile
from pathlib import Path

import rasterio
import rasterio.shutil

from ..errors import InputError, OutputError, one_line
from ..fields import Quantity
from ..geo.georeference import warp_command
from .geotiff import write_rows


def require_square(grid, what, path):
    """Refuse a grid that an ASCII grid cannot hold: rotated, or with oblong pixels; it is that of the DTM at `path`."""
    t = grid.transform
    if t.b or t.d or abs(abs(t.a) - abs(t.e)) > 1e-9 * abs(t.a):
        size = f"{grid.cell_size:.6g}"
        raise InputError(
            f"{what} writes ASCII grids, which need square pixels along north; warp the DTM: "
            f"{warp_command(path, size=size)}"
        )


def write_ascii_grid(path, grid, values):
    """Write float array [rows, columns] as an ASCII grid (NaN: -9999) with its .prj; `path` must be new."""
    path = Path(path)
    with tempfile.TemporaryDirectory() as folder:
        plain = os.path.join(folder, "values.tif")
        write_rows(plain, grid, [Quantity("values", "1", "")], {}, lambda _, first, last: values[first:last])
        try:
            rasterio.shutil.copy(plain, path, driver="AAIGrid", decimal_precision=4)
        except rasterio.errors.RasterioError as error:
            raise OutputError(f"{path}: cannot be written ({one_line(error)})") from error
    path.with_name(path.name + ".aux.xml").unlink(missing_ok=True)
