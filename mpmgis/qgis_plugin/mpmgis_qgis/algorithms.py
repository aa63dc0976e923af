"""The algorithms of the toolbox: one for each verb of the command, and a form that simulates from scratch."""

from __future__ import annotations

import os
import shutil

from processing.core.ProcessingConfig import ProcessingConfig
from qgis.core import (
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingOutputString,
    QgsProcessingUtils,
)

from . import scene_form
from .calling import call
from .commands import VERBS
from .fields import arguments
from .finding import SETTING, CommandMissing, find_command
from .loading import add_project, layer_of
from .parameters import oldest_qgis, parameter, plain_values
from .simulating import GROUP
from .verbs import LOAD, OUTPUT

ANSWER = "ANSWER"  # output: what the command printed
SCENE, FRAMES, MAPS = "SCENE", "FRAMES", "MAPS"  # outputs of the form
RUN_SHARE = 70.0  # [%] of the progress bar; the rest is the export


class CommandAlgorithm(QgsProcessingAlgorithm):
    """What all share: a form of fields, the command, and a project file to open when it is over."""

    identifier = title = group_title = text = ""
    form = ()

    def __init__(self):
        super().__init__()
        self.values = {}
        self.project_file = None

    def createInstance(self):
        return type(self)()

    def name(self):
        return self.identifier

    def displayName(self):
        return self.title

    def group(self):
        return self.group_title

    def groupId(self):
        return self.group_title.replace(" ", "").lower()

    def shortHelpString(self):
        return self.text

    def initAlgorithm(self, configuration=None):
        for field in self.form:
            self.addParameter(parameter(field))

    def canExecute(self):
        try:
            command_path()
        except QgsProcessingException as missing:
            return False, str(missing)
        return True, ""

    def prepareAlgorithm(self, parameters, context, feedback):
        self.values = plain_values(self, self.form, parameters, context, feedback)
        return True

    def postProcessAlgorithm(self, context, feedback):
        if self.project_file and context.project() is not None:
            trouble = add_project(self.project_file, context.project())
            if trouble:
                feedback.reportError(f"{self.project_file} was written, but not all of it opens here: {trouble}")
        return {}


def command_path():
    """The command that the settings name, or that is on PATH; raises QgsProcessingException where it is not there."""
    try:
        return find_command(ProcessingConfig.getSetting(SETTING))
    except CommandMissing as missing:
        raise QgsProcessingException(str(missing)) from None


class VerbAlgorithm(CommandAlgorithm):
    """One verb of the command, from its row of the table."""

    row = None

    def initAlgorithm(self, configuration=None):
        super().initAlgorithm(configuration)
        self.addOutput(QgsProcessingOutputString(ANSWER, "What the command printed"))

    def processAlgorithm(self, parameters, context, feedback):
        row = self.row
        if row.one_of and sum(bool(self.values[name]) for name in row.one_of) != 1:
            labels = " / ".join(f"'{field.label}'" for field in row.fields if field.name in row.one_of)
            raise QgsProcessingException(f"mpmgis {row.verb}: give exactly one of {labels}")
        answers = call(command_path(), row.verb, arguments(row.fields, self.values), feedback)
        for line in answers if row.says else ():
            feedback.pushConsoleInfo(line)
        return {ANSWER: "\n".join(answers), **self._written(answers, context, feedback)}

    def _written(self, answers, context, feedback):
        """The output by its name, made ready to be loaded where that was asked."""
        if self.row.project:
            return {OUTPUT: self._exported(answers, feedback)}
        if not any(field.name == OUTPUT for field in self.row.fields):
            return {}
        for path in answers:
            if self.row.layers and self.values[LOAD] and path.endswith(self.row.layers):
                self._load_later(path, context)
        path = self.values[OUTPUT] or (None if self.row.says else answers[0])
        return {OUTPUT: path} if path else {}

    def _exported(self, answers, feedback):
        project_file = exported_project(answers)
        folder = os.path.dirname(project_file)
        feedback.pushInfo(f"{len(answers)} files in {folder}")
        if self.values[LOAD]:
            self.project_file = project_file
        return folder

    def _load_later(self, path, context):
        layer = layer_of(path)
        if layer is None or context.project() is None:
            return
        if layer.name() == OUTPUT:  # what QGIS calls a temporary file
            layer.setName(self.parameterDefinition(OUTPUT).description())
        context.temporaryLayerStore().addMapLayer(layer)
        details = QgsProcessingContext.LayerDetails(layer.name(), context.project(), OUTPUT)
        context.addLayerToLoadOnCompletion(layer.id(), details)


