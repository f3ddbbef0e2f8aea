"""Programs that write pages of docs/results and pictures of docs/images: python -m scripts.pages.NAME."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
#: Where measured pages stand.
RESULTS = ROOT / "docs" / "results"
#: Where the pictures of all pages stand.
IMAGES = ROOT / "docs" / "images"
