"""Define the algorithms of the toolbox: one for each verb of the command, and a form for a usual simulation."""

from __future__ import annotations

import json
import os

from processing.core.ProcessingConfig import ProcessingConfig
from qgis.core import (
    QgsApplication,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingOutputFolder,
    QgsProcessingOutputHtml,
    QgsProcessingOutputString,
    QgsProcessingUtils,
)
from qgis.PyQt.QtGui import QIcon

from . import scene_form
from .calling import call, is_refusal
from .command import SETTING, CommandMissing, find_command, shown_answer
from .forms import LOAD, NEW_FILE, NEW_FOLDER, OUTPUT, Verb, arguments, read_forms, read_scene_data
from .own_environment import home_in, own_command
from .parameters import oldest_qgis, parameter, plain_values
from .restored_files import copy_whole, kept_unless, write_whole
from .result_layers import add_project, layer_of
from .table_page import page_of

ANSWER = "ANSWER"  # output: text that the command printed
TABLE = "TABLE"  # output: a page with a table, which QGIS lists there too
PLOT = "PLOT"  # output: a picture, which QGIS lists in its Results Viewer
PROJECT = "PROJECT"  # output: the project file of the maps
TAGS = ("landslide", "avalanche", "debris flow", "rock avalanche", "natural hazard", "runout")  # for the search
SCENE, FRAMES, MAPS = "SCENE", "FRAMES", "MAPS"  # outputs of the form
RUN_SHARE = 70.0  # [%] of the progress bar; the rest is the export


ICONS = {  # of a group
    "Simulate": "icon_simulate.svg",
    "Maps and answers": "icon_maps.svg",
    "Many runs": "icon_runs.svg",
    "Other 3D codes": "icon_codes.svg",
}


def plugin_icon(group: str | None = None) -> QIcon:
    """Return a new QIcon with the picture of a group, or of the plugin.

    Parameters
    ----------
    group : str, optional
        A key of ICONS.
    """
    return QIcon(os.path.join(os.path.dirname(__file__), ICONS.get(group, "icon.svg")))


