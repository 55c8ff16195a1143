"""Print the oldest dependencies that pyproject.toml allows, as requirements for pip."""

import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
extras = project["optional-dependencies"]
for requirement in project["dependencies"] + extras["parquet"] + extras["plot"]:
    print(requirement.replace(">=", "=="))
