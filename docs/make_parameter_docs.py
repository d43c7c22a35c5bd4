"""Write docs/parameters.md and config/are.yaml anew from the declaration of the parameters."""  # noqa: INP001

from pathlib import Path

from are_ros.describe.parameter_table import parameter_files

PROJECT = Path(__file__).resolve().parents[1]

if __name__ == "__main__":
    for path, text in parameter_files().items():
        (PROJECT / path).write_text(text, encoding="utf-8")
