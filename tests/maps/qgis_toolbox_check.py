"""Uses the toolbox in QGIS without a window, and prints facts as one JSON object on stdout.

Run by a Python that has PyQGIS: `python3 qgis_toolbox_check.py PLUGINS SITE COMMAND SLEEPER`; PLUGINS is the folder
that holds the plugin, SITE one with dtm.tif and release.gpkg, COMMAND is `mpmgis`, SLEEPER a program that never ends.
"""

import json
import os
import sys
import tempfile
import time

os.environ["QT_QPA_PLATFORM"] = "offscreen"
os.environ["QGIS_CUSTOM_CONFIG_PATH"] = os.environ["XDG_RUNTIME_DIR"] = tempfile.mkdtemp(prefix="qgis_toolbox_")

from qgis.core import (
    QgsApplication,
    QgsCoordinateReferenceSystem,
    QgsCoordinateTransform,
    QgsFeature,
    QgsGeometry,
    QgsPointXY,
    QgsProcessingAlgRunnerTask,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProject,
    QgsRasterLayer,
    QgsVectorLayer,
)
from qgis.PyQt.QtWidgets import QDialog

PLUGINS, SITE, COMMAND, SLEEPER = sys.argv[1:]
# what QGIS has in its environment on Windows and macOS, and what keeps another Python from starting
FOREIGN = {"PYTHONHOME": "/nowhere", "PROJ_LIB": "/nowhere", "PROJ_DATA": "/nowhere"}
DEM, RELEASE = os.path.join(SITE, "dtm.tif"), os.path.join(SITE, "release.gpkg")


class Feedback(QgsProcessingFeedback):
    """Stores messages; cancels at the first line that begins with `stop_at`."""

    def __init__(self, stop_at=None):
        super().__init__(False)
        self.said, self.printed, self.errors, self.stop_at = [], [], [], stop_at
        self.texts, self.warnings = [], []

    def pushInfo(self, line):
        self.said.append(line)
        if self.stop_at and line.startswith(self.stop_at):
            self.cancel()

    def setProgressText(self, text):
        self.texts.append(text)

    def pushWarning(self, line):
        self.warnings.append(line)

    def pushCommandInfo(self, line):
        self.said.append(line)

    def pushConsoleInfo(self, line):
        self.printed.append(line)

    def reportError(self, line, fatalError=False):
        self.errors.append(line)


def use(name, stop_at=None, project=None, **parameters):
    """Results, messages and output of an algorithm, or its error."""
    import processing

    feedback, context = Feedback(stop_at), QgsProcessingContext()
    context.setProject(project or QgsProject.instance())
    try:
        outputs, error = processing.run(f"mpmgis:{name}", parameters, feedback=feedback, context=context), None
    except QgsProcessingException as exception:
        outputs, error = {}, str(exception)
    return {
        "outputs": {key: value for key, value in outputs.items() if isinstance(value, str)},
        "error": error or "",
        "errors": feedback.errors,
        "said": feedback.said,
        "printed": feedback.printed,
        "texts": feedback.texts,
        "warnings": feedback.warnings,
        "progress": feedback.progress(),
        "to_load": [details.name for details in context.layersToLoadOnCompletion().values()],
    }


def set_command(path):
    from processing.core.ProcessingConfig import ProcessingConfig

    ProcessingConfig.setSettingValue("MPMGIS_COMMAND", path)


def tree(node):
    """Names of the groups and layers below a node of the layer tree, nested."""
    return [{child.name(): tree(child)} if hasattr(child, "addGroup") else child.name() for child in node.children()]


def unsaved_release(of, crs="EPSG:32632"):
    """The polygons of the release as an unsaved layer, in `crs` or without CRS."""
    layer = QgsVectorLayer("Polygon?field=thickness:double", "unsaved", "memory")
    layer.setCrs(QgsCoordinateReferenceSystem(crs))
    for feature in QgsVectorLayer(of, "release", "ogr").getFeatures():
        copy = QgsFeature(layer.fields())
        copy.setGeometry(feature.geometry())
        copy.setAttributes([feature["thickness"]])
        layer.dataProvider().addFeatures([copy])
    layer.updateExtents()
    return layer


def unsaved_point():
    """A point below the release, as an unsaved layer in degrees."""
    layer = QgsVectorLayer("Point?crs=EPSG:4326&field=name:string", "gauge", "memory")
    feature = QgsFeature(layer.fields())
    transform = QgsCoordinateTransform(QgsCoordinateReferenceSystem("EPSG:32632"), layer.crs(), QgsProject.instance())
    feature.setGeometry(QgsGeometry.fromPointXY(transform.transform(QgsPointXY(500_105, 5_200_195))))
    feature.setAttributes(["below"])
    layer.dataProvider().addFeatures([feature])
    return layer


