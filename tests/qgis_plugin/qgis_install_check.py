"""Installs mpmgis with the toolbox's form in QGIS without a window, and prints facts as one JSON object on stdout.

Run by a Python that has PyQGIS: `python3 qgis_install_check.py PLUGINS PROFILES WHEEL FOLDER LIBRARIES DTM`; FOLDER has
wheels of all libraries; LIBRARIES is a folder of the same for the installed command, or "".
"""

import glob
import importlib.metadata
import json
import os
import sys
import time

os.environ["QT_QPA_PLATFORM"] = "offscreen"
os.environ["QGIS_CUSTOM_CONFIG_PATH"] = os.environ["XDG_RUNTIME_DIR"] = sys.argv[2]
os.environ["PATH"] = "/usr/bin:/bin"  # no other mpmgis

from qgis.core import QgsApplication, QgsNetworkAccessManager, QgsProcessingFeedback
from qgis.gui import QgsMessageBar
from qgis.PyQt.QtNetwork import QNetworkProxy
from qgis.PyQt.QtWidgets import QMainWindow, QMenu, QPushButton

PLUGINS, PROFILES, WHEEL, FOLDER, LIBRARIES, DTM = sys.argv[1:]
PATIENCE = 120  # [s] for an installation


class Window:
    """What a plugin needs of the window of QGIS."""

    def __init__(self):
        self.window, self.menu, self.bar = QMainWindow(), QMenu(), QgsMessageBar()

    def mainWindow(self):
        return self.window

    def pluginMenu(self):
        return self.menu

    def messageBar(self):
        return self.bar


def wait(application, done, seconds=PATIENCE):
    end = time.monotonic() + seconds
    while not done() and time.monotonic() < end:
        application.processEvents()
        time.sleep(0.02)
    application.processEvents()
    return done()


def installed_by(application, form, wheel="", folder="", cancel_at=None):
    """What the form says after an installation; `cancel_at` is the beginning of a line at which it is cancelled."""
    form.wheel.setText(wheel)
    form.folder.setText(folder)
    ended, lines = [], []
    before = form.installation
    form.install()
    if form.installation is before:
        return {"said": form.doing.text(), "state": form.state.text(), "lines": []}
    form.installation.ended.connect(ended.append)

    def look(line):
        lines.append(line)
        if cancel_at and line.startswith(cancel_at):
            form.cancel()

    form.installation.said.connect(look)
    running = form.begin.isEnabled(), form.stop.isEnabled()
    assert wait(application, lambda: ended), "the installation does not end"
    return {
        "said": form.doing.text(),
        "state": form.state.text(),
        "begin": form.begin.text(),
        "bar": form.bar.value(),
        "running": running,
        "lines": lines,
    }


def offered(window):
    """(text, words on the button) of the message bar."""
    item = window.bar.currentItem()
    if item is None:
        return []
    return [item.text(), *(button.text() for button in item.findChildren(QPushButton))]


def distributions():
    return sorted({found.metadata["Name"] or "" for found in importlib.metadata.distributions()})


