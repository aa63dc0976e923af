"""Show the form *Install mpmgis*: where from, with which Python, progress, log, and removal."""

from __future__ import annotations

import os
import time

from qgis.PyQt.QtCore import QTimer, QUrl
from qgis.PyQt.QtGui import QDesktopServices, QFontDatabase
from qgis.PyQt.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QFileDialog,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QMessageBox,
    QPlainTextEdit,
    QProgressBar,
    QPushButton,
    QRadioButton,
    QVBoxLayout,
    QWidget,
)

from . import own_environment, python_search
from .installation import Installation, usable_pythons

WIDTH, HEIGHT = 720, 560  # [pixels]
LONGEST = 90  # [characters] of the line that says what is done
INDENT = 22  # [pixels] of lines that belong to a choice
NEEDS = "Downloads about 250 MB and takes 0.8 GB on the disk. QGIS and its Python are not changed."
NO_PYTHON = (
    "No Python 3.11 to 3.14 of 64 bits was found. Install one from python.org (Linux: python3 and python3-venv), or "
    "choose its program here; then open this form again."
)


class InstallForm(QDialog):
    """The form; `home` is the folder of mpmgis in the profile, `version` that of the plugin."""

    def __init__(self, home: str, version: str, parent: QWidget | None = None):
        super().__init__(parent)
        self.home, self.version, self.installation = home, version, None
        self.setWindowTitle("Install mpmgis")
        self.resize(WIDTH, HEIGHT)
        self._build()
        self._seconds = QTimer(self)
        self._seconds.timeout.connect(self._show_time)
        self._find_pythons()
        self._refresh()

    def _build(self):
        self.state = QLabel()
        self.state.setWordWrap(True)
        self.from_index = QRadioButton(f"From the package index (internet): mpmgis {self.version}")
        self.from_index.setChecked(True)
        self.from_wheel = QRadioButton("From a file, without or with little internet:")
        self.from_wheel.toggled.connect(self._refresh)
        self.wheel, self.wheel_row = self._chooser(f"mpmgis-{self.version}-py3-none-any.whl", self._choose_wheel)
        self.folder, self.folder_row = self._chooser("empty: from the package index", self._choose_folder)
        self.films = QCheckBox("Also films of the flow (ffmpeg: 70 MB more to download, 170 MB on the disk)")
        self.player = QCheckBox("Player of flows in reports (Bokeh: 45 MB on the disk)")
        self.pythons, self.python_row = QComboBox(), QPushButton("...")
        self.python_row.clicked.connect(self._choose_python)
        self.python_row.setMaximumWidth(40)
        self.needs = QLabel(f"{NEEDS} Folder: {self.home}")
        self.needs.setWordWrap(True)
        self.bar, self.doing = QProgressBar(), QLabel()
        self.bar.setRange(0, 1000)
        self.bar.setTextVisible(False)
        self.log = QPlainTextEdit()
        self.log.setReadOnly(True)
        self.log.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.log.setLineWrapMode(QPlainTextEdit.LineWrapMode.NoWrap)
        self.begin, self.stop = QPushButton("Install"), QPushButton("Cancel")
        self.remove, self.show_log, self.leave = QPushButton("Remove"), QPushButton("Open log"), QPushButton("Close")
        self.begin.clicked.connect(self.install)
        self.begin.setDefault(True)
        self.stop.clicked.connect(self.cancel)
        self.remove.clicked.connect(self._ask_to_remove)
        self.show_log.clicked.connect(self._open_log)
        self.leave.clicked.connect(self.close)
        self._arrange()

    def _arrange(self):
        choices = QGridLayout()
        choices.setColumnMinimumWidth(0, INDENT)
        choices.setColumnStretch(2, 1)
        choices.addWidget(self.from_index, 0, 0, 1, 3)
        choices.addWidget(self.from_wheel, 1, 0, 1, 3)
        for row, (label, layout) in enumerate(
            (("Wheel of mpmgis", self.wheel_row), ("Folder with the wheels of its libraries", self.folder_row)), start=2
        ):
            choices.addWidget(QLabel(label), row, 1)
            choices.addLayout(layout, row, 2)
        python = QHBoxLayout()
        python.addWidget(QLabel("Python"))
        python.addWidget(self.pythons, 1)
        python.addWidget(self.python_row)
        buttons = QHBoxLayout()
        for button in (self.remove, self.show_log):
            buttons.addWidget(button)
        buttons.addStretch(1)
        for button in (self.begin, self.stop, self.leave):
            buttons.addWidget(button)
        whole = QVBoxLayout(self)
        whole.addWidget(self.state)
        whole.addLayout(choices)
        whole.addWidget(self.films)
        whole.addWidget(self.player)
        whole.addLayout(python)
        whole.addWidget(self.needs)
        whole.addWidget(self.bar)
        whole.addWidget(self.doing)
        whole.addWidget(self.log, 1)
        whole.addLayout(buttons)

    def _chooser(self, hint, choose):
        field, button, row = QLineEdit(), QPushButton("..."), QHBoxLayout()
        field.setPlaceholderText(hint)
        field.textChanged.connect(lambda text: self.from_wheel.setChecked(True) if text else None)
        button.setMaximumWidth(40)
        button.clicked.connect(choose)
        row.addWidget(field, 1)
        row.addWidget(button)
        return field, row

    def _choose_wheel(self):
        path, _ = QFileDialog.getOpenFileName(self, "Wheel of mpmgis", "", "Wheels (mpmgis-*.whl)")
        if path:
            self.wheel.setText(path)

    def _choose_folder(self):
        path = QFileDialog.getExistingDirectory(self, "Folder with the wheels of the libraries")
        if path:
            self.folder.setText(path)

    def _choose_python(self):
        path, _ = QFileDialog.getOpenFileName(self, "Program python (Windows: python.exe)")
        if path:
            self._add_pythons(*usable_pythons([path]), chosen=True)

    def _find_pythons(self):
        """List QGIS' Python first, then the others, and say why there is none."""
        own, refused = usable_pythons(python_search.of_qgis(), of_qgis=True)
        others, also_refused = usable_pythons(python_search.elsewhere(dict(os.environ)))
        listed = {os.path.realpath(python.path) for python in own}
        others = [python for python in others if os.path.realpath(python.path) not in listed]
        self._add_pythons(own + others, [] if own + others else refused + also_refused)

    def _add_pythons(self, found, refused, chosen=False):
        for line in refused:
            self.log.appendPlainText(line)
        for python in found:
            self.pythons.addItem(python.label, python)
        if found and chosen:
            self.pythons.setCurrentIndex(self.pythons.count() - 1)
        self.doing.setText("" if self.pythons.count() else NO_PYTHON)
        self.doing.setWordWrap(True)
        self._refresh()

    def source(self) -> own_environment.Source:
        """Return what is to be installed."""
        boxes = ((self.films, own_environment.FILMS), (self.player, own_environment.PLAYER))
        parts = tuple(part for box, part in boxes if box.isChecked())
        if self.from_index.isChecked():
            return own_environment.Source(self.version, parts=parts)
        wheel, folder = (field.text().strip().strip('"') for field in (self.wheel, self.folder))
        return own_environment.Source(self.version, wheel, folder, parts)

    def install(self) -> None:
        """Begin the installation; called by the button."""
        source = self.source()
        if self.from_wheel.isChecked() and not (source.wheel or source.folder):
            trouble = "Give the wheel of mpmgis, or a folder that has it together with its libraries"
        else:
            trouble = own_environment.trouble_of(source)
        if trouble:
            self.doing.setText(trouble)
            return
        self.log.clear()
        self.installation = Installation(self.home, self.pythons.currentData(), source)
        self.installation.said.connect(self.log.appendPlainText)
        self.installation.progressed.connect(self._show_progress)
        self.installation.ended.connect(self._ended)
        self._begun, self._now = time.monotonic(), ""
        self._seconds.start(1000)
        self._refresh(running=True)
        self.installation.start()

    def cancel(self) -> None:
        """Stop the installation; called by the button."""
        if self.installation is not None:
            self.doing.setText("Cancelling")
            self.installation.cancel()

    def _show_progress(self, share, now):
        self.bar.setValue(round(1000 * share))
        self._now = now
        self._show_time()

    def _show_time(self):
        """Show what is done now and since when: pip writes no line while it unpacks, which takes a minute."""
        self.doing.setText(f"{time.monotonic() - self._begun:.0f} s: {self._now[:LONGEST]}")

    def _ended(self, error):
        self._seconds.stop()
        self._refresh()
        if error:
            self.bar.setValue(0)
            self.begin.setText("Try again")
            self.doing.setText(error[0].upper() + error[1:])
        else:
            self.doing.setText("Done. The forms are in the Processing toolbox, group mpmgis.")

    def _refresh(self, *_, running=False):
        record = own_environment.record_of(self.home)
        is_update = bool(record) and record.get("version") != self.version
        if not record:
            self.state.setText(f"<b>mpmgis {self.version} is not installed here.</b>")
        elif is_update:
            self.state.setText(
                f"<b>mpmgis {record.get('version')} is installed; this toolbox needs {self.version}.</b>"
            )
        else:
            self.state.setText(f"<b>mpmgis {self.version} is installed</b> and fits this toolbox.")
        self.begin.setText("Update" if is_update else "Install again" if record else "Install")
        self.begin.setEnabled(not running and self.pythons.count() > 0)
        self.stop.setEnabled(running)
        self.remove.setEnabled(not running and os.path.isdir(self.home))
        self.show_log.setEnabled(os.path.exists(os.path.join(self.home, own_environment.LOG)))
        for widget in (
            self.from_index,
            self.from_wheel,
            self.films,
            self.player,
            self.pythons,
            self.python_row,
            self.wheel,
            self.folder,
        ):
            widget.setEnabled(not running)

    def _ask_to_remove(self):
        yes = QMessageBox.StandardButton.Yes
        question = f"Remove mpmgis and its libraries?\n{self.home}\nScenes, results and maps stay."
        if QMessageBox.question(self, "Install mpmgis", question) == yes:
            self.remove_installed()

    def remove_installed(self) -> None:
        """Remove mpmgis and its environment."""
        self.doing.setText("Removing; takes some seconds")
        self.doing.repaint()
        gone = own_environment.remove_all(self.home)
        self._refresh()
        rest = f"A program still uses files in {self.home}; end it, or remove the folder later."
        self.doing.setText("mpmgis is removed." if gone else rest)
        self.bar.setValue(0)

    def _open_log(self):
        QDesktopServices.openUrl(QUrl.fromLocalFile(os.path.join(self.home, own_environment.LOG)))

    def closeEvent(self, event: object) -> None:
        """Keep the form while an installation runs; called by QGIS.

        Parameters
        ----------
        event : QCloseEvent
        """
        if self.installation is not None and self.installation.is_running():
            self.doing.setText("The installation runs; cancel it first.")
            event.ignore()
        else:
            event.accept()
