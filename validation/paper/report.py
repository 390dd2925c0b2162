# SPDX-License-Identifier: Apache-2.0
"""The report as a folder: pictures, tables and one page."""

import base64
import io
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

import numpy as np
import yaml
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.figure import Figure

from stickslip_ros.base.errors import UsageError
from stickslip_ros.base.files import whole_folder, writing
from stickslip_ros.base.reporting.page import page
from stickslip_ros.base.reporting.picture import TWO_COLUMNS
from stickslip_ros.base.reporting.tables import csv_text
from stickslip_ros.version import __version__
from validation.paper import contact, influences, response, step_curves
from validation.paper.claim import Claim, ClaimVerdict, Result, read_charts, read_checks

#: What computes each claim of claims.yaml, in the order of the paper.
_COMPUTED: Mapping[str, Callable[[], Result]] = {
    "fig02": response.response, "fig02b": response.shape, "tab01": contact.table_1,
    "joint": contact.joint_set, "fig03": step_curves.dead_zone, "sec22": influences.influences,
    "sec3": influences.vibration, "fig04": step_curves.ratios,
    "fig04c": step_curves.negative_steps, "fig05": step_curves.earlier_laws,
    "tab02": step_curves.parameter_sets, "tab03": contact.table,
    "fig06": contact.zero_amplitude_of_materials, "fig07": step_curves.slewrate,
    "eq09": response.balance, "shaping": response.shaping, "elongation": response.elongation,
    "fig08": contact.damping, "sec43": step_curves.too_low, "fig09": contact.blocking,
    "fig10": contact.stiffness, "sec45": response.hysteresis, "fig11": contact.eigenfrequency,
    "fig12": contact.slopes_of_force, "fig13": influences.velocity, "sec52": influences.contacts,
    "sec53": step_curves.steady_state_distance, "fig14": step_curves.ceim,
    "fig15": contact.bounds_of_force, "tab05": contact.guide,
}  # fmt: skip
_HERE = Path(__file__).parent
_CHECKS = read_checks(_HERE / "checks.csv")
_CHARTS = read_charts(_HERE / "charts.yaml")
CLAIMS: tuple[Claim, ...] = tuple(
    Claim(
        name=name, simulate=_COMPUTED[name], checks=_CHECKS[name], chart=_CHARTS.get(name), **texts
    )
    for name, texts in yaml.safe_load((_HERE / "claims.yaml").read_text(encoding="utf-8")).items()
)
PAGE = "index.html"
#: Its lines list the files of the folder; it marks a folder as such a report.
CONTENTS = "contents.txt"
_FIRST_LINE = "make paper: this folder is replaced as a whole"
FAILED = "could not be computed"
#: Badges of the page.
_BADGES = {ClaimVerdict.AGREES.value: "good", ClaimVerdict.IN_KIND.value: "mixed"} | dict.fromkeys(
    (ClaimVerdict.DISAGREES.value, FAILED), "bad"
)


@dataclass(frozen=True)
class ClaimOutcome:
    """Result of a claim; a failed claim has only a fault."""

    claim: Claim
    result: Result | None = None
    files: Mapping[str, bytes] = field(default_factory=dict)  #: beside the page, by their names
    fault: str = ""

    @property
    def verdict(self) -> str:
        """The verdict as text."""
        return self.result.verdict.value if self.result else FAILED

    @property
    def joint_verdict(self) -> str:
        """The verdict with the joint set as text, "" where only one set is shown."""
        found = self.result.joint_verdict if self.result else None
        return found.value if found else ""

    @property
    def verdicts(self) -> str:
        """Both verdicts in a line."""
        return f"{self.verdict}{f'; joint set {joint}' if (joint := self.joint_verdict) else ''}"

    @property
    def image(self) -> str:
        """The picture as an address that holds it, "" for none."""
        picture = base64.b64encode(self.files.get(f"{self.claim.name}.svg", b"")).decode()
        return f"data:image/svg+xml;base64,{picture}" if picture else ""


