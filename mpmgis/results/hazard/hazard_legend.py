"""Draw the column of explanations of a printed sheet: headings, patches, wrapped text, the matrix of hazard levels."""

import math
import textwrap
from collections.abc import Sequence, Set
from typing import TYPE_CHECKING, Any

from ...maps.export.run_picture import INK
from .hazard_levels import HazardMatrix

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MM = 1.0 / 25.4  # [inch] a millimetre
POINT = 25.4 / 72.0  # [mm] a point
SMALL = 4.6  # [points] letters in the matrix
HEADING = 7.2  # [points] letters of a heading
SIZES = (6.0, 5.5, 5.0, 4.6)  # [points] of text: the largest with which all of it fits
LETTER = 0.54  # [1] mean width of a letter over its size
SPACING = 1.3  # [1] of lines over the size of letters
OPACITY = 0.68  # [1] of the zones on the map; the legend has the same colours
ROW = 8.0  # [mm] height of a cell of the matrix
HEAD = 5.5  # [mm] height of the headings of the matrix
FOOT = 3.5  # [mm] height of the foot of the matrix


class Column:
    """Writes from the top of a column down; lengths in mm from the upper left corner of the sheet.

    Parameters
    ----------
    figure : Figure
        Of the size of the sheet.
    left, top, width : float [mm]
        Of the column on the sheet.
    height : float [mm]
        Of the sheet.
    """

    def __init__(self, figure: "Figure", left: float, top: float, width: float, height: float) -> None:
        self.figure, self.left, self.y, self.width, self.height = figure, left, top, width, height
        self.size = SIZES[0]

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of the figure [inch] of a place on the sheet.

        Parameters
        ----------
        x : float [mm]
            From the left edge of the column.
        y : float [mm]
            From the upper edge of the sheet, down.

        Returns
        -------
        (float, float) [inch]
        """
        return (self.left + x) * MM, (self.height - y) * MM

    def letters(self, size: float, width: float) -> int:
        """Return the number of letters of a size that fit in a width.

        Parameters
        ----------
        size : float [points]
        width : float [mm]
        """
        return max(4, int(width / (LETTER * size * POINT)))

    def heading(self, words: str) -> None:
        """Write a line in bold letters, wrapped.

        Parameters
        ----------
        words : str
        """
        self.y += 1.6
        self._lines(textwrap.wrap(words, self.letters(HEADING * 1.06, self.width)), HEADING, weight="bold")

    def text(self, words: str, least: float = 0.0, **look: Any) -> int:
        """Write a wrapped text; leave out what would come too close to the lower edge.

        Parameters
        ----------
        words : str
        least : float [mm]
            Least distance to the lower edge.
        **look : properties of the Text

        Returns
        -------
        int
            Number of lines that were left out.
        """
        lines = self._wrapped(words)
        room = max(0, int((self.height - least - self.y) / self._line))
        shown = lines
        if len(lines) > room:
            shown = [*lines[: room - 1], lines[room - 1][:-4] + " ..."] if room else []
        self._lines(shown, self.size, **look)
        return len(lines) - len(shown)

    def fit(self, texts: Sequence[str], room: float) -> None:
        """Choose the largest of SIZES with which all texts fit, else the smallest.

        Parameters
        ----------
        texts : sequence of str
        room : float [mm]
            Height.
        """
        for size in SIZES:
            self.size = size
            if self.needed(texts) <= room:
                return

    def needed(self, texts: Sequence[str]) -> float:
        """Return the height of texts [mm].

        Parameters
        ----------
        texts : sequence of str
        """
        return sum(len(self._wrapped(words)) for words in texts) * self._line

    @property
    def _line(self) -> float:
        """Height of a line of text [mm]."""
        return self.size * SPACING * POINT

    def _wrapped(self, words: str) -> list[str]:
        return textwrap.wrap(words, self.letters(self.size, self.width), subsequent_indent="  ")

    def _lines(self, lines, size, x=0.0, **look):
        for line in lines:
            at = self.place(x, self.y)
            self.figure.text(
                *at, line, va="top", transform=self.figure.dpi_scale_trans, **{"fontsize": size, "color": INK, **look}
            )
            self.y += size * SPACING * POINT

    def patch(self, words: str, **look: Any) -> None:
        """Draw a coloured patch with words beside it.

        Parameters
        ----------
        words : str
        **look : properties of the Rectangle
        """
        top = self.y
        self.box(0.0, top + 0.3, 6.0, 3.0, **look)
        self._lines(textwrap.wrap(words, self.letters(self.size, self.width - 8.0)), self.size, x=8.0)
        self.y = max(self.y, top + 3.9)

    def box(self, x: float, y: float, width: float, height: float, **look: Any) -> None:
        """Draw a rectangle.

        Parameters
        ----------
        x : float [mm]
            Left edge, from that of the column.
        y : float [mm]
            Upper edge, from that of the sheet, down.
        width, height : float [mm]
        **look : properties of the Rectangle
        """
        from matplotlib.patches import Rectangle

        look = {"edgecolor": INK, "linewidth": 0.4} | look
        at = self.place(x, y + height)
        box = Rectangle(at, width * MM, height * MM, transform=self.figure.dpi_scale_trans, **look)
        self.figure.add_artist(box)

    def corner(self, x: float, y: float, width: float, height: float, colour: Any) -> None:
        """Draw the lower left half of a box in another colour.

        Parameters
        ----------
        x, y : float [mm]
            Of the upper left corner of the box, as for `box`.
        width, height : float [mm]
        colour : colour of matplotlib
        """
        from matplotlib.patches import Polygon

        points = [self.place(x, y), self.place(x, y + height), self.place(x + width, y + height)]
        self.figure.add_artist(
            Polygon(points, facecolor=colour, edgecolor="none", transform=self.figure.dpi_scale_trans)
        )

    def words(self, x: float, y: float, width: float, words: str, **look: Any) -> None:
        """Write small centred words in a box.

        Parameters
        ----------
        x, y : float [mm]
            Middle of the box, as for `place`.
        width : float [mm]
        words : str
        **look : properties of the Text
        """
        lines = "\n".join(textwrap.wrap(words, self.letters(SMALL * 1.06, width - 1.0)))
        at = self.place(x, y)
        look = {"fontsize": SMALL, "color": INK, "ha": "center", "va": "center", "linespacing": 1.05} | look
        self.figure.text(*at, lines, transform=self.figure.dpi_scale_trans, **look)


def draw_matrix(column: Column, matrix: HazardMatrix, used: Set[str]) -> None:
    """Draw the matrix: return periods from the left, intensity classes from the lowest, with their limits.

    Columns without a scenario are marked. Divided cells have both colours; the higher one counts.

    Parameters
    ----------
    column : Column
    matrix : HazardMatrix
    used : set of str
        Names of the periods that have a scenario.
    """
    column.heading("Matrix: return period, intensity")
    width = column.width / len(matrix.periods)
    top = column.y + HEAD
    most = max(len(period.cells) for period in matrix.periods)
    for k, period in enumerate(matrix.periods):
        x = k * width
        column.words(x + 0.5 * width, column.y + 0.5 * HEAD, width, f"{period.name}, {period.words()}")
        for row, (entry, cell) in enumerate(zip(period.guideline.classes, period.cells, strict=True)):
            y = top + (most - 1 - row) * ROW
            _draw_cell(column, matrix, (x, y, width), entry, cell)
        words = "scenario given" if period.name in used else "NO SCENARIO"
        column.words(
            x + 0.5 * width,
            top + most * ROW + 0.5 * FOOT,
            width,
            words,
            fontweight="normal" if period.name in used else "bold",
        )
    column.y = top + most * ROW + FOOT + 0.5
    if any(len(set(cell)) > 1 for period in matrix.periods for cell in period.cells):
        column.text("Cells of two colours are divided in the guideline; the higher level is taken.")
    if not math.isfinite(matrix.periods[-1].up_to):
        return
    column.text(f"Return periods of more than {matrix.periods[-1].up_to:g} years are not in this matrix.")


def _draw_cell(column, matrix, box, entry, cell):
    from matplotlib.colors import to_rgba

    def colour(number):
        return "white" if number == 0 else to_rgba(matrix.levels[number - 1].colour, OPACITY)

    x, y, width = box
    column.box(x, y, width, ROW, facecolor=colour(cell[-1]))
    if len(set(cell)) > 1:
        column.corner(x, y, width, ROW, "white")
        column.corner(x, y, width, ROW, colour(cell[0]))
    column.words(x + 0.5 * width, y + 0.5 * ROW, width, f"{entry.name}: {entry.words()}")
