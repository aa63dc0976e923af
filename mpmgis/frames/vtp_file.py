"""Points with data as VTK PolyData (.vtp), for ParaView."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..system.whole_files import whole_file


def write_vtp(
    path: str | Path,
    points: np.ndarray,
    data: dict[str, np.ndarray],
    fields: dict[str, Sequence[float]],
    note: str = "",
) -> None:
    """Write points with data to `path`.

    Parameters
    ----------
    path : str or Path
    points : float64[n, 3] [m]
    data : dict of str to array[n] or array[n, k]
        Data of the points.
    fields : dict of str to sequence of float
        Data of the file: `TimeValue` [s] is the time that ParaView shows.
    note : str
        Comment in the file.
    """
    count, blocks = len(points), []
    arrays = "".join(_array(name, values, blocks) for name, values in data.items())
    place = _array("points", points, blocks)
    verts = _array("connectivity", np.arange(count), blocks)
    verts += _array("offsets", np.arange(1, count + 1), blocks)
    field_data = "".join(_field(name, values) for name, values in fields.items())
    head = (
        '<?xml version="1.0"?>\n<!-- ' + note.replace("--", "- -") + " -->\n"
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f"<PolyData><FieldData>{field_data}</FieldData>\n"
        f'<Piece NumberOfPoints="{count}" NumberOfVerts="{count}" NumberOfLines="0" NumberOfStrips="0" '
        'NumberOfPolys="0">\n'
        f"<PointData>{arrays}</PointData>\n<Points>{place}</Points>\n<Verts>{verts}</Verts>\n"
        '</Piece></PolyData>\n<AppendedData encoding="raw">\n_'
    )
    with whole_file(path) as part, open(part, "wb") as sink:
        sink.write(head.encode())
        for block in blocks:
            sink.write(np.uint64(block.nbytes).tobytes())
            sink.write(block.data)
        sink.write(b"\n</AppendedData>\n</VTKFile>\n")


def _array(name: str, values: np.ndarray, blocks: list[np.ndarray]) -> str:
    """Return the XML of an array; its bytes are appended to `blocks`."""
    kind = {"f": "Float64", "i": "Int64", "u": "UInt64"}[values.dtype.kind]
    offset = sum(block.nbytes + 8 for block in blocks)
    eight = np.ascontiguousarray(values).astype(f"<{values.dtype.kind}8", copy=False)
    blocks.append(eight)
    parts = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    return f'\n<DataArray type="{kind}" Name="{name}"{parts} format="appended" offset="{offset}"/>'


def _field(name, values):
    text = " ".join(repr(float(value)) for value in values)
    size = f'NumberOfTuples="{len(values)}"'
    return f'<DataArray type="Float64" Name="{name}" {size} format="ascii">{text}</DataArray>'
