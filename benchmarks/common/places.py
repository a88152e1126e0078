"""Where pages go, and where the independent images may lie."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = ROOT / "docs" / "benchmarks"
INDEPENDENT_IMAGES = ROOT.parent / "shared" / "fluoroscopy"
CATALOGUE = ROOT / "shared" / "parts" / "catalogue"
