"""The toolbox's entry in QGIS: its algorithms, and the setting that says where the command is."""

from __future__ import annotations

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsProcessingProvider

from .algorithms import algorithms
from .finding import SETTING
from .icons import plugin_icon


class Provider(QgsProcessingProvider):
    """The provider `mpmgis`."""

    def load(self):
        """Declare the setting and make the algorithms; called by QGIS."""
        label = "Path of the command mpmgis (empty: look on PATH)"
        ProcessingConfig.settingIcons[self.name()] = self.icon()
        ProcessingConfig.addSetting(Setting(self.name(), SETTING, label, "", valuetype=Setting.FILE))
        ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def unload(self):
        """Take the setting away again; called by QGIS."""
        ProcessingConfig.removeSetting(SETTING)

    def loadAlgorithms(self):
        """Called by QGIS when it wants the algorithms."""
        for algorithm in algorithms():
            self.addAlgorithm(algorithm)

    def id(self):
        """First part of the algorithms' names."""
        return "mpmgis"

    def name(self):
        """What the toolbox shows."""
        return "mpmgis"

    def longName(self):
        """What the settings show."""
        return "mpmgis: landslides and avalanches"

    def icon(self):
        """The plugin's own."""
        return plugin_icon()