def verb_algorithm(row):
    """The class of algorithms for `row` of the table of verbs."""
    return type(
        f"{row.identifier.capitalize()}Algorithm",
        (VerbAlgorithm,),
        {
            "row": row,
            "identifier": row.identifier,
            "title": row.title,
            "group_title": row.group,
            "text": row.help,
            "form": row.fields,
        },
    )


class SimulateAlgorithm(CommandAlgorithm):
    """A scene from a form, simulated and exported in one go."""

    identifier = scene_form.IDENTIFIER
    title = scene_form.TITLE
    group_title = GROUP
    text = scene_form.HELP
    form = scene_form.FIELDS

    def initAlgorithm(self, configuration=None):
        super().initAlgorithm(configuration)
        for name, label in ((SCENE, "Scene file"), (FRAMES, "Folder of frames"), (MAPS, "Folder of maps")):
            self.addOutput(QgsProcessingOutputString(name, label))

    def processAlgorithm(self, parameters, context, feedback):
        command, values, folder = command_path(), self.values, self.values[OUTPUT]
        scene, frames, maps = (os.path.join(folder, name) for name in scene_form.NAMES)
        self._write_scene(scene)
        switches = ["--overwrite"] if values["OVERWRITE"] else []
        call(command, "run", [scene, f"--output={frames}", *switches, *self._machine()], feedback, 0.0, RUN_SHARE)
        asked = [frames, f"--output={maps}", f"--qgis-min={oldest_qgis()}", *switches]
        exported = call(command, "export-raster", asked, feedback, RUN_SHARE, 100.0)
        if values[LOAD]:
            self.project_file = exported_project(exported)
        feedback.pushInfo(f"scene, frames and maps are in {folder}")
        return {OUTPUT: folder, SCENE: scene, FRAMES: frames, MAPS: maps}

    def _machine(self):
        asked = ["--yes"] if self.values["YES"] else []
        return asked + ([f"--threads={self.values['THREADS']}"] if self.values["THREADS"] else [])

    def _write_scene(self, path):
        """The scene file; a release that QGIS saved for this call goes beside it, because QGIS will remove it."""
        if os.path.exists(path) and not self.values["OVERWRITE"]:
            raise QgsProcessingException(f"{path} exists already; take another folder, or switch on replacing it")
        folder = os.path.dirname(path)
        os.makedirs(folder, exist_ok=True)
        values = dict(self.values)
        release, _, layer = values["RELEASE"].partition("|")
        if release.endswith(".gpkg") and _is_inside(release, QgsProcessingUtils.tempFolder()):
            shutil.copyfile(release, os.path.join(folder, scene_form.RELEASE_FILE))
            values["RELEASE"] = scene_form.RELEASE_FILE + (f"|{layer}" if layer else "")
        with open(path, "w", encoding="utf-8") as file:
            file.write(scene_form.scene_text(values))


def exported_project(paths):
    """The project file among the `paths` that an export printed; it comes first."""
    return next(path for path in paths if path.endswith(".qgz"))


def _is_inside(path, folder):
    return os.path.realpath(path).startswith(os.path.realpath(folder) + os.sep)


def algorithms():
    """A new algorithm of each kind, in the order of the toolbox."""
    return [SimulateAlgorithm(), *(verb_algorithm(row)() for row in VERBS)]
