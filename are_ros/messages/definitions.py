"""The texts of the message definitions that ARE brings along, from one source: msg_defs/."""

from pathlib import Path

from are_ros.errors import InputError

_PACKAGES = ("are_msgs", "compat/map_msgs", "compat/tf2_msgs")


def message_texts(folder: Path | None = None) -> dict[str, str]:
    """Return the .msg texts by full type name ("are_msgs/msg/Artefact"), in order of name.

    `folder` is `definitions_folder()` unless given. InputError if a package is not in it.
    """
    root = definitions_folder() if folder is None else folder
    texts: dict[str, str] = {}
    for package in _PACKAGES:
        files = sorted((root / package / "msg").glob("*.msg"))
        if not files:
            raise InputError(f"{root}: the message definitions of {package} are missing")
        texts |= {
            f"{Path(package).name}/msg/{file.stem}": file.read_text("utf-8") for file in files
        }
    return dict(sorted(texts.items()))


def definitions_folder(module: Path = Path(__file__)) -> Path:
    """Return the folder msg_defs: in a source checkout, else share/are_ros/msg_defs.

    An installation puts share/ beside lib/ at its prefix, so it is sought above this module.
    InputError if there is none.
    """
    above = module.resolve().parents
    candidates = [above[2] / "msg_defs", *(up / "share/are_ros/msg_defs" for up in above)]
    for candidate in candidates:
        if (candidate / _PACKAGES[0]).is_dir():
            return candidate
    raise InputError("the message definitions (share/are_ros/msg_defs) are not installed")