def refuse_foreign(folder: Path) -> None:
    """Raise UsageError if a folder is there that holds anything that no report wrote."""
    if not folder.exists() and not folder.is_symlink():
        return
    if not folder.is_dir() or folder.is_symlink():
        raise UsageError(f"{folder} is not a folder; choose another --out")
    try:
        lines = (folder / CONTENTS).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError):
        lines = []
    known = {CONTENTS, *lines[1:]} if lines[:1] == [_FIRST_LINE] else set()
    foreign = sorted({path.name for path in folder.iterdir()} - known)
    if foreign:
        raise UsageError(
            f"{folder} holds {foreign[0]}, not part of an earlier report; choose another --out"
        )


def report(
    folder: Path,
    claims: Sequence[Claim],
    executor: Executor,
    progress: Callable[[ClaimOutcome], object] = lambda outcome: None,
) -> list[ClaimOutcome]:
    """Compute the claims on the executor and write the folder; return the outcomes.

    A claim that fails stands in the page as failed. progress is called with each outcome.
    Raises UsageError for a folder that is no report, WriteError for one that cannot be written;
    an interrupted run leaves what was there before.
    """
    refuse_foreign(folder)
    with writing(folder):
        folder.absolute().parent.mkdir(parents=True, exist_ok=True)
    outcomes = []
    waiting = [executor.submit(claim.compute) for claim in claims]
    try:
        for claim, future in zip(claims, waiting, strict=True):
            outcomes.append(_outcome(claim, future.result))
            progress(outcomes[-1])
    finally:
        for future in waiting:
            future.cancel()
    files = {name: content for one in outcomes for name, content in one.files.items()}
    files[PAGE] = _page(outcomes).encode()
    files[CONTENTS] = "\n".join([_FIRST_LINE, *sorted(files), ""]).encode()
    fresh = folder.with_name(f"{folder.name}.new")  # whole before the old one goes
    with writing(folder):
        shutil.rmtree(fresh, ignore_errors=True)
    with whole_folder(fresh) as work:
        work.mkdir()
        for name, content in files.items():
            (work / name).write_bytes(content)
    with writing(folder):
        if folder.exists():
            shutil.rmtree(folder)
        fresh.rename(folder)
    return outcomes


def _outcome(claim: Claim, compute: Callable[[], Result]) -> ClaimOutcome:
    """Return the outcome of a claim with its files; one that fails says why."""
    try:
        result = compute()
        files = {f"{claim.name}.{kind}": image for kind, image in _draw_picture(result).items()}
        for ending, table in result.tables.items():
            text = csv_text(table, np.transpose([*table.values()]).tolist())
            files[f"{claim.name}{ending}.csv"] = text.encode()
    except Exception as error:  # whatever it is, the other claims are not to blame
        return ClaimOutcome(claim, fault=f"{type(error).__name__}: {error}")
    return ClaimOutcome(claim, result, files)


def _draw_picture(result: Result) -> dict[str, bytes]:
    """Return the picture as PNG and SVG, by the ending of its name."""
    if result.draw is None:
        return {}
    figure = Figure(figsize=(TWO_COLUMNS, result.height), layout="constrained")
    result.draw(figure)
    pictures = {}
    for kind, metadata in (("png", {"Software": None}), ("svg", {"Date": None})):
        file = io.BytesIO()
        with rc_context({"svg.hashsalt": "stickslip", "svg.fonttype": "none"}):
            figure.savefig(file, dpi=150, format=kind, metadata=metadata, transparent=kind == "svg")
        pictures[kind] = file.getvalue()
    return pictures


def _page(outcomes: Sequence[ClaimOutcome]) -> str:
    found = [outcome.verdict for outcome in outcomes]
    order = [*(verdict.value for verdict in ClaimVerdict), FAILED]
    return page(
        _HERE / "paper.html", outcomes=outcomes, version=__version__,
        counts=[(found.count(name), name) for name in order if name in found], badges=_BADGES,
        errata=[[_marked_up(text) for text in row] for row in errata()],
    )  # fmt: skip


def errata() -> list[list[str]]:
    """Return the rows of errata.md: where, printed, used, why. docs/paper_errata.md too."""
    lines = (_HERE / "errata.md").read_text(encoding="utf-8").splitlines()
    return [[cell.strip() for cell in line.strip("| ").split(" | ")] for line in lines[2:]]


def _marked_up(text: str) -> Markup:
    """Return the HTML of a text with `code` and [links](to pages that are not here)."""
    plain = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text)
    return Markup(re.sub("`([^`]*)`", r"<code>\1</code>", escape(plain)))
