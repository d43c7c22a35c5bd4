"""When a live node takes its leave, or is paused, nothing virtual stays in what it gives out."""

from are_ros.bag.marker_decoding import DELETE_ALL
from are_ros.bag.recording import PREFIX
from are_ros.replay._check_record import Record
from are_ros.replay._check_result import CheckResult, Tally, at_s
from are_ros.wording import counted


def check_farewells(record: Record) -> CheckResult:
    """With the empty list of artefacts nobody is perceived or counted, and a DELETEALL goes out.

    The grids of a farewell are looked at with the other grids.
    """
    tally = Tally("farewells", "farewell")
    wiped = {
        show.log_ns
        for show in record.shows
        if any(change.action == DELETE_ALL for change in show.changes)
    }
    for stamp_ns in record.farewells_ns:
        tally.look()
        if PREFIX + "markers" in record.topics and stamp_ns not in wiped:
            if _is_followed(record, stamp_ns):
                tally.fail(f"{at_s(stamp_ns)} the markers are not deleted")
            else:
                tally.note("the recording ends before the markers are deleted")
    for stamp_ns, message in record.last_words:
        count = getattr(message, "alive", None)
        count = len(message.artefacts) if count is None else int(count) + int(message.perceived)
        tally.require(
            count == 0, f"{at_s(stamp_ns)} there is still word of {counted(count, 'artefact')}"
        )
    return tally.result()


def _is_followed(record: Record, stamp_ns: int) -> bool:
    return any(scene.stamp_ns > stamp_ns for scene in record.scenes)
