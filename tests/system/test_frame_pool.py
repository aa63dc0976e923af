"""Threads that read frames and write rasters end before the folder of a failed export is removed."""

import threading

import pytest

from mpmgis.system.parallel import frame_pool


def test_no_thread_works_after_an_error(tmp_path):
    begun, go_on = threading.Event(), threading.Event()

    def write():
        begun.set()
        go_on.wait(10)
        (tmp_path / "late").write_text("written after the error")

    with frame_pool(1) as pool:
        with pytest.raises(ValueError, match="disk"), pool.ended():
            works, waits = pool.threads.submit(write), pool.threads.submit(write)
            begun.wait(10)
            threading.Timer(0.1, go_on.set).start()
            raise ValueError("disk")
        assert works.done() and waits.cancelled() and (tmp_path / "late").exists()


def test_without_an_error_the_threads_go_on():
    with frame_pool(1) as pool:
        with pool.ended():
            pass
        assert pool.threads.submit(sum, (1, 2)).result() == 3
