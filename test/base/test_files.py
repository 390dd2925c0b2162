# SPDX-License-Identifier: Apache-2.0
"""Files that are there as a whole or not at all, whatever call of the operating system fails."""

import errno
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from file_layer import FileLayer, each_fault

from stickslip_ros.base.errors import StickslipError
from stickslip_ros.base.files import WriteError, whole_file, whole_folder, write_text, writing


def overwrite(layer: FileLayer, place: Path) -> None:
    layer.fail_at, number = -1, layer.fail_at
    (place / "table.csv").write_text("old\n")
    layer.calls.clear()
    layer.fail_at = number
    write_text(place / "table.csv", "new\n" * 5000)


def make_folder(layer: FileLayer, place: Path) -> None:
    with whole_folder(place / "report") as folder:
        folder.mkdir()
        (folder / "page.html").write_text("page\n" * 5000)


def test_after_every_fault_the_old_file_or_the_whole_new_one_is_there(tmp_path: Path) -> None:
    told = []
    for call, raised, place in each_fault(overwrite, tmp_path):
        told.append(call.split()[0])
        (left,) = place.iterdir()
        text = left.read_text()
        assert left.name == "table.csv"
        assert text in ("old\n", "new\n" * 5000), call
        assert isinstance(raised, WriteError) or call.startswith("unlink"), call
        assert raised is None or "make room on the disk" in str(raised)
    assert {"open", "write", "fsync", "replace"} <= set(told)


def test_after_every_fault_a_folder_is_whole_or_not_there(tmp_path: Path) -> None:
    told = []
    for call, raised, place in each_fault(make_folder, tmp_path):
        told.append(call.split()[0])
        assert isinstance(raised, WriteError) or call.startswith(("rmdir", "unlink")), call
        for file in place.glob("report/*"):
            assert file.read_text() == "page\n" * 5000, call
        if raised and not call.startswith(("rmdir", "unlink", "fsync")):
            assert list(place.iterdir()) == [], call
    assert {"mkdir", "open", "write", "rename", "fsync"} <= set(told)


def test_a_power_cut_never_leaves_half_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    work, after = tmp_path / "work", tmp_path / "after"
    work.mkdir()
    layer = FileLayer(monkeypatch, work)
    write_text(work / "table.csv", "new\n" * 5000)
    layer.after_power_cut(after)
    assert (after / "table.csv").read_text() == "new\n" * 5000


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_rights_is_named_with_the_cure(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(WriteError, match=r"table\.csv: Permission denied; choose a place that you"):
        write_text(tmp_path / "table.csv", "")


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("none/table.csv", "No such file or directory; make its folder first"),
        ("file/table.csv", "Not a directory; make its folder first"),
        ("folder", "Is a directory; choose a name that no folder has"),
        ("n" * 300, "File name too long; choose a shorter name"),
    ],
)
def test_what_cannot_be_says_why(tmp_path: Path, name: str, what: str) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    with pytest.raises(WriteError, match=what):
        write_text(tmp_path / name, "text")
    assert {path.name for path in tmp_path.iterdir()} == {"file", "folder"}


def test_a_folder_that_is_there_is_not_touched(tmp_path: Path) -> None:
    (tmp_path / "report").mkdir()
    with (
        pytest.raises(WriteError, match="report: File exists; choose another name"),
        whole_folder(tmp_path / "report"),
    ):
        pytest.fail("it was there")


def test_an_exception_leaves_the_old_file(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    file.write_text("old")
    with pytest.raises(KeyError), whole_file(file) as part:
        part.write_text("half")
        raise KeyError
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]
    assert file.read_text() == "old"


def test_two_at_once_write_two_whole_files(tmp_path: Path) -> None:
    texts = [f"{number}\n" * 20000 for number in range(8)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda text: write_text(tmp_path / "table.csv", text), texts))
    assert (tmp_path / "table.csv").read_text() in texts
    assert len(list(tmp_path.iterdir())) == 1


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "table.csv")
    write_text(tmp_path / "link", "text")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "table.csv").read_text() == "text"


def test_a_device_takes_what_is_written() -> None:
    write_text(Path("/dev/null"), "text")
    with pytest.raises(WriteError, match="/dev/full: No space left on device; make room"):
        write_text(Path("/dev/full"), "text")


@pytest.mark.parametrize("number", [errno.EMFILE, errno.EROFS, errno.EIO])
def test_every_reason_has_a_cure(number: int) -> None:
    with pytest.raises(StickslipError, match=r"^cannot write it: .+; .+$"), writing("it"):
        raise OSError(number, os.strerror(number))
