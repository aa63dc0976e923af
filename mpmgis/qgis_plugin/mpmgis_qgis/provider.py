"""The plugin and its Processing provider: the algorithms, and the setting with the path of the command."""

from __future__ import annotations

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsApplication, QgsProcessingProvider

from .algorithms import algorithms, plugin_icon
from .command import SETTING


class Provider(QgsProcessingProvider):
    """The provider `mpmgis`."""

    def load(self):
        """Declare the setting and create the algorithms; called by QGIS."""
        label = "Path of the command mpmgis (empty: search PATH)"
        ProcessingConfig.settingIcons[self.name()] = self.icon()
        ProcessingConfig.addSetting(Setting(self.name(), SETTING, label, "", valuetype=Setting.FILE))
        ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def unload(self):
        """Remove the setting; called by QGIS."""
        ProcessingConfig.removeSetting(SETTING)

    def loadAlgorithms(self):
        """Called by QGIS to get the algorithms."""
        for algorithm in algorithms():
            self.addAlgorithm(algorithm)

    def id(self):
        """First part of the algorithm names."""
        return "mpmgis"

    def name(self):
        """Name in the toolbox."""
        return "mpmgis"

    def longName(self):
        """Name in the settings."""
        return "mpmgis: landslides and avalanches"

    def icon(self):
        """The plugin's icon."""
        return plugin_icon()


class Plugin:
    """The plugin object; qgis_process calls only `initProcessing`."""

    def __init__(self):
        self.provider = None

    def initProcessing(self):
        """Add the provider."""
        self.provider = Provider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self):
        """Called by QGIS in its desktop program."""
        self.initProcessing()

    def unload(self):
        """Remove the provider."""
        if self.provider is not None:
            QgsApplication.processingRegistry().removeProvider(self.provider)
            self.provider = None
