"""Register the plugin: its Processing provider, the setting with the path of the command, the form for installation."""

from __future__ import annotations

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsApplication, QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon
from qgis.PyQt.QtWidgets import QPushButton

from . import versions
from .algorithms import algorithms, installed_command, plugin_icon
from .command import SETTING
from .fit_check import FitCheck, plugin_version
from .install_form import InstallForm
from .own_environment import home_in

OFFER_SECONDS = 60  # [s] that the message bar offers the installation


class Provider(QgsProcessingProvider):
    """The provider `mpmgis`."""

    def load(self) -> bool:
        """Declare the setting and create the algorithms; called by QGIS.

        Returns
        -------
        bool
            Always True.
        """
        label = "Path of the command mpmgis (empty: the installed one, or on PATH)"
        ProcessingConfig.settingIcons[self.name()] = self.icon()
        ProcessingConfig.addSetting(Setting(self.name(), SETTING, label, "", valuetype=Setting.FILE))
        ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def unload(self) -> None:
        """Remove the setting; called by QGIS."""
        ProcessingConfig.removeSetting(SETTING)

    def loadAlgorithms(self) -> None:
        """Add the algorithms; called by QGIS."""
        for algorithm in algorithms():
            self.addAlgorithm(algorithm)

    def id(self) -> str:
        """Return the first part of the algorithm names."""
        return "mpmgis"

    def name(self) -> str:
        """Return the name in the toolbox."""
        return "mpmgis"

    def longName(self) -> str:
        """Return the name in the settings."""
        return "mpmgis: landslides and avalanches"

    def icon(self) -> QIcon:
        """Return the plugin's icon."""
        return plugin_icon()


class Plugin:
    """The plugin object; qgis_process calls only `initProcessing`."""

    def __init__(self, iface: object = None):
        self.iface, self.provider, self.menu, self.form, self.check = iface, None, None, None, None

    def initProcessing(self) -> None:
        """Add the provider."""
        self.provider = Provider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self) -> None:
        """Start the plugin; called by QGIS in its desktop program."""
        self.initProcessing()
        self.menu = self.iface.pluginMenu().addMenu(plugin_icon(), "mpmgis")
        self.menu.addAction("Install mpmgis", self.open_form)
        self.check = FitCheck(ProcessingConfig.getSetting(SETTING), installed_command)
        self.check.checked.connect(self._offer)
        self.check.start()

    def open_form(self, *_: object) -> None:
        """Show the form *Install mpmgis*.

        Parameters
        ----------
        *_ : object
            Of the signal; unused.
        """
        if self.form is None:
            home = home_in(QgsApplication.qgisSettingsDirPath())
            self.form = InstallForm(home, plugin_version(), self.iface.mainWindow())
        self.form.show()
        self.form.raise_()

    def _offer(self, misfit):
        """Offer the installation in the message bar, where the command is missing or does not fit."""
        if not misfit:
            return
        bar = self.iface.messageBar()
        message = bar.createMessage("mpmgis", misfit)
        button = QPushButton("Install mpmgis", message)
        button.clicked.connect(self.open_form)
        button.clicked.connect(lambda: bar.popWidget(message))
        message.layout().addWidget(button)
        bar.pushWidget(message, versions.INFORMATION, OFFER_SECONDS)

    def unload(self) -> None:
        """Remove the provider and the form; an installation that runs is cancelled."""
        if self.form is not None:
            self.form.cancel()
            self.form.deleteLater()
        if self.menu is not None:
            self.iface.pluginMenu().removeAction(self.menu.menuAction())
        if self.provider is not None:
            QgsApplication.processingRegistry().removeProvider(self.provider)
        self.menu = self.form = self.check = self.provider = None