def in_background(name, **parameters):
    """Success and results of an algorithm in a background task, as run by the QGIS window."""
    algorithm = QgsApplication.processingRegistry().createAlgorithmById(f"mpmgis:{name}")
    context, feedback, ended = QgsProcessingContext(), QgsProcessingFeedback(False), []
    task = QgsProcessingAlgRunnerTask(algorithm, parameters, context, feedback)

    def end(succeeded, outputs):
        ended.append([succeeded, outputs.get("ANSWER", "")])

    task.executed.connect(end)
    QgsApplication.taskManager().addTask(task)
    begin = time.monotonic()
    while not ended and time.monotonic() - begin < 60:
        QgsApplication.processEvents()
        time.sleep(0.02)
    return ended


def simulate(folder, **more):
    given = {"DEM": DEM, "RELEASE": RELEASE, "END_TIME": 6, "FRAME_INTERVAL": 2, "OUTPUT": folder, "THREADS": 1}
    return use("simulate", **given | more)


def check_simulation():
    folder = os.path.join(SITE, "slide")
    QgsProject.instance().addMapLayer(unsaved_release(RELEASE))
    found = {"simulate": simulate(folder, RELEASE=unsaved_release(RELEASE), THICKNESS_COLUMN="thickness")}
    project = QgsProject.instance()
    layers = project.mapLayers().values()
    found["tree"] = tree(project.layerTreeRoot())
    found["valid"] = [layer.isValid() for layer in layers]
    found["renderers"] = sorted({layer.renderer().type() for layer in layers if isinstance(layer, QgsRasterLayer)})
    found["timed"] = sum(layer.temporalProperties().isActive() for layer in layers if layer.temporalProperties())
    found["has_times"] = project.timeSettings().temporalRange().begin().isValid()
    found["again"] = simulate(folder)
    frames = found["simulate"]["outputs"]["FRAMES"]
    maps, bands = os.path.join(SITE, "maps"), ["p", "n"]
    found["export"] = use("exportraster", FRAMES=frames, CELL="5", STEP="4", PRODUCTS=bands, OUTPUT=maps)
    found["count_twice"] = len(project.mapLayers()) / len(found["valid"])
    film, more = os.path.join(SITE, "film.gif"), os.path.join(SITE, "more")
    found["unloaded"] = use("exportraster", FRAMES=frames, OUTPUT=more, ANIMATION=film, LOAD=False)
    found["compare"] = use("compare", FIRST=os.path.join(SITE, "maps"), OUTLINE=RELEASE)
    found["unclear"] = use("compare", FIRST=os.path.join(SITE, "maps"))
    found["intensity"] = use("intensity", FRAMES=os.path.join(SITE, "maps"), GUIDELINE="swiss-debris-flow")
    found["report"] = use("report", FRAMES=frames, OUTPUT=os.path.join(SITE, "slide.html"))
    found["timeseries"] = use("timeseries", FRAMES=os.path.join(SITE, "maps"), POINTS=unsaved_point())
    found["flat"] = use("vertical", FRAMES=frames, PLACE="500105,5200195 [EPSG:32632]")
    found["both"] = use("vertical", FRAMES=frames, PLACE="500105,5200195 [EPSG:32632]", POINTS=unsaved_point())
    found["classes"] = use(
        "compare", FIRST=os.path.join(SITE, "maps"), OUTLINE=RELEASE, OUTPUT=os.path.join(SITE, "compared")
    )
    found["effects"] = use("effects", SCENE=found["simulate"]["outputs"]["SCENE"])
    return found


def check_many_runs():
    """A study and an ensemble of the scene written by the form; the maps go into an empty project."""
    scene = os.path.join(SITE, "slide", "scene.toml")
    QgsProject.instance().clear()
    found = {"study": use("study", SCENE=scene, KNOBS="cfl", REPEATS=1, NO_EXPORTS=True, THREADS=1)}
    varied = "friction.mu=0.1,0.2\nfriction.xi=500,1000"
    found["ensemble"] = use("ensemble", SCENE=scene, VARY=varied, EXCEED="h=0.5; Ut=1", WORKERS=1)
    layers = QgsProject.instance().mapLayers().values()
    found["maps"] = [[layer.name(), layer.isValid(), layer.renderer().type()] for layer in layers]
    found["no_such_key"] = use("ensemble", SCENE=scene, VARY="friction.moo=1:2", OVERWRITE=True)
    return found


