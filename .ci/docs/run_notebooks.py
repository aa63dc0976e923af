#!/usr/bin/env python3
"""run_notebooks.py [NAME...]: run the notebooks (those whose name begins with a NAME) and store their results in them.

Readers see the results on the code host and on the website, which `build.py` makes from the stored notebooks.
"""

import os
import re
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

ROOT = Path(__file__).resolve().parents[2]
ADDRESS = re.compile(r" at 0x[0-9a-f]+")
KEPT = ("image/png", "text/plain", "text/html")  # kinds of results


def executed(path):
    """A notebook with its results. Cells have no time limit: how long they take depends on the machine."""
    book = nbformat.read(path, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        place = {"metadata": {"path": folder}}
        try:
            NotebookClient(book, timeout=None, kernel_name="python3", resources=place).execute()
        except CellExecutionError as error:
            raise SystemExit(f"{path.relative_to(ROOT)}: {error}") from None
    return book


def without_chance(book):
    """The notebook without what differs from run to run: times of cells, versions of the kernel, addresses."""
    book.metadata.language_info = {"name": "python", "pygments_lexer": "ipython3"}
    for cell in book.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type == "code":
            cell.outputs = joined(cell.outputs)
            for output in cell.outputs:
                output.get("metadata", {}).clear()
                if "data" in output:
                    output.data = {kind: value for kind, value in output.data.items() if kind in KEPT}
                    output.data["text/plain"] = ADDRESS.sub("", output.data["text/plain"])
    return book


def joined(outputs):
    """Outputs with what was printed in a row as one text; how it is cut depends on the speed of the machine."""
    made = []
    for output in outputs:
        if output.output_type == "stream":
            output.text = output.text.replace("\r\n", "\n")
            if made and made[-1].get("name") == output.name:
                made[-1].text += output.text
                continue
        made.append(output)
    return made


def main():
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"  # the command mpmgis
    paths = sorted((ROOT / "notebooks").glob("*.ipynb"))
    chosen = [path for path in paths if not sys.argv[1:] or path.name.startswith(tuple(sys.argv[1:]))]
    for number, path in enumerate(chosen, start=1):
        print(f"running {path.relative_to(ROOT)} ({number} of {len(chosen)})", file=sys.stderr, flush=True)
        nbformat.write(without_chance(executed(path)), path)


if __name__ == "__main__":
    main()