class CommandAlgorithm(QgsProcessingAlgorithm):
    """Base of all algorithms: a form of fields, the command, and a project file to open at the end."""

    identifier = title = group_title = text = ""
    verbs = ()  # of the command
    form = ()

    def __init__(self):
        super().__init__()
        self.values = {}
        self.project_file = None

    def createInstance(self) -> CommandAlgorithm:
        """Return a new algorithm of this class; called by QGIS, like the following methods."""
        return type(self)()

    def name(self) -> str:
        """Return the identifier, unchanged between versions."""
        return self.identifier

    def displayName(self) -> str:
        """Return the name in the toolbox."""
        return self.title

    def group(self) -> str:
        """Return the name of the group in the toolbox."""
        return self.group_title

    def groupId(self) -> str:
        """Return the identifier of the group."""
        return self.group_title.replace(" ", "").lower()

    def icon(self) -> QIcon:
        """Return the picture of the group."""
        return plugin_icon(self.group_title)

    def tags(self) -> list[str]:
        """Return words for the search of the toolbox."""
        return [*self.verbs, *TAGS]

    def shortHelpString(self) -> str:
        """Return the help beside the form."""
        commands = " and ".join(f"mpmgis {verb}" for verb in self.verbs)
        return f"{self.text}\n\nCommand: {commands}; the log shows it with its arguments."

    def initAlgorithm(self, configuration: dict | None = None) -> None:
        """Declare the fields of the form as parameters.

        Parameters
        ----------
        configuration : dict, optional
            Unused.
        """
        for field in self.form:
            self.addParameter(parameter(field))

    def canExecute(self) -> tuple[bool, str]:
        """Return whether the command was found, and the reason if not.

        Returns
        -------
        (bool, str)
        """
        try:
            command_path()
        except QgsProcessingException as missing:
            return False, str(missing)
        return True, ""

    def prepareAlgorithm(
        self, parameters: dict, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> bool:
        """Keep the user's input as plain values, in the main thread.

        Parameters
        ----------
        parameters : dict
        context : QgsProcessingContext
        feedback : QgsProcessingFeedback

        Returns
        -------
        bool
            Always True.
        """
        self.values = plain_values(self, self.form, parameters, context, feedback)
        return True

    def postProcessAlgorithm(self, context: QgsProcessingContext, feedback: QgsProcessingFeedback) -> dict:
        """Add the exported project to the open one, in the main thread.

        Parameters
        ----------
        context : QgsProcessingContext
        feedback : QgsProcessingFeedback

        Returns
        -------
        dict
            Empty: no more outputs.
        """
        if self.project_file and context.project() is not None:
            trouble = add_project(self.project_file, context.project())
            if trouble:
                feedback.reportError(f"{self.project_file} was written, but QGIS could not load all of it: {trouble}")
        return {}


def installed_command() -> str | None:
    """Return the command that the toolbox has installed in the profile; None without one."""
    return own_command(home_in(QgsApplication.qgisSettingsDirPath()))


def command_path() -> str:
    """Return the command from the settings, of the toolbox or on PATH.

    Raises
    ------
    QgsProcessingException
        It is missing.
    """
    try:
        return find_command(ProcessingConfig.getSetting(SETTING), installed_command())
    except CommandMissing as missing:
        raise QgsProcessingException(str(missing)) from None


class VerbAlgorithm(CommandAlgorithm):
    """One verb of the command, from its row of the table."""

    row = None

    def initAlgorithm(self, configuration: dict | None = None) -> None:
        """Declare the fields of the form as parameters, and the outputs.

        Parameters
        ----------
        configuration : dict, optional
            Unused.
        """
        super().initAlgorithm(configuration)
        if not self.row.table:  # QGIS repeats outputs at the end of the log
            self.addOutput(QgsProcessingOutputString(ANSWER, "Output of the command"))
        for field in self.row.fields:
            if field.kind == NEW_FOLDER and field.optional:
                self.addOutput(QgsProcessingOutputFolder(field.name, field.label))
        if self.row.project:
            self.addOutput(QgsProcessingOutputString(PROJECT, "QGIS project of the maps"))
        if self.row.plots:
            self.addOutput(QgsProcessingOutputHtml(PLOT, f"{self.title}: plot"))
        if self.row.table:
            self.addOutput(QgsProcessingOutputHtml(TABLE, self.title))

    def processAlgorithm(
        self, parameters: dict, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict:
        """Run the command, and return the outputs by name.

        Parameters
        ----------
        parameters : dict
        context : QgsProcessingContext
        feedback : QgsProcessingFeedback

        Returns
        -------
        dict

        Raises
        ------
        QgsProcessingException
            Not exactly one of alternative fields is given, or the command failed.
        """
        row = self.row
        if row.one_of and sum(bool(self.values[name]) for name in row.one_of) != 1:
            labels = " / ".join(f"'{field.label}'" for field in row.fields if field.name in row.one_of)
            raise QgsProcessingException(f"mpmgis {row.verb}: give exactly one of {labels}")
        answers = call(command_path(), row.verb, arguments(row.fields, self.values), feedback)
        for line, recommends in map(shown_answer, answers if row.says else ()):
            (feedback.pushWarning if recommends else feedback.pushConsoleInfo)(line)
        files = answers + self._in_folder()
        plot = plot_among(files) if row.plots else {}
        said = {TABLE: self._table(feedback)} if row.table else {ANSWER: "\n".join(answers)}
        return {**said, **plot, **self._more_files(), **self._written(files, context, feedback)}

    def _more_files(self):
        """Files beside the output that the user asked for: a film."""
        asked = {field.name: self.values[field.name] for field in self.row.fields if field.kind == NEW_FILE}
        return {name: path for name, path in asked.items() if path and name != OUTPUT}

    def _table(self, feedback):
        """Path of a temporary page with the answer of the command as a table; measured times are only in the log."""
        values = {name: value for name, value in self.values.items() if name != "MEASURE"}
        printed = call(command_path(), self.row.verb, [*arguments(self.row.fields, values), "--json"], feedback)
        path = QgsProcessingUtils.generateTempFilename(f"{self.row.verb}.html")
        write_whole(path, page_of(self.title, json.loads("\n".join(printed))).encode())
        return path

    def _in_folder(self):
        """Files in the output folder, for a verb that does not print their paths."""
        folder = self.values.get(OUTPUT)
        if not (self.row.says and folder and os.path.isdir(folder)):
            return []
        return [os.path.join(folder, name) for name in sorted(os.listdir(folder))]

    def _written(self, answers, context, feedback):
        """The output by its name; its layers are loaded if the user asked for it."""
        if self.row.project:
            return self._exported(answers, feedback)
        if not any(field.name == OUTPUT for field in self.row.fields):
            return {}
        wanted = self.row.layers if self.row.layers and self.values[LOAD] else ()
        for path in dict.fromkeys(path for path in answers if wanted and path.endswith(wanted)):
            self._load_later(path, context)
        path = self.values[OUTPUT] or (None if self.row.says else answers[0])
        return {OUTPUT: path} if path else {}

    def _exported(self, answers, feedback):
        project_file = exported_project(answers)
        folder = self.values[OUTPUT] or os.path.dirname(project_file)
        feedback.pushInfo(f"maps in {project_file}")
        if self.values[LOAD]:
            self.project_file = project_file
        return {OUTPUT: folder, PROJECT: project_file}

    def _load_later(self, path, context):
        layer = layer_of(path, self.row.palette)
        if layer is None or context.project() is None:
            return
        if layer.name() == OUTPUT:  # name of a temporary file of QGIS
            layer.setName(self.parameterDefinition(OUTPUT).description())
        context.temporaryLayerStore().addMapLayer(layer)
        details = QgsProcessingContext.LayerDetails(layer.name(), context.project(), OUTPUT)
        context.addLayerToLoadOnCompletion(layer.id(), details)


def verb_algorithm(row: Verb) -> type[VerbAlgorithm]:
    """Return the class of algorithms for a row of the table of verbs.

    Parameters
    ----------
    row : Verb

    Returns
    -------
    class
        Of VerbAlgorithm.
    """
    return type(
        f"{row.identifier.capitalize()}Algorithm",
        (VerbAlgorithm,),
        {
            "row": row,
            "identifier": row.identifier,
            "title": row.title,
            "group_title": row.group,
            "text": row.help,
            "verbs": (row.verb,),
            "form": row.fields,
        },
    )


class SimulateAlgorithm(CommandAlgorithm):
    """Writes a scene from a form, simulates it and exports the results."""

    identifier = scene_form.IDENTIFIER
    title = scene_form.TITLE
    group_title = scene_form.GROUP
    verbs = ("run", "export-raster")

    def __init__(self):
        super().__init__()
        stated = read_scene_data()
        self.form, self.text = scene_form.fields(stated), scene_form.help_text(stated)

    def initAlgorithm(self, configuration: dict | None = None) -> None:
        """Declare the fields of the form as parameters, and the outputs.

        Parameters
        ----------
        configuration : dict, optional
            Unused.
        """
        super().initAlgorithm(configuration)
        for name, label in ((SCENE, "Scene file"), (FRAMES, "Folder of frames"), (MAPS, "Folder of maps")):
            self.addOutput(QgsProcessingOutputString(name, label))

    def processAlgorithm(
        self, parameters: dict, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict:
        """Write the scene, simulate and export it, and return the outputs by name.

        Parameters
        ----------
        parameters : dict
        context : QgsProcessingContext
        feedback : QgsProcessingFeedback

        Returns
        -------
        dict

        Raises
        ------
        QgsProcessingException
            Contradicting fields, a scene that exists or cannot be written, or the command failed.
        """
        command, values, folder = command_path(), self.values, self.values[OUTPUT]
        if values["THICKNESS"] and values["THICKNESS_COLUMN"]:
            raise QgsProcessingException("Release thickness: give metres or a column, not both")
        scene, frames, maps = (os.path.join(folder, name) for name in scene_form.NAMES)
        switches = ["--overwrite"] if values["OVERWRITE"] else []
        if os.path.exists(scene) and not values["OVERWRITE"]:
            raise QgsProcessingException(f"{scene} exists already; choose another folder, or switch on replacing it")
        asked = [scene, f"--output={frames}", *switches, *self._machine()]
        try:
            with kept_unless((scene, os.path.join(folder, scene_form.RELEASE_FILE)), is_refusal):
                self._write_scene(scene, feedback)
                call(command, "run", asked, feedback, 0.0, RUN_SHARE)
        except OSError as error:
            raise QgsProcessingException(f"{folder}: the scene cannot be written ({error.strerror})") from None
        asked = [frames, f"--output={maps}", f"--qgis-min={oldest_qgis()}", *switches]
        exported = call(command, "export-raster", asked, feedback, RUN_SHARE, 100.0)
        if values[LOAD]:
            self.project_file = exported_project(exported)
        feedback.pushInfo(f"scene, frames and maps are in {folder}")
        return {OUTPUT: folder, SCENE: scene, FRAMES: frames, MAPS: maps}

    def _machine(self):
        asked = ["--yes"] if self.values["YES"] else []
        return asked + ([f"--threads={self.values['THREADS']}"] if self.values["THREADS"] else [])

    def _write_scene(self, path, feedback):
        """Write the scene file; a temporary release file of QGIS is copied to the same folder."""
        values, folder, passing = dict(self.values), os.path.dirname(path), QgsProcessingUtils.tempFolder()
        release, _, layer = values["RELEASE"].partition("|")
        if release.endswith(".gpkg") and _is_inside(release, passing):
            copy_whole(release, os.path.join(folder, scene_form.RELEASE_FILE))
            values["RELEASE"] = scene_form.RELEASE_FILE + (f"|{layer}" if layer else "")
        if _is_inside(values["DEM"], passing):
            feedback.pushWarning(f"{values['DEM']} is a temporary file of QGIS; save it to run this scene again later")
        write_whole(path, scene_form.scene_text(values).encode())


def plot_among(paths: list[str]) -> dict[str, str]:
    """Return the picture among the paths that a verb printed, as the output PLOT; {} without one.

    Parameters
    ----------
    paths : list of str

    Returns
    -------
    dict of str to str
    """
    found = [path for path in paths if path.endswith(".png") and os.path.exists(path)]
    return {PLOT: found[0]} if found else {}


def exported_project(paths: list[str]) -> str:
    """Return the project file among the paths that an export printed.

    Parameters
    ----------
    paths : list of str

    Returns
    -------
    str
    """
    return next(path for path in paths if path.endswith(".qgz"))


def _is_inside(path, folder):
    return os.path.realpath(path).startswith(os.path.realpath(folder) + os.sep)


def algorithms() -> list[CommandAlgorithm]:
    """Return a new algorithm of each kind, in the order of the toolbox."""
    return [SimulateAlgorithm(), *(verb_algorithm(row)() for row in read_forms())]
