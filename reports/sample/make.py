"""Make the sample again: ``python reports/sample/make.py`` from the top of the repository (a minute or two).

It runs the campaign of the examples and keeps its page, the report of each recording, and the figures that the README
shows; curves and results (5 MB each) are left out.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from camtorque.campaign import run_campaign

SAMPLE = Path("reports/sample")
SHOWN = "A_1000rpm"
FIGURES = ("torque_full.png", "pressure.png", "gap.png", "evidence.png")


def main() -> None:
    """Run the campaign and copy what is kept."""
    with tempfile.TemporaryDirectory(dir="reports", prefix="sample-") as place:
        out = Path(place) / "campaign"
        document = run_campaign(Path("raw_examples"), out)
        shutil.rmtree(SAMPLE / "campaign", ignore_errors=True)
        (SAMPLE / "campaign").mkdir()
        page = (out / "campaign.html").read_text(encoding="utf-8")
        for row in document["recordings"]:
            report = SAMPLE / "campaign" / row["name"]
            report.mkdir()
            shutil.copy(out / row["folder"] / "report.html", report)
            page = page.replace(row["folder"], row["name"])  # the key changes with the code, the name does not
            if row["name"] == SHOWN:
                for name in FIGURES:
                    shutil.copy(out / row["folder"] / "figures" / name, SAMPLE)
        (SAMPLE / "campaign" / "campaign.html").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
