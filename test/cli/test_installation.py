# SPDX-License-Identifier: Apache-2.0
"""``stickslip completion``: what the shells themselves make of the scripts."""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from stickslip_ros.cli.command_line import SUBCOMMANDS
from stickslip_ros.cli.installation import SHELLS
from stickslip_ros.cli.main import main


@pytest.fixture
def scripts(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> dict[str, Path]:
    found = {}
    for shell in SHELLS:
        assert main(["completion", shell]) == 0
        found[shell] = tmp_path / f"completion.{shell}"
        found[shell].write_text(capsys.readouterr().out, encoding="utf-8")
    return found


def completed(script: Path, words: Sequence[str], folder: Path) -> list[str]:
    """Return what bash offers for the last of the words."""
    program = (
        f"source {script}\n"
        f"COMP_WORDS=({' '.join(repr(word) for word in words)})\n"
        f"COMP_CWORD={len(words) - 1}\n"
        'f=$(complete -p stickslip | sed "s/.*-F \\([^ ]*\\).*/\\1/")\n'
        f"$f stickslip {words[-1]!r} {words[-2]!r}\n"
        'printf "%s\\n" "${COMPREPLY[@]}"\n'
    )
    found = subprocess.run(
        ["bash", "-c", program], capture_output=True, text=True, cwd=folder, timeout=60
    )
    return found.stdout.split()


@pytest.mark.skipif(not shutil.which("bash"), reason="no bash here")
def test_bash_completes_subcommands_options_and_files(
    scripts: dict[str, Path], tmp_path: Path
) -> None:
    (tmp_path / "measured.csv").touch()
    script = scripts["bash"]
    assert completed(script, ["stickslip", "sim"], tmp_path) == ["simulate"]
    assert completed(script, ["stickslip", "simulate", "--ampl"], tmp_path) == ["--amplitude"]
    assert "measured.csv" in completed(script, ["stickslip", "analyse", "meas"], tmp_path)
    assert "record" in completed(script, ["stickslip", "bag", "rec"], tmp_path)
    for words, expected in (
        (["simulate", "--set", "prel"], "preload="),
        (["sweep", "--metric", "blo"], "blocking_preload"),
        (["simulate", "--config", "table1_ty"], "table1_typical.yaml"),
        (["send", "jo"], "jog"),
    ):
        assert expected in completed(script, ["stickslip", *words], tmp_path), words


@pytest.mark.slow
@pytest.mark.parametrize("shell", SHELLS)
def test_a_shell_can_read_its_script(scripts: dict[str, Path], shell: str) -> None:
    text = scripts[shell].read_text(encoding="utf-8")
    assert [name for name in SUBCOMMANDS if name not in text] == []
    if not shutil.which(shell):
        pytest.skip(f"no {shell} on this machine")
    check = "--no-execute" if shell == "fish" else "-n"
    found = subprocess.run([shell, check, str(scripts[shell])], capture_output=True, text=True)
    assert (found.returncode, found.stderr) == (0, "")
