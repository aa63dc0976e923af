"""End this process when the program that started it has ended: QGIS, which cannot tell it when it crashes."""

import _thread
import os
import signal
import threading
import time

from . import operating_system

VARIABLE = "MPMGIS_ENDS_WITH"  # number of the process; the QGIS toolbox sets it
LOOK_SECONDS = 0.5  # [s] between two looks
STREAMS = (1, 2)  # standard output and standard error
SIGNALS = 2  # the first ends the run after its step, the second immediately
PATIENCE_SECONDS = 20.0  # [s] between the signals


def end_with_parent() -> None:
    """Watch the process of VARIABLE in a thread, and end this process as a signal does when that one has ended."""
    number = os.environ.get(VARIABLE, "")
    if not number.isdigit():
        return
    started = operating_system.process_start(int(number))
    threading.Thread(target=_watch, args=(int(number), started), daemon=True).start()


def _watch(number, started):
    while operating_system.runs(number) and operating_system.process_start(number) == started:
        time.sleep(LOOK_SECONDS)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in STREAMS:  # nobody reads them: a message would be an error
        os.dup2(nowhere, stream)
    for _ in range(SIGNALS):
        _thread.interrupt_main(signal.SIGTERM)
        time.sleep(PATIENCE_SECONDS)
