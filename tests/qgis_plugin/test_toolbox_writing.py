"""Files that the toolbox writes itself: whole, and through no link."""

import os

import pytest
from mpmgis_qgis import restored_files


def test_a_file_is_written_whole(tmp_path):
    restored_files.write_whole(str(tmp_path / "scene.toml"), b"new")
    (tmp_path / "source").write_bytes(b"copied")
    restored_files.copy_whole(str(tmp_path / "source"), str(tmp_path / "copy"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["copy", "scene.toml", "source"]
    assert (tmp_path / "copy").read_bytes() == b"copied" and (tmp_path / "scene.toml").read_bytes() == b"new"


def test_no_link_is_followed(tmp_path):
    (tmp_path / "victim").write_text("years of work")
    names = ["scene.toml", f"free.toml.part{os.getpid()}"]
    for name in names:
        try:
            (tmp_path / name).symlink_to(tmp_path / "victim")
        except OSError:
            pytest.skip("no links can be made here")
    with pytest.raises(OSError, match="is a link"):
        restored_files.write_whole(str(tmp_path / "scene.toml"), b"new")
    restored_files.write_whole(str(tmp_path / "free.toml"), b"new")
    assert (tmp_path / "victim").read_text() == "years of work"
    assert all((tmp_path / name).is_symlink() for name in names)
    assert (tmp_path / "free.toml").read_bytes() == b"new"
