"""The readme for a package index, beside which there are no files to link to."""

import re
from pathlib import Path

from setuptools import setup


def without_file_links(text: str) -> str:
    """Markdown with the texts of links to files of the project in place of the links."""
    return re.sub(r"\[([^\]]+)\]\((?!https?://)[^)]*\)", r"\1", text)


if __name__ == "__main__":
    readme = Path(__file__).with_name("README.md").read_text(encoding="utf-8")
    setup(
        long_description=without_file_links(readme),
        long_description_content_type="text/markdown",
    )
