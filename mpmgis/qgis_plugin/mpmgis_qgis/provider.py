"""Register the plugin and its Processing provider: the algorithms, and the setting with the path of the command."""

from __future__ import annotations

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsApplication, QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from .algorithms import algorithms, plugin_icon
from .command import SETTING


class Provider(QgsProcessingProvider):
    """The provider `mpmgis`."""

    def load(self) -> bool:
        """Declare the setting and create the algorithms; called by QGIS.

        Returns
        -------
        bool
            Always True.
        """
        label = "Path of the command mpmgis (empty: search PATH)"
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

    def __init__(self):
        self.provider = None

    def initProcessing(self) -> None:
        """Add the provider."""
        self.provider = Provider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self) -> None:
        """Start the plugin; called by QGIS in its desktop program."""
        self.initProcessing()

    def unload(self) -> None:
        """Remove the provider."""
        if self.provider is not None:
            QgsApplication.processingRegistry().removeProvider(self.provider)
            self.provider = None
