"""What the colours, marks and lines of the overview picture mean."""

from collections.abc import Mapping
from typing import Any, Final

from are_ros.builder.events import EventKind
from are_ros.draw.scene import SceneRecord
from are_ros.replay._picture_artefacts import is_gone
from are_ros.replay._picture_behaviours import behaviour_counts
from are_ros.replay._picture_marks import CONTACT_LOOK, DISPLACED_LOOK, forced, of_kind
from are_ros.replay._picture_robot import SEEN_COLOUR

_GREY: Final = "#6c757d"


def legends(
    record: SceneRecord,
    colours: Mapping[str, str],
    marks: Mapping[str, str],
    *,
    has_companies: bool,
) -> list[list[Any]]:
    """Return the handles of the legends: classes, behaviours, and what else there is to see."""
    rest = [*_artefact_handles(record), *_event_handles(record)]
    if has_companies:
        rest.append(_line(color=_GREY, lw=1.2, ls=(0, (1, 1.2)), label="following"))
    return [_classes(record, colours), _behaviours(record, marks), [*rest, *_views(record)]]


def _classes(record: SceneRecord, colours: Mapping[str, str]) -> list[Any]:
    from matplotlib.patches import Patch

    handles = []
    for name in sorted({life.row.class_name for life in record.lives}):
        lives = [life for life in record.lives if life.row.class_name == name]
        text = f"{name}  {sum(life.is_perceived for life in lives)} of {len(lives)}"
        handles.append(Patch(facecolor=colours[name], edgecolor="white", label=text))
    return handles


def _behaviours(record: SceneRecord, marks: Mapping[str, str]) -> list[Any]:
    look = {"markerfacecolor": "white", "markeredgecolor": _GREY, "markeredgewidth": 1.1}
    return [
        _line(marker=marks[name], ls="none", ms=5.6, label=f"{name}  {count}", **look)
        for name, count in behaviour_counts(record.lives).items()
    ]


def _artefact_handles(record: SceneRecord) -> list[Any]:
    from matplotlib.patches import Patch

    if not record.lives:
        return []
    outline: dict[str, Any] = {"edgecolor": _GREY, "lw": 0.9}
    handles = [
        Patch(facecolor=_GREY, label="perceived"),
        Patch(facecolor="white", hatch="/////", label="never perceived", **outline),
    ]
    end_ns = int(record.series.stamps_ns[-1]) if len(record.series.stamps_ns) else 0
    if any(is_gone(life, end_ns) for life in record.lives):
        handles.append(Patch(facecolor=_GREY, alpha=0.38, label="left"))
    if any(len(life.footprints) > 1 for life in record.lives):
        handles.append(_line(color=_GREY, lw=1.1, label="way"))
        handles.append(_line(color=_GREY, lw=2.8, label="way while perceived"))
    return handles


def _event_handles(record: SceneRecord) -> list[Any]:
    """Return the marks that there are, with their counts."""
    marks = (
        (of_kind(record, EventKind.ROBOT_CONTACT), CONTACT_LOOK, "robot contact"),
        (forced(record), DISPLACED_LOOK, "displaced"),
    )
    return [_line(label=f"{text}  {len(events)}", **look) for events, look, text in marks if events]


def _views(record: SceneRecord) -> list[Any]:
    from matplotlib.patches import Patch

    if not len(record.camera):
        return []
    return [
        Patch(facecolor=SEEN_COLOUR, alpha=0.42, label="field of view"),
        Patch(facecolor=SEEN_COLOUR, alpha=0.17, label="in view at some time"),
    ]


def _line(**look: Any) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], **look)