def check_refusals():
    """Input rejected by the command leaves the form's folder unchanged, also with an existing scene."""
    new, earlier = os.path.join(SITE, "refused"), os.path.join(SITE, "slide")
    with open(os.path.join(earlier, "scene.toml")) as scene:
        before = scene.read()
    found = {"refused": simulate(new, THICKNESS="no_such_column"), "refused_left": os.path.exists(new)}
    found["both_thicknesses"] = simulate(new, THICKNESS="2", THICKNESS_COLUMN="thickness")
    found["replaced"] = simulate(earlier, THICKNESS="no_such_column", OVERWRITE=True)
    with open(os.path.join(earlier, "scene.toml")) as scene:
        found["as_before"] = scene.read() == before
    found["placeless"] = simulate(new, RELEASE=unsaved_release(RELEASE, ""))
    return found


def check_forms():
    """Help of every parameter, and texts of each algorithm."""
    provider = QgsApplication.processingRegistry().providerById("mpmgis")
    return {
        "help": {
            algorithm.name(): [definition.help() for definition in algorithm.parameterDefinitions()]
            for algorithm in provider.algorithms()
        },
        "texts": {algorithm.name(): algorithm.shortHelpString() for algorithm in provider.algorithms()},
        "icons": {algorithm.group(): _drawn(algorithm.icon()) for algorithm in provider.algorithms()},
        "scenarios": _scenarios(provider.algorithm("hazard").parameterDefinition("SCENARIO")),
        "columns": [_column(provider.algorithm("region"), name) for name in ("SCENARIO", "FREQUENCY")],
    }


def _scenarios(definition):
    """Value of the table of scenarios, as QGIS makes it for a form."""
    from processing.gui.wrappers import WidgetWrapperFactory

    dialog = QDialog()  # kept while the wrapper is used
    wrapper = WidgetWrapperFactory.create_wrapper(definition, dialog)
    wrapper.setValue("30=a; 100=b")
    wrapper.widget.add("300", "c")
    wrapper.widget.add("", "")
    return wrapper.value()


def _column(algorithm, name):
    definition = algorithm.parameterDefinition(name)
    return [definition.type(), definition.parentLayerParameterName()]


def _drawn(icon):
    """Checksum of an icon of 24 x 24 pixels, 0 where nothing is drawn."""
    picture = icon.pixmap(24, 24).toImage()
    return sum((k + 1) * picture.pixel(k % 24, k // 24) for k in range(24 * 24)) if not picture.isNull() else 0


def check_seed():
    found = {"seed": use("seed", DEM=DEM, RELEASE=RELEASE, COUNT=200, OUTPUT=os.path.join(SITE, "seed.gpkg"))}
    found["existing"] = use("seed", DEM=DEM, RELEASE=RELEASE, OUTPUT=os.path.join(SITE, "seed.gpkg"))
    found["temporary"] = use("seed", DEM=DEM, RELEASE=RELEASE, COUNT=50, OUTPUT="TEMPORARY_OUTPUT")
    found["background"] = in_background("info", FILE=DEM)
    found["local"] = use("seed", DEM=DEM, RELEASE=RELEASE, THICKNESS="no_such_column", OUTPUT="TEMPORARY_OUTPUT")
    return found


def check_command():
    set_command(SLEEPER)
    found = {"cancelled": use("effects", stop_at="t = ")}
    gone = os.path.join(SITE, "gone")
    os.symlink(COMMAND, gone)
    set_command(gone)
    os.remove(gone)
    found["missing"] = use("effects")
    found["missing_at_once"] = QgsApplication.processingRegistry().createAlgorithmById("mpmgis:seed").canExecute()
    set_command("")
    os.environ["PATH"], path = "/nowhere", os.environ["PATH"]
    found["not_on_path"] = use("effects")
    os.environ["PATH"] = path
    return found


def main():
    QgsApplication.setPrefixPath("/usr", True)
    application = QgsApplication([], True)
    application.initQgis()
    sys.path += [os.path.join(QgsApplication.pkgDataPath(), "python", "plugins"), PLUGINS]
    from processing.core.Processing import Processing

    Processing.initialize()
    import mpmgis_qgis

    plugin = mpmgis_qgis.classFactory(None)
    plugin.initProcessing()
    set_command(COMMAND)
    os.environ.update(FOREIGN)
    provider = QgsApplication.processingRegistry().providerById("mpmgis")
    report = {"algorithms": sorted(algorithm.name() for algorithm in provider.algorithms())}
    report |= check_forms() | check_seed() | check_simulation() | check_many_runs() | check_refusals() | check_command()
    plugin.unload()
    report["unloaded_provider"] = QgsApplication.processingRegistry().providerById("mpmgis") is None
    print("REPORT " + json.dumps(report), flush=True)
    os._exit(0)  # QGIS' own teardown may crash after the answer is out


if __name__ == "__main__":
    main()
