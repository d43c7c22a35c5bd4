"""Makes the sample recording: `python -m bags.make_sample_bag` writes sample_office.mcap here."""

import argparse
from pathlib import Path

from are_ros.bag.writer import BagWriter
from are_ros.conventions import NS_PER_S
from bags.simulation.camera import OfficeCamera
from bags.simulation.frames import CAMERA_FRAME, CAMERA_INFO
from bags.simulation.making import RosbagsFactory
from bags.simulation.office import OFFICE_START, OFFICE_TOUR_S, office_building, office_driver
from bags.simulation.robot import DriveLimits
from bags.simulation.simulator import Simulator
from bags.simulation.topics import record

START_NS = 1_700_000_000 * NS_PER_S
SAMPLE = Path(__file__).with_name("sample_office.mcap")


def main() -> None:
    """Record the tour through the office and say what was written."""
    arguments = _parsed_arguments()
    limits = DriveLimits()
    simulator = Simulator(office_building(), OFFICE_START, limits=limits, start_ns=START_NS)
    camera = OfficeCamera(simulator.building, CAMERA_FRAME, CAMERA_INFO)
    with BagWriter(arguments.out) as writer:
        record(
            simulator,
            office_driver(limits),
            writer,
            RosbagsFactory(),
            arguments.duration,
            camera=camera,
        )
    size_mb = arguments.out.stat().st_size / 1e6
    print(f"{arguments.out}: {arguments.duration:g} s, {size_mb:.2f} MB")
    for topic, count in writer.counts().items():
        print(f"  {topic}: {count}")


def _parsed_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=SAMPLE, help="the file to write")
    parser.add_argument("--duration", type=float, default=OFFICE_TOUR_S, help="seconds to record")
    return parser.parse_args()


if __name__ == "__main__":
    main()