def main():
    QgsApplication.setPrefixPath("/usr", True)
    application = QgsApplication([], True)
    application.initQgis()
    sys.path += [os.path.join(QgsApplication.pkgDataPath(), "python", "plugins"), PLUGINS]
    from processing.core.Processing import Processing

    Processing.initialize()
    import mpmgis_qgis
    from mpmgis_qgis import install_form, network_proxy, own_environment, provider

    before, window, report = distributions(), Window(), {}
    home = own_environment.home_in(QgsApplication.qgisSettingsDirPath())
    plugin = mpmgis_qgis.classFactory(window)
    plugin.initGui()
    report["first_offer"] = offered(window)
    window.bar.clearWidgets()
    report["menu"] = [[action.text() for action in entry.menu().actions()] for entry in window.menu.actions()]
    algorithm = QgsApplication.processingRegistry().algorithmById("mpmgis:info")
    report["cannot"] = list(algorithm.canExecute())
    report["nothing_made"] = not os.path.exists(home)
    plugin.open_form()
    form = plugin.form
    report["pythons"] = [form.pythons.itemText(k) for k in range(form.pythons.count())]
    report["first_state"] = form.state.text()
    if report["pythons"]:
        report |= installations(application, form, home)
        site = glob.glob(os.path.join(home, own_environment.record_of(home)["folder"], "lib", "*", "site-packages"))[0]
        if LIBRARIES and f"python{sys.version_info[0]}.{sys.version_info[1]}" in site:
            with open(os.path.join(site, "zz_libraries.pth"), "w") as file:
                file.write(LIBRARIES + "\n")
            report["used"] = use(algorithm)
        report["can"] = algorithm.canExecute()[0]
        report |= update(application, plugin, window, install_form, home)
        form.remove_installed()
        report["removed"] = [form.doing.text(), os.path.exists(home), algorithm.canExecute()[0]]
    manager = QgsNetworkAccessManager.instance()
    manager.setFallbackProxyAndExcludes(
        QNetworkProxy(QNetworkProxy.ProxyType.HttpProxy, "proxy.office", 3128, "me", "a@b"),
        ["https://inside.office"],
        [],
    )
    report["proxy"] = network_proxy.proxy_of_qgis()
    plugin.unload()
    report["unloaded"] = [
        len(window.menu.actions()),
        provider.QgsApplication.processingRegistry().providerById("mpmgis"),
    ]
    report["as_before"] = distributions() == before
    print("REPORT " + json.dumps(report), flush=True)
    os._exit(0)  # QGIS' own teardown may crash after the answer is out


def installations(application, form, home):
    from mpmgis_qgis import python_search

    form.pythons.insertItem(0, "gone", python_search.Python("/nowhere/python", (3, 12), True))
    form.pythons.setCurrentIndex(0)
    gone = installed_by(application, form, WHEEL, FOLDER)
    form.pythons.removeItem(0)
    found = {"gone": gone, "other_file": installed_by(application, form, DTM)}
    found["no_libraries"] = installed_by(application, form, WHEEL, PLUGINS)
    found["cancelled"] = installed_by(application, form, WHEEL, FOLDER, cancel_at="Processing ")
    wait(application, lambda: os.listdir(home) == ["install.log"])
    found["after_cancel"] = os.listdir(home)
    found["done"] = installed_by(application, form, WHEEL, FOLDER)
    found["files"] = sorted(os.listdir(home))
    with open(os.path.join(home, "install.log"), encoding="utf-8") as log:
        found["log"] = log.read()
    return found


def use(algorithm):
    import processing

    printed = []

    class Feedback(QgsProcessingFeedback):
        def pushConsoleInfo(self, line):
            printed.append(line)

    processing.run("mpmgis:info", {"FILE": DTM}, feedback=Feedback())
    return printed


def update(application, plugin, window, install_form, home):
    """The check and the form after the plugin became newer than the installed command."""
    from mpmgis_qgis import fit_check

    answers = []
    plugin.check.checked.connect(answers.append)
    plugin.check.start()
    wait(application, lambda: answers)
    found = {"fits": answers[-1], "second_offer": offered(window)}
    newer = fit_check.plugin_version
    fit_check.plugin_version = lambda: "9.9"
    plugin.check.start()
    wait(application, lambda: len(answers) > 1)
    fit_check.plugin_version = newer
    found |= {"misfit": answers[-1], "third_offer": offered(window)}
    form = install_form.InstallForm(home, "9.9")
    found["update"] = [form.state.text(), form.begin.text()]
    found["other_version"] = installed_by(application, form, WHEEL, FOLDER)["said"]
    found["again"] = installed_by(application, plugin.form, WHEEL, FOLDER)["state"]
    wait(application, lambda: "1" not in os.listdir(home))
    found["files_again"] = sorted(os.listdir(home))
    return found


if __name__ == "__main__":
    main()
