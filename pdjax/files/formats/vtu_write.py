"""Write a cloud of points as an unstructured grid of VTK (VTU): a vertex for every point, arrays compressed by zlib.

The arrays keep every bit. Each is a block of base64 letters: the lengths of its compressed parts, then the parts.

Source: VTK, "VTK XML Formats",
https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html
"""

import base64
import sys
import zlib
from typing import BinaryIO
from xml.sax.saxutils import quoteattr

import numpy as np

PART = 1 << 20  # bytes that are compressed together
LEVEL = 1  # the fastest level of zlib; digits of measured or computed numbers hardly become shorter by higher ones


def _array(name: str, values: np.ndarray) -> list[bytes]:
    """A DataArray element."""
    kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind]
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    words = f'<DataArray type="{kind}{8 * values.dtype.itemsize}" Name={quoteattr(name)}{width} format="binary">\n'
    data = np.ascontiguousarray(values).tobytes()
    parts = [zlib.compress(data[at : at + PART], LEVEL) for at in range(0, len(data), PART)]
    head = np.array([len(parts), PART, len(data) % PART, *map(len, parts)], np.uint64)
    return [words.encode(), base64.b64encode(head.tobytes()), base64.b64encode(b"".join(parts)), b"\n</DataArray>\n"]


def write(stream: BinaryIO, positions: np.ndarray, fields: dict[str, np.ndarray]) -> None:
    """Write points (points, 3) and their fields, of shape (points,) or (points, components), to a binary stream."""
    count, order = len(positions), "LittleEndian" if sys.byteorder == "little" else "BigEndian"
    out = [
        b'<?xml version="1.0" encoding="UTF-8"?>\n',
        f'<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{order}" header_type="UInt64"'.encode(),
        b' compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n',
        f'<Piece NumberOfPoints="{count}" NumberOfCells="{count}">\n<Points>\n'.encode(),
        *_array("Points", positions),
        b"</Points>\n<Cells>\n",
        *_array("connectivity", np.arange(count)),
        *_array("offsets", np.arange(1, count + 1)),
        *_array("types", np.ones(count, np.uint8)),
        b"</Cells>\n<PointData>\n",
    ]
    stream.writelines(out)
    for name, values in fields.items():
        stream.writelines(_array(name, values))
    stream.write(b"</PointData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n")
