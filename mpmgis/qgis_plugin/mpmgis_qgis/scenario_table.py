"""Show the scenarios of a hazard map as a table of return periods and results, with a button to choose a folder.

As a value of the parameter it is text, a line `YEARS=RESULTS` for each scenario, as in scripts and models.
"""

from __future__ import annotations

from processing.gui.wrappers import DIALOG_BATCH, WidgetWrapper
from qgis.PyQt.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QHeaderView,
    QLineEdit,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from .parameters import split

HEADINGS = ("Return period [years]", "Results: folder of frames or maps")
HEIGHT = 170  # [pixels]: four scenarios


class ScenarioTable(QWidget):
    """The table with its buttons."""

    def __init__(self):
        super().__init__()
        self.table = QTableWidget(0, len(HEADINGS))
        self.table.setHorizontalHeaderLabels(HEADINGS)
        self.table.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        self.table.horizontalHeader().setStretchLastSection(True)
        self.table.verticalHeader().hide()
        self.table.setMinimumHeight(HEIGHT)
        choose, remove, buttons = QPushButton("Add results..."), QPushButton("Remove"), QHBoxLayout()
        choose.clicked.connect(self._choose)
        remove.clicked.connect(lambda: self.table.removeRow(self.table.currentRow()))
        buttons.addWidget(choose)
        buttons.addWidget(remove)
        buttons.addStretch(1)
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.addWidget(self.table)
        whole.addLayout(buttons)

    def _choose(self):
        folder = QFileDialog.getExistingDirectory(self, "Results of a scenario")
        if folder:
            self.add("", folder)

    def add(self, years: str, results: str) -> None:
        """Add a scenario; without a return period its cell is opened for typing.

        Parameters
        ----------
        years, results : str
        """
        row = self.table.rowCount()
        self.table.insertRow(row)
        for column, text in enumerate((years, results)):
            self.table.setItem(row, column, QTableWidgetItem(text))
        if not years:
            self.table.setCurrentCell(row, 0)
            self.table.editItem(self.table.item(row, 0))

    def text(self) -> str:
        """Return the scenarios as lines; rows without results are left out."""
        rows = ([self._cell(row, column) for column in (0, 1)] for row in range(self.table.rowCount()))
        return "\n".join(f"{years}={results}" for years, results in rows if results)

    def set_text(self, text: str) -> None:
        """Show the scenarios of lines.

        Parameters
        ----------
        text : str
        """
        self.table.setRowCount(0)
        for line in split(text):
            years, _, results = line.partition("=")
            self.add(years or "?", results)

    def _cell(self, row, column):
        item = self.table.item(row, column)
        return item.text().strip() if item is not None else ""


class ScenarioWrapper(WidgetWrapper):
    """The widget of the parameter in the form; a line of text in a batch."""

    def createWidget(self, **_: object) -> QWidget:
        """Return a new widget; called by QGIS, like the following methods.

        Parameters
        ----------
        **_ : object
            Unused.
        """
        return QLineEdit() if self.dialogType == DIALOG_BATCH else ScenarioTable()

    def setValue(self, value: object) -> None:
        """Show a value.

        Parameters
        ----------
        value : str or None
        """
        show = self.widget.setText if self.dialogType == DIALOG_BATCH else self.widget.set_text
        show(str(value or ""))

    def value(self) -> str:
        """Return the value."""
        return self.widget.text()
